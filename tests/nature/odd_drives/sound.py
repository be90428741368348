"""Drives without a fault, some of them close to what a hasty rule takes for one."""

from collections.abc import Callable

import numpy as np

from tests.nature.odd_drives import faults
from tests.nature.odd_drives.can_log import CanKit, CanLog, savvycan
from tests.nature.odd_drives.cases import RTK, Case, Make, in_bag, in_can, in_table
from tests.nature.odd_drives.motion import CAR, FOUR, LARGE, OMNI, SMALL, Leg, road
from tests.nature.odd_drives.table import Kit


def _motorway(speed_m_s: float) -> Callable[[np.random.Generator], list[Leg]]:
    """Return the plan of a nearly straight road."""
    return lambda rng: road(rng, seconds=45.0, speed_m_s=speed_m_s)


def _straight(rng: np.random.Generator) -> list[Leg]:
    return [Leg(seconds=2.0), Leg(seconds=float(rng.uniform(20.0, 28.0)), forward=0.4), Leg(seconds=3.0)]


def _on_the_spot(rng: np.random.Generator) -> list[Leg]:
    turn = float(rng.uniform(0.4, 0.7))
    legs = [Leg(seconds=2.0), Leg(seconds=9.0, turn=turn), Leg(seconds=1.5), Leg(seconds=7.0, turn=-turn)]
    return [*legs, Leg(seconds=5.0, forward=0.3), Leg(seconds=2.0)]


def _circle(rng: np.random.Generator) -> list[Leg]:
    return [Leg(seconds=2.0), Leg(seconds=35.0, forward=0.35, turn=0.35), Leg(seconds=2.0)]


def _long_rest(rng: np.random.Generator) -> list[Leg]:
    rest = Leg(seconds=22.0)
    moves = [Leg(seconds=5.0, forward=0.6), Leg(seconds=3.0, turn=0.5), Leg(seconds=4.0, forward=0.5)]
    return [Leg(seconds=2.0), *moves, rest, *moves, Leg(seconds=2.0)]


def _savvycan(log: CanLog) -> None:
    log.writer = savvycan(5_000_000)
    log.name = "drive.csv"


MOCAP = Kit(truth="pose")
GNSS = Kit(fixes="geodetic", fix_hz=1.0, fix_sigma_m=0.5, fix_correlation_s=5.0)
DRIVES: dict[str, Make] = {
    "small_plain": in_table(SMALL),
    "small_ticks_no_gyro": in_table(SMALL, Kit(ticks=4096, gyro=False)),
    "small_ticks_wrap_truth": in_table(SMALL, Kit(ticks=8192, wrap=65536, truth="pose")),
    "small_speeds_truth": in_table(SMALL, Kit(wheels="speed", truth="pose"), back=True),
    "small_both_back": in_table(SMALL, Kit(wheels="both", truth="pose"), back=True),
    "small_20_hz_long": in_table(SMALL, Kit(rate_hz=20.0, truth="position"), seconds=100.0),
    "small_100_hz": in_table(SMALL, Kit(rate_hz=100.0), seconds=30.0),
    "small_ms_described": in_table(SMALL, MOCAP, faults.scaled_time(1e3, "ms", first=1.7e12, decimals=1)),
    "small_jitter": in_table(SMALL, Kit(jitter_s=0.004, truth="pose")),
    "small_straight_only": in_table(SMALL, MOCAP, legs=_straight),
    "small_on_the_spot": in_table(SMALL, MOCAP, legs=_on_the_spot),
    "small_circle_gnss": in_table(SMALL, Kit(fixes="geodetic", fix_sigma_m=0.05), legs=_circle),
    "small_slip_5": in_table(SMALL, MOCAP, slip=0.05),
    "large_plain": in_table(LARGE, Kit(ticks=2048)),
    "large_gnss_half_metre": in_table(LARGE, GNSS, seconds=60.0),
    "large_gnss_2_m": in_table(
        LARGE, Kit(fixes="geodetic", fix_hz=5.0, fix_sigma_m=2.0, fix_correlation_s=8.0), seconds=60.0
    ),
    "large_rtk_lost": in_table(LARGE, RTK, faults.lost("fixes", 0.4, 9.0), seconds=60.0),
    "large_truth_lost": in_table(LARGE, MOCAP, faults.lost("truth", 0.5, 6.0)),
    "large_noisy_gyro": in_table(LARGE, Kit(gyro_noise_rad_s=0.02, truth="pose")),
    "large_biased_gyro": in_table(LARGE, Kit(gyro_bias_rad_s=0.01, gyro_gain=1.01, truth="pose")),
    "large_long_rest": in_table(LARGE, MOCAP, legs=_long_rest),
    "large_starts_in_motion": in_table(LARGE, MOCAP, skip_s=4.5),
    "large_pose_fixes": in_table(LARGE, Kit(fixes="pose", fix_hz=5.0, fix_sigma_m=0.01)),
    "large_truth_file": in_table(LARGE, Kit(truth="pose", truth_file=True), back=True),
    "four_plain": in_table(FOUR),
    "four_truth_back": in_table(FOUR, MOCAP, back=True),
    "four_speeds_gnss": in_table(FOUR, Kit(wheels="speed", fixes="geodetic", fix_sigma_m=0.03), back=True),
    "four_truth_geodetic": in_table(FOUR, Kit(truth="geodetic", truth_sigma_m=0.015)),
    "four_gnss_strong_noise": in_table(
        FOUR, Kit(fixes="position", fix_hz=10.0, fix_sigma_m=1.0), seconds=60.0
    ),
    "omni_plain_no_gyro": in_table(OMNI, Kit(gyro=False)),
    "omni_truth": in_table(OMNI, Kit(ticks=2000, truth="pose")),
    "omni_speeds_rpm": in_table(OMNI, Kit(wheels="speed", speed_unit="rpm", truth="pose")),
    "omni_coarse_gyro": in_table(OMNI, Kit(gyro_step_deg_s=0.24, truth="pose")),
    "car_plain": in_table(CAR, Kit(wheels="speed")),
    "car_gnss": in_table(
        CAR, Kit(wheels="speed", fixes="geodetic", fix_sigma_m=0.8, fix_correlation_s=4.0), seconds=70.0
    ),
    "car_back_truth": in_table(CAR, Kit(wheels="speed", truth="position"), back=True, seconds=60.0),
    "car_road_0_24": in_table(
        CAR,
        Kit(wheels="speed", gyro_step_deg_s=0.24, gyro_noise_rad_s=0.001),
        legs=_motorway(22.0),
        slip=0.01,
    ),
    "car_road_1_28": in_table(
        CAR,
        Kit(wheels="speed", gyro_step_deg_s=1.28, gyro_noise_rad_s=0.001),
        legs=_motorway(15.0),
        slip=0.01,
    ),
    "car_road_1_28_gnss": in_table(
        CAR,
        Kit(
            wheels="speed",
            gyro_step_deg_s=1.28,
            gyro_noise_rad_s=0.001,
            fixes="geodetic",
            fix_hz=1.0,
            fix_sigma_m=1.0,
            fix_correlation_s=5.0,
        ),
        legs=_motorway(18.0),
        slip=0.01,
    ),
    "can_small": in_can(SMALL),
    "can_car_ratio": in_can(CAR, CanKit(speeds=True, steering_ratio=15.0)),
    "can_savvycan": in_can(SMALL, change=_savvycan),
    "bag_odometry": in_bag(),
}

SOUND = [
    Case(name=name, group="sound", cause="None: the drive has no fault.", make=make)
    for name, make in DRIVES.items()
]
