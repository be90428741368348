"""A rest of the wheels against gyro, accelerometer and reported speeds; wheels that stay alone."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from controllers.control_loop import ControlLoop, StepOutput
from controllers.estimation.settings import FilterSettings
from controllers.operator import OperatorInput
from controllers.roles import DeviceRoles
from controllers.safety.supervisor import Mode
from controllers.settings import ControlSettings
from drivers.samples import AccelerationSample, RateSample, Sample, WheelSample
from tests.controllers.simulated import SKID

MS = 1_000_000
PERIOD_MS = 20
ROLES = DeviceRoles(wheels="wheels", gyro="imu", required={"wheels": 0.15, "imu": 0.15})
OBSERVER = ControlSettings.model_validate(
    {
        "rover": SKID.model_dump(),
        "limits": {"wheel_speed_rad_s": 10.0, "wheel_acceleration_rad_s2": 20.0},
        "filter": FilterSettings().model_dump(),
    }
)


def paused() -> ControlLoop:
    """Return a loop that commands the wheels to rest."""
    mission = {"type": "by_hand", "speed_m_s": 0.2, "yaw_rate_limit_rad_s": 0.5}
    loop = ControlLoop(ControlSettings.model_validate({**OBSERVER.model_dump(), "mission": mission}), ROLES)
    loop.operate(0, OperatorInput(is_paused=True))
    return loop


def drive(
    seconds: float,
    *,
    wheel_rad_s: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    gyro_rad_s: float | None = 0.0,
    shake_m_s2: float | None = None,
    reported_rad_s: float | None = None,
    loop: ControlLoop | None = None,
    from_ms: int = 0,
) -> Iterator[StepOutput]:
    """Yield what the loop computes of wheels at constant speeds beside other sensors."""
    loop, rng = loop or ControlLoop(OBSERVER, ROLES), np.random.default_rng(3)
    for i in range(round(seconds * 1000 / PERIOD_MS)):
        t_ns = (from_ms + i * PERIOD_MS) * MS
        samples: list[Sample] = [
            WheelSample(
                device="wheels",
                t_ns=t_ns,
                wheel=wheel,
                position_rad=speed * i * PERIOD_MS / 1000,
                speed_rad_s=reported_rad_s,
            )
            for wheel, speed in enumerate(wheel_rad_s)
        ]
        if gyro_rad_s is not None:
            samples.append(RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=gyro_rad_s))
        if shake_m_s2 is not None:
            x, y, z = (shake_m_s2 * rng.standard_normal(3)).tolist()
            samples.append(AccelerationSample(device="imu", t_ns=t_ns, x_m_s2=x, y_m_s2=y, z_m_s2=9.81 + z))
        yield loop.step(t_ns, samples)


def last(outputs: Iterator[StepOutput]) -> StepOutput:
    *_, end = outputs
    return end


def position_sd_m(output: StepOutput) -> float:
    return math.sqrt(output.estimate.covariance[0])


@pytest.mark.parametrize("shake_m_s2", [None, 0.02, 0.1])
def test_a_rest_that_all_confirm_is_certain(shake_m_s2: float | None) -> None:
    end = last(drive(3.0, shake_m_s2=shake_m_s2))
    assert end.suspicion == ""
    assert position_sd_m(end) < 1e-3


@pytest.mark.parametrize(
    ("gyro_rad_s", "shake_m_s2", "reported_rad_s", "words"),
    [
        (0.3, None, None, "gyro"),
        (0.0, 0.5, None, "accelerometer"),
        (0.0, None, 3.0, "reported speed"),
        (0.3, 0.5, 3.0, "gyro and accelerometer and reported speed"),
    ],
)
def test_whatever_reports_motion_contradicts_a_rest(
    gyro_rad_s: float, shake_m_s2: float | None, reported_rad_s: float | None, words: str
) -> None:
    loop = ControlLoop(OBSERVER, ROLES)
    last(drive(1.0, loop=loop, shake_m_s2=None if shake_m_s2 is None else 0.02, reported_rad_s=0.0))
    end = last(
        drive(
            3.0,
            loop=loop,
            from_ms=1000,
            gyro_rad_s=gyro_rad_s,
            shake_m_s2=shake_m_s2,
            reported_rad_s=reported_rad_s,
        )
    )
    assert (
        end.suspicion == f"the wheels are at rest, but motion is reported by {words}; the estimate is wider"
    )
    # At 10 rad/s and a radius of 0.1 m it may have driven 1 m each second, anything up to that alike.
    assert 1.5 < position_sd_m(end) < 4.0 / math.sqrt(3.0) + 0.1


def test_a_turn_of_the_gyro_is_not_dropped_while_the_wheels_report_a_rest() -> None:
    loop = ControlLoop(OBSERVER, ROLES)
    last(drive(1.0, loop=loop))
    end = last(drive(3.0, loop=loop, from_ms=1000, gyro_rad_s=0.4))
    assert end.estimate.yaw_rad == pytest.approx(1.2, abs=0.05)
    assert math.sqrt(end.estimate.covariance[5]) > 0.3  # or the gyro is wrong


def test_a_paused_rover_that_is_turned_as_both_gyro_and_accelerometer_say_has_turned() -> None:
    loop = paused()
    last(drive(2.0, loop=loop, shake_m_s2=0.02))
    end = last(drive(3.14, loop=loop, from_ms=2000, gyro_rad_s=0.5, shake_m_s2=1.0))
    sd_rad = math.sqrt(end.estimate.covariance[5])
    assert abs(end.estimate.yaw_rad - 1.57) < 2.0 * sd_rad
    assert end.estimate.yaw_rad == pytest.approx(1.57, abs=0.05)
    assert "gyro and accelerometer" in end.suspicion


def test_a_turn_of_a_paused_rover_that_only_the_gyro_reports_is_uncertain() -> None:
    loop = paused()
    last(drive(2.0, loop=loop, shake_m_s2=0.02))
    last(drive(1.0, loop=loop, from_ms=2000, gyro_rad_s=0.5, shake_m_s2=1.0))
    end = last(drive(2.0, loop=loop, from_ms=3000, gyro_rad_s=0.5, shake_m_s2=0.02))
    # The accelerometer confirmed 0.5 rad; another 1 rad may be an error of the gyro.
    assert abs(end.estimate.yaw_rad - 1.5) < 2.0 * math.sqrt(end.estimate.covariance[5])
    assert abs(end.estimate.yaw_rad - 0.5) < 2.0 * math.sqrt(end.estimate.covariance[5])


@pytest.mark.parametrize(
    ("rest_m_s2", "touch_m_s2", "gyro_rad_s", "touch_s"),
    [(None, None, 0.08, 0.3), (0.02, 0.02, 0.1, 0.36), (0.02, 1.0, 0.1, 0.26)],
)
def test_a_touch_does_not_end_a_pause(
    rest_m_s2: float | None, touch_m_s2: float | None, gyro_rad_s: float, touch_s: float
) -> None:
    loop, after_ms = paused(), 10_000 + round(1000 * touch_s)
    last(drive(10.0, loop=loop, shake_m_s2=rest_m_s2))
    last(drive(touch_s, loop=loop, from_ms=10_000, shake_m_s2=touch_m_s2, gyro_rad_s=gyro_rad_s))
    end = last(drive(3.0, loop=loop, from_ms=after_ms, shake_m_s2=rest_m_s2))
    assert end.mode is Mode.PAUSED, end.reason
    assert position_sd_m(end) < 1e-3
    error_rad = end.estimate.yaw_rad - gyro_rad_s * touch_s
    assert abs(error_rad) < 2.0 * math.sqrt(end.estimate.covariance[5])


def test_a_paused_rover_that_is_moved_for_longer_is_lost() -> None:
    loop = paused()
    last(drive(10.0, loop=loop, shake_m_s2=0.02))
    end = last(drive(1.0, loop=loop, from_ms=10_000, shake_m_s2=1.0, gyro_rad_s=0.3))
    assert position_sd_m(end) == pytest.approx(1.0 / math.sqrt(3.0), abs=0.05)
    assert last(drive(1.0, loop=loop, from_ms=11_000, shake_m_s2=0.02)).mode is Mode.EMERGENCY_STOP


def test_a_paused_rover_without_an_accelerometer_is_lost_only_while_something_reports_motion() -> None:
    loop = paused()
    last(drive(10.0, loop=loop, reported_rad_s=0.0))
    moved = last(drive(0.8, loop=loop, from_ms=10_000, reported_rad_s=3.0))
    end = last(drive(3.0, loop=loop, from_ms=10_800, reported_rad_s=0.0))
    # 0.8 s at 10 rad/s and a radius of 0.1 m.
    assert position_sd_m(moved) == pytest.approx(0.8 / math.sqrt(3.0), abs=0.02)
    assert position_sd_m(end) == pytest.approx(position_sd_m(moved), abs=0.02)


def test_without_an_accelerometer_a_contradicted_rest_stays_in_doubt_until_the_wheels_move() -> None:
    loop = ControlLoop(OBSERVER, ROLES)
    last(drive(1.0, loop=loop))
    turned = last(drive(2.0, loop=loop, from_ms=1000, gyro_rad_s=0.4))
    quiet = last(drive(2.0, loop=loop, from_ms=3000))
    assert position_sd_m(quiet) > position_sd_m(turned) + 0.5
    moving = last(drive(1.0, loop=loop, from_ms=5000, wheel_rad_s=(1.0, 1.0, 1.0, 1.0)))
    assert moving.suspicion == ""


def test_an_accelerometer_that_rests_ends_the_growth() -> None:
    loop = ControlLoop(OBSERVER, ROLES)
    last(drive(1.0, loop=loop, shake_m_s2=0.02))
    shaken = last(drive(2.0, loop=loop, from_ms=1000, shake_m_s2=0.5))
    quiet = last(drive(3.0, loop=loop, from_ms=3000, shake_m_s2=0.02))
    assert position_sd_m(quiet) == pytest.approx(position_sd_m(shaken), rel=0.25)


def test_an_acceleration_that_never_changes_is_no_measurement() -> None:
    end = last(drive(3.0, gyro_rad_s=0.4, shake_m_s2=0.0))
    assert "gyro" in end.suspicion
    assert end.estimate.yaw_rad != 0.0


def test_an_offset_of_the_gyro_at_a_shaking_start_is_learned_and_told() -> None:
    outputs = list(drive(3.0, gyro_rad_s=0.15, shake_m_s2=0.02))
    assert any(output.suspicion for output in outputs)
    assert outputs[-1].estimate.gyro_bias_rad_s == pytest.approx(0.15, abs=0.01)
    assert abs(outputs[-1].estimate.yaw_rad) < 2.0 * math.sqrt(outputs[-1].estimate.covariance[5])


def test_a_wheel_that_stays_while_the_gyro_reads_no_turn_is_in_doubt() -> None:
    wheels = (0.0, 3.0, 0.0, 3.0)
    end = last(drive(3.0, wheel_rad_s=wheels))
    what = "wheel 0, 2 does not turn, but the gyro contradicts the turn by the others"
    assert end.suspicion == f"{what}; the estimate is wider"
    # The rover turns by (0.3 - 0) / 0.4 rad/s around wheels that really stay; the gyro then agrees.
    turn_rad_s = last(drive(0.5, wheel_rad_s=wheels, gyro_rad_s=None)).odometry.yaw_rad / 0.48
    agreed = last(drive(3.0, wheel_rad_s=wheels, gyro_rad_s=turn_rad_s))
    assert agreed.suspicion == ""
    assert position_sd_m(end) > position_sd_m(agreed)


def test_wheels_that_send_only_speeds_drive_the_estimate() -> None:
    loop = ControlLoop(OBSERVER, ROLES)
    for i in range(100):
        t_ns = i * PERIOD_MS * MS
        samples: list[Sample] = [
            WheelSample(device="wheels", t_ns=t_ns, wheel=wheel, speed_rad_s=2.0) for wheel in range(4)
        ]
        output = loop.step(t_ns, [*samples, RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=0.0)])
    assert output.estimate.x_m == pytest.approx(0.1 * 2.0 * 99 * 0.02, rel=1e-6)
    assert position_sd_m(output) > 0.01


def test_a_position_that_stayed_before_a_jump_loses_all_of_that_time() -> None:
    loop = ControlLoop(OBSERVER, ROLES)
    last(drive(1.0, loop=loop, wheel_rad_s=(4.0,) * 4, gyro_rad_s=None))
    held = 4.0 * 0.98
    for i in range(60):
        t_ns = (1000 + i * PERIOD_MS) * MS
        position = held if i < 50 else held + 4.0 * i * PERIOD_MS / 1000
        output = loop.step(
            t_ns,
            [WheelSample(device="wheels", t_ns=t_ns, wheel=w, position_rad=position) for w in range(4)],
        )
    assert output.odometry_rebases == 1
    assert position_sd_m(output) > 4.0 * 0.1 / math.sqrt(3.0)
