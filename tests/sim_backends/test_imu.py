"""The simulated WitMotion sensor: statistics of its errors, its mounting, its line."""

import math
import struct
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.angles import wrap_rad
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.driver import DeviceState
from drivers.errors import ConfigError
from drivers.samples import AccelerationSample, AttitudeSample, HeadingSample, RateSample, Sample
from drivers.units import STANDARD_GRAVITY_M_S2
from drivers.witmotion.codec import ANGLE_STEP_RAD, RATE_STEP_RAD_S
from drivers.witmotion.settings import WitMotionSettings
from sim_backends.devices.witmotion import ImuEmulatorSettings, make_emulator
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.plant import Truth
from sim_backends.world.world import World
from tests.sim_backends.turning_plant import TurningPlant, decode, run

DEVICE = WitMotionSettings(port="simulated")
PERFECT = ImuEmulatorSettings(
    frames=("acceleration", "rate", "angle"),
    gyro_bias_deg_s=0,
    gyro_walk_deg_s=0,
    gyro_noise_deg_s=0,
    acceleration_noise_m_s2=0,
    angle_lag_s=0,
    angle_noise_deg=0,
    yaw_bias_deg=0,
)


def samples_of(
    settings: ImuEmulatorSettings,
    plant: TurningPlant,
    duration_s: float,
    seed: int = 1,
    device_settings: WitMotionSettings = DEVICE,
) -> list[Sample]:
    rng = np.random.default_rng(seed)
    device = make_emulator("imu", device_settings, settings, plant, rng, start_ns=0)
    return decode(run(plant, device, nanoseconds(duration_s)), device_settings.make_codec("imu"))


def test_the_frame_of_a_bluetooth_model_tells_the_same() -> None:
    plant = TurningPlant(yaw_rad=3.0, yaw_rate_rad_s=0.5, roll_rad=0.2, pitch_rad=-0.1, speed_m_s=0.8)
    separate = samples_of(PERFECT, plant, 0.05)
    plant = TurningPlant(yaw_rad=3.0, yaw_rate_rad_s=0.5, roll_rad=0.2, pitch_rad=-0.1, speed_m_s=0.8)
    combined = samples_of(PERFECT.model_copy(update={"frames": ("combined",)}), plant, 0.05)
    assert len(separate) == len(combined) == 8
    for one, other in zip(separate, combined, strict=True):
        assert replace(one, t_ns=0) == replace(other, t_ns=0)


def rates_z_rad_s(samples: Sequence[Sample]) -> NDArray[np.float64]:
    return np.array([sample.rate_z_rad_s for sample in samples if isinstance(sample, RateSample)])


@pytest.mark.parametrize("mounting_yaw_deg", [0.0, -90.0, 37.0])
@pytest.mark.parametrize("yaw_zero_deg", [0.0, 90.0])
@pytest.mark.parametrize("tilt_deg", [(0.0, 0.0), (180.0, 0.0), (-90.0, 3.0), (2.0, -85.0)])
def test_perfect_sensor_tells_the_truth_however_mounted(
    mounting_yaw_deg: float, yaw_zero_deg: float, tilt_deg: tuple[float, float]
) -> None:
    device = WitMotionSettings(
        port="simulated",
        mounting_yaw_deg=mounting_yaw_deg,
        mounting_roll_deg=tilt_deg[0],
        mounting_pitch_deg=tilt_deg[1],
        yaw_zero_deg=yaw_zero_deg,
    )
    plant = TurningPlant(yaw_rad=3.0, yaw_rate_rad_s=0.5, roll_rad=0.2, pitch_rad=-0.1, speed_m_s=0.8)
    acceleration, rate, attitude, heading = samples_of(PERFECT, plant, 0.03, device_settings=device)
    assert isinstance(acceleration, AccelerationSample)
    assert isinstance(rate, RateSample)
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    g = STANDARD_GRAVITY_M_S2
    assert (acceleration.x_m_s2, acceleration.y_m_s2, acceleration.z_m_s2) == pytest.approx(
        (
            g * math.sin(0.1),  # nose up: the ground pushes the sensor forward
            g * math.cos(0.1) * math.sin(0.2) + 0.5 * 0.8,  # left side up, and turning left
            g * math.cos(0.1) * math.cos(0.2),
        ),
        abs=0.01,
    )
    across = 0.5 * math.sin(0.1), 0.5 * math.cos(0.1) * math.sin(0.2)  # it turns about the vertical
    assert (rate.rate_x_rad_s, rate.rate_y_rad_s) == pytest.approx(across, abs=RATE_STEP_RAD_S)
    assert rate.rate_z_rad_s == pytest.approx(0.5, abs=RATE_STEP_RAD_S)
    # Near an upright x axis the steps of roll and yaw grow by 1 / cos(pitch).
    step = 2 * ANGLE_STEP_RAD * (20.0 if abs(tilt_deg[1]) > 80.0 else 1.0)
    assert attitude.roll_rad == pytest.approx(0.2, abs=step)
    assert attitude.pitch_rad == pytest.approx(-0.1, abs=step)
    assert heading.heading_rad == pytest.approx(3.0 + 0.5 * 0.02, abs=step)
    assert heading.t_ns == nanoseconds(0.02) + nanoseconds(3 * 110 / 115_200)


class SlopePlant(TurningPlant):
    """Turns on a slope of 12 deg, uphill along the x axis of the world."""

    def truth(self) -> Truth:
        flat, incline_rad = super().truth(), math.radians(12.0)
        pitch_rad = -math.atan(math.tan(incline_rad) * math.cos(flat.yaw_rad))
        roll_rad = -math.asin(math.sin(incline_rad) * math.sin(flat.yaw_rad))
        return replace(flat, roll_rad=roll_rad, pitch_rad=pitch_rad)


def test_a_rover_that_turns_on_a_slope_rotates_about_one_axis() -> None:
    settings = PERFECT.model_copy(update={"frames": ("rate",)})
    rates = [
        each
        for each in samples_of(settings, SlopePlant(yaw_rate_rad_s=0.5), 12.0)
        if isinstance(each, RateSample)
    ]
    assert len(rates) > 590
    greatest = max(max(abs(each.rate_x_rad_s or 0.0), abs(each.rate_y_rad_s or 0.0)) for each in rates)
    assert greatest < 2.0 * RATE_STEP_RAD_S


def test_gyro_bias_and_noise_have_the_set_size() -> None:
    settings = PERFECT.model_copy(
        update={"frames": ("rate",), "gyro_bias_deg_s": 0.5, "gyro_noise_deg_s": 0.3}
    )
    samples = samples_of(settings, TurningPlant(yaw_rate_rad_s=0.2), 100.0)
    rates_rad_s = np.array(
        [
            (sample.rate_x_rad_s, sample.rate_y_rad_s, sample.rate_z_rad_s)
            for sample in samples
            if isinstance(sample, RateSample)
        ],
        dtype=np.float64,
    )
    error_deg_s = np.degrees(rates_rad_s - [0.0, 0.0, 0.2])
    count = len(error_deg_s)
    assert count > 4990
    assert error_deg_s.mean(axis=0) == pytest.approx([0.5] * 3, abs=4 * 0.3 / math.sqrt(count))
    assert error_deg_s.std(axis=0) == pytest.approx([0.3] * 3, abs=4 * 0.3 / math.sqrt(2 * count))
    words = rates_rad_s / RATE_STEP_RAD_S
    assert np.abs(words - np.round(words)).max() < 1e-6


def test_gyro_bias_walks_with_the_root_of_time() -> None:
    settings = PERFECT.model_copy(update={"frames": ("rate",), "gyro_walk_deg_s": 2.0})
    walks = np.degrees(
        [rates_z_rad_s(samples_of(settings, TurningPlant(), 4.01, seed)) for seed in range(300)]
    )
    for duration_s in (1.0, 4.0):
        spread_deg_s = walks[:, round(50 * duration_s) - 1].std()
        assert spread_deg_s == pytest.approx(2.0 * math.sqrt(duration_s), rel=4 / math.sqrt(2 * 300))


def test_yaw_lags_and_is_biased() -> None:
    settings = PERFECT.model_copy(update={"frames": ("angle",), "angle_lag_s": 0.2, "yaw_bias_deg": 3.0})
    plant = TurningPlant(yaw_rad=3.0, yaw_rate_rad_s=0.8)
    headings = [
        sample.heading_rad
        for sample in samples_of(settings, plant, 10.0)
        if isinstance(sample, HeadingSample)
    ]
    for number in (200, 300, 400):  # across the seam at pi
        error_rad = wrap_rad(headings[number - 1] - plant.yaw_at(nanoseconds(0.02 * number)))
        expected_rad = math.radians(3.0) - math.atan(0.8 * 0.2)
        assert error_rad == pytest.approx(expected_rad, abs=2 * ANGLE_STEP_RAD + 1e-4)


def test_angle_and_acceleration_noise_have_the_set_size() -> None:
    settings = PERFECT.model_copy(
        update={
            "frames": ("acceleration", "angle"),
            "angle_noise_deg": 0.4,
            "acceleration_noise_m_s2": 0.2,
        }
    )
    samples = samples_of(settings, TurningPlant(), 60.0)
    heading = np.degrees([sample.heading_rad for sample in samples if isinstance(sample, HeadingSample)])
    roll = np.degrees([sample.roll_rad or 0.0 for sample in samples if isinstance(sample, AttitudeSample)])
    z = np.array([sample.z_m_s2 for sample in samples if isinstance(sample, AccelerationSample)])
    tolerance = 4 / math.sqrt(2 * len(heading))
    assert len(heading) > 2990
    assert heading.std() == pytest.approx(0.4, rel=tolerance)
    assert roll.std() == pytest.approx(0.4, rel=tolerance)
    assert z.std() == pytest.approx(0.2, rel=tolerance)
    assert abs(np.corrcoef(heading, roll)[0, 1]) < 4 / math.sqrt(len(heading))


def test_default_frames_are_rate_and_angle() -> None:
    kinds = [type(sample) for sample in samples_of(ImuEmulatorSettings(), TurningPlant(), 0.03)]
    assert kinds == [RateSample, AttitudeSample, HeadingSample]


def test_same_seed_same_bytes() -> None:
    runs = [samples_of(ImuEmulatorSettings(), TurningPlant(), 2.0, seed) for seed in (5, 5, 6)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_line_that_is_too_slow_is_refused() -> None:
    factory_fresh = WitMotionSettings(port="simulated", baud_rate=9600)
    with pytest.raises(ConfigError, match="needs 11000 bit/s"):
        make_emulator(
            "imu", factory_fresh, ImuEmulatorSettings(), TurningPlant(), np.random.default_rng(1), start_ns=0
        )


def test_driver_streams_from_it_in_lockstep() -> None:
    clock, plant = VirtualClock(), TurningPlant()
    rng = np.random.default_rng(1)
    device = make_emulator("imu", DEVICE, ImuEmulatorSettings(), plant, rng, clock.now_ns())
    world = World(plant, {"imu": device})
    with DEVICE.make_driver("imu", LoopbackLink(world, device, clock), clock) as driver:
        for _ in range(150):
            clock.sleep_until(clock.now_ns() + 20_000_000)
            driver.poll()
        health = driver.health()
        assert health.state is DeviceState.STREAMING
        assert health.rate_hz == pytest.approx(50.0, abs=1.0)
        assert not health.rejected


class _Driven(TurningPlant):
    """Two motors with a constant current."""

    wheel_count = 2

    def truth(self) -> Truth:
        return replace(super().truth(), motor_current_a=(2.0, -1.0))


def test_motor_currents_add_their_field_to_the_magnetic_frame() -> None:
    def words(plant: TurningPlant, **changes: object) -> NDArray[np.float64]:
        settings = ImuEmulatorSettings(frames=("magnetic",), magnetic_noise_counts=0).model_copy(
            update=changes
        )
        device = make_emulator("imu", DEVICE, settings, plant, np.random.default_rng(1), start_ns=0)
        (first, *_) = run(plant, device, nanoseconds(0.05))
        return np.array(struct.unpack("<hhh", first.payload[2:8]), np.float64)

    rows = ((10.0, -20.0, 30.0), (5.0, 6.0, 0.0))
    added = words(_Driven(yaw_rad=0.7), motor_field_counts_per_a=rows) - words(_Driven(yaw_rad=0.7))
    assert added == pytest.approx([15.0, -46.0, 60.0], abs=1.0)
    with pytest.raises(ConfigError, match="motor_field_counts_per_a of 2 motors, the rover has 0"):
        words(TurningPlant(), motor_field_counts_per_a=rows)


class StartingPlant(TurningPlant):
    """Turns faster and faster from the start on."""

    def truth(self) -> Truth:
        return replace(super().truth(), yaw_rate_rad_s=0.5 * seconds(super().truth().t_ns))


@pytest.mark.parametrize("delay_s", [0.02, 0.05, 0.113])
def test_rates_are_late_by_their_delay(delay_s: float) -> None:
    at_once = rates_z_rad_s(samples_of(PERFECT, StartingPlant(), 1.0))
    late = rates_z_rad_s(
        samples_of(PERFECT.model_copy(update={"rate_delay_s": delay_s}), StartingPlant(), 1.0)
    )
    expected = np.maximum(at_once - 0.5 * delay_s, 0.0)
    first = math.ceil(delay_s * PERFECT.rate_hz) + 1
    assert late[first:] == pytest.approx(expected[first:], abs=1.5 * RATE_STEP_RAD_S)
    assert late[0] == 0.0
