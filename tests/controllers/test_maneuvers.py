"""Backing out and the turn to find out: in the loop, off by default, once, and under the stop rules."""

import math
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.safety.healthy_missions import equipped
from benchmarks.safety.missions import Driven, drive, robotino, with_drooping_drives
from controllers.fault import Cause
from controllers.maneuvers import BackOut
from controllers.motion.kinematics import make_kinematics
from controllers.motion.planar import Pose
from controllers.motion.rover_geometry import OmniRoverSettings, SkidSteerRoverSettings
from controllers.safety import Mode
from drivers.samples import BumperSample, RateSample, Sample
from rover_hil.config import Config
from tests.nature.omni_contact import Floor
from tests.nature.omni_trapped import TrappedOmni

SEED, AT_M = 102, 0.3
FLOOR = Floor.uniform("exponential", 0.006, (0.3, 4.0, 0.02, 0.06))
BACKS_OUT, TURNS = "rover: backs out along", "rover: turns by up to 10 deg"


def with_safety(config: Config, **changes: object) -> Config:
    return config.model_copy(update={"safety": config.safety.model_copy(update=changes)})


def drive_at_a_wall(back_out_m: float, *, bumper_at_s: float = math.inf) -> Driven:
    """Drive at a wall that lies across the path, with fixes at 0.5 Hz."""

    def press(t_s: float, sample: Sample) -> Sample:
        if isinstance(sample, BumperSample) and t_s >= bumper_at_s:
            return BumperSample(device=sample.device, t_ns=sample.t_ns, pressed=True)
        return sample

    config = with_drooping_drives(equipped(robotino(SEED), "encoders+fixes"))
    return drive(
        with_safety(config, back_out_m=back_out_m),
        press,
        limit_s=60.0,
        make_plant=lambda start_ns: TrappedOmni(FLOOR, start_ns, trap="wall", at_m=AT_M),
    )


def backing(driven: Driven) -> list[int]:
    """Return the cycles in which the rover moves and says that it backs out."""
    return [
        index
        for index, moment in enumerate(driven.moments)
        if moment.output.mode is Mode.RUNNING and moment.output.suspicion.startswith(BACKS_OUT)
    ]


@pytest.mark.slow
def test_a_rover_at_a_wall_backs_out_once_along_its_path_and_the_second_stop_is_final() -> None:
    driven = drive_at_a_wall(0.3)
    cycles = backing(driven)
    truths = np.array([driven.moments[index].truth for index in cycles])
    # By the wheels 0.3 m; it slips.
    assert 0.15 < truths[0, 0] - truths[-1, 0] < 0.3
    assert np.abs(truths[:, 1]).max() < 0.02
    assert np.diff(cycles).max() == 1
    # It is said before the rover moves.
    before = driven.moments[cycles[0] - 5].output
    assert (before.mode, before.suspicion) == (Mode.SAFE_STOP, driven.moments[cycles[0]].output.suspicion)
    assert driven.mode is Mode.EMERGENCY_STOP
    assert "stuck" in driven.moments[-1].output.reason


@pytest.mark.slow
def test_by_default_an_entrapped_rover_stays_where_it_is() -> None:
    driven = drive_at_a_wall(0.0)
    assert not backing(driven)
    assert driven.mode is Mode.EMERGENCY_STOP


@pytest.mark.slow
def test_the_bumper_ends_backing_out() -> None:
    driven = drive_at_a_wall(0.3)
    begin_s = driven.moments[backing(driven)[0]].t_s
    pressed = drive_at_a_wall(0.3, bumper_at_s=begin_s + 0.5)
    assert pressed.mode is Mode.EMERGENCY_STOP
    assert pressed.moments[backing(pressed)[-1]].t_s < begin_s + 0.6


MOBILE = make_kinematics(OmniRoverSettings(kinematics="omni3", wheel_radius_m=0.04, base_radius_m=0.125))
SKID_STEER = make_kinematics(
    SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.05, track_m=0.3)
)


def on_a_line(back_out: BackOut, length_m: float) -> None:
    for step in range(round(length_m / 0.01) + 1):
        assert back_out.guide(Pose(x_m=0.01 * step, y_m=0.0, yaw_rad=0.0), 0.01) is None


@pytest.mark.parametrize("kinematics", [MOBILE, SKID_STEER])
def test_the_way_back_begins_where_a_fix_has_put_the_rover_and_ends_after_the_length(
    kinematics: object,
) -> None:
    back_out = BackOut(0.3, 0.1, kinematics, 2.0)  # type: ignore[arg-type]
    on_a_line(back_out, 1.0)
    back_out.stop(Cause.STUCK)
    x_m, found = 0.6, []
    for _ in range(60):
        guidance = back_out.guide(Pose(x_m=x_m, y_m=0.0, yaw_rad=0.0), 0.01)
        if guidance is None:
            break
        assert guidance.velocity_x_m_s == pytest.approx(-0.1)
        assert guidance.velocity_y_m_s == pytest.approx(0.0, abs=1e-9)
        assert guidance.yaw_rate_rad_s == pytest.approx(0.0, abs=1e-9)
        x_m -= 0.01
        found.append(x_m)
    assert x_m == pytest.approx(0.3, abs=0.011)
    back_out.stop(Cause.STUCK)
    assert back_out.announcement == ""


def test_wheels_that_turn_in_vain_end_it_too() -> None:
    back_out = BackOut(0.3, 0.1, MOBILE, 2.0)
    on_a_line(back_out, 1.0)
    back_out.stop(Cause.STUCK)
    stuck = Pose(x_m=1.0, y_m=0.0, yaw_rad=0.0)
    driven = [back_out.guide(stuck, 0.01) for _ in range(40)]
    assert sum(guidance is not None for guidance in driven) == pytest.approx(30, abs=1)


@pytest.mark.parametrize("cause", [Cause.BUMPER, Cause.GYRO_DOES_NOT_FOLLOW])
def test_other_stops_are_no_cause(cause: Cause) -> None:
    back_out = BackOut(0.3, 0.1, MOBILE, 2.0)
    on_a_line(back_out, 1.0)
    back_out.stop(cause)
    assert back_out.announcement == ""
    on_a_line(back_out, 0.1)


def drive_with_a_dead_gyro(*, is_wanted: bool, dead_s: tuple[float, float] = (5.0, math.inf)) -> Driven:
    rng = np.random.default_rng(SEED)

    def falsify(t_s: float, sample: Sample) -> Sample:
        if isinstance(sample, RateSample) and dead_s[0] <= t_s < dead_s[1]:
            return RateSample(device=sample.device, t_ns=sample.t_ns, rate_z_rad_s=0.002 * rng.normal())
        return sample

    config = robotino(SEED)
    return drive(with_safety(config, turn_to_find_out=is_wanted), falsify)


def turning(driven: Driven) -> list[int]:
    return [index for index, each in enumerate(driven.moments) if each.output.suspicion.startswith(TURNS)]


@pytest.mark.slow
def test_a_turn_to_find_out_is_announced_small_and_inside_the_mission() -> None:
    driven = drive_with_a_dead_gyro(is_wanted=True)
    cycles = turning(driven)
    assert cycles
    assert not any(driven.moments[cycles[20]].output.command.speed_rad_s)  # it brakes before
    yaws_rad = np.unwrap([driven.moments[index].truth[2] for index in cycles[25:]])
    assert math.radians(4.0) < np.abs(yaws_rad - yaws_rad[0]).max() < math.radians(10.5)
    assert {driven.moments[index].output.mode for index in cycles} == {Mode.RUNNING}
    assert np.diff(cycles).max() == 1  # nothing was found out: it is not repeated
    travel_m = sum(
        math.dist(driven.moments[a].truth[:2], driven.moments[b].truth[:2]) for a, b in pairwise(cycles)
    )
    assert travel_m < 0.05


@pytest.mark.slow
def test_a_gyro_that_measures_the_turn_is_no_longer_doubted() -> None:
    driven = drive_with_a_dead_gyro(is_wanted=True, dead_s=(5.0, 7.2))
    cycles = turning(driven)
    assert cycles
    later = driven.moments[cycles[-1] + 50 :]
    assert not any("yaw rate follows" in moment.output.suspicion for moment in later)


@pytest.mark.slow
def test_by_default_the_rover_does_not_turn() -> None:
    assert not turning(drive_with_a_dead_gyro(is_wanted=False))
