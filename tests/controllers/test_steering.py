"""Steering angles in the whole step: those of a rover at rest, and reports that end or are wrong."""

import math
from collections.abc import Callable

import pytest

from controllers.control_loop import ControlLoop, StepOutput
from controllers.roles import DeviceRoles
from controllers.safety import Mode
from controllers.settings import ControlSettings
from drivers.samples import BumperSample, RateSample, Sample, WheelSample
from tests.controllers.simulated import LIMITS, PERIOD_NS, START_NS

PERIOD_S = 1e-9 * PERIOD_NS
RATE_RAD_S = math.radians(90.0)
STEERING = {"low_deg": -100.0, "high_deg": 100.0, "rate_deg_s": 90.0}
WHEELS = [
    {"x_m": x_m, "y_m": y_m, "radius_m": 0.1, "steering": STEERING}
    for x_m in (0.3, -0.3)
    for y_m in (0.2, -0.2)
]
ROLES = DeviceRoles(wheels="wheels", gyro="gyro", required={"wheels": 0.15, "gyro": 0.15})
Reports = Callable[[float, int, float], float | None]
"""Reported steering angle: time since the start, wheel, true angle."""


class Rover:
    """Four steered wheels that follow their setpoints, on a sideways mission at 0.2 m/s."""

    def __init__(self, reports: Reports, angle_rad: float = 0.0) -> None:
        self.loop = ControlLoop(
            ControlSettings.model_validate(
                {
                    "rover": {"kinematics": "wheels", "wheels": WHEELS},
                    "limits": LIMITS.model_dump(),
                    "mission": {"type": "waypoints", "points": [[0.02, 3.0]], "speed_m_s": 0.2},
                }
            ),
            ROLES,
        )
        self.reports = reports
        self.angles_rad = [angle_rad] * 4
        self.turned_rad = [0.0] * 4
        self.cycles = 0

    def cycle(self, *samples: Sample) -> StepOutput:
        """Run one cycle of 20 ms, and the wheels after it."""
        since_s, t_ns = self.cycles * PERIOD_S, START_NS + self.cycles * PERIOD_NS
        wheels = [
            WheelSample(
                device="wheels",
                t_ns=t_ns,
                wheel=wheel,
                position_rad=self.turned_rad[wheel],
                steering_rad=self.reports(since_s, wheel, self.angles_rad[wheel]),
            )
            for wheel in range(4)
        ]
        gyro = RateSample(device="gyro", t_ns=t_ns, rate_z_rad_s=1e-4 * (self.cycles % 3))
        output = self.loop.step(t_ns, [*wheels, gyro, *samples])
        self.cycles += 1
        most_rad = RATE_RAD_S * PERIOD_S
        for wheel, target in enumerate(output.command.steering_rad or ()):
            self.angles_rad[wheel] += min(max(target - self.angles_rad[wheel], -most_rad), most_rad)
            self.turned_rad[wheel] += output.command.speed_rad_s[wheel] * PERIOD_S
        return output

    def drive(self, until_s: float) -> StepOutput:
        """Return the output at this time since the start."""
        while self.cycles * PERIOD_S < until_s:
            output = self.cycle()
        return output


def honest(since_s: float, wheel: int, angle_rad: float) -> float:
    return angle_rad


def silent(since_s: float, wheel: int, angle_rad: float) -> None:
    return None


def test_a_wheel_whose_reports_end_stops_the_rover_and_is_named() -> None:
    rover = Rover(lambda since_s, wheel, angle: None if wheel == 2 and since_s >= 3.0 else angle)
    assert rover.drive(3.1).mode is Mode.RUNNING
    output = rover.drive(3.2)
    assert output.mode is Mode.SAFE_STOP
    assert output.reason == "wheel 2: reports no steering angle for 0.15 s"
    assert not any(output.command.speed_rad_s)
    assert rover.drive(6.0).mode is Mode.SAFE_STOP
    rover.reports = honest
    assert rover.drive(7.0).mode is Mode.RUNNING


def test_a_rover_without_reports_is_not_stopped() -> None:
    assert Rover(silent).drive(4.0).mode is Mode.RUNNING


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_an_angle_that_is_not_finite_is_no_report(wrong: float) -> None:
    rover = Rover(lambda since_s, wheel, angle: wrong if wheel == 0 and since_s == 3.0 else angle)
    output = rover.drive(4.0)
    assert output.mode is Mode.RUNNING
    rover.reports = lambda since_s, wheel, angle: wrong if wheel == 0 else angle
    assert rover.drive(4.3).reason == "wheel 0: reports no steering angle for 0.15 s"


@pytest.mark.parametrize("reports", [honest, silent])
def test_the_wheels_do_not_go_on_steering_after_a_stop(reports: Reports) -> None:
    rover = Rover(reports)
    assert rover.drive(1.3).mode is Mode.RUNNING
    at_rad = rover.angles_rad[0]
    assert 0.1 < at_rad < 1.0
    output = rover.cycle(BumperSample(device="wheels", t_ns=START_NS, pressed=True))
    assert output.mode is Mode.EMERGENCY_STOP
    assert output.command.steering_rad == pytest.approx((at_rad,) * 4)
    assert rover.drive(3.0).command.steering_rad == output.command.steering_rad


def test_a_rover_that_settles_keeps_the_angles_that_its_wheels_have() -> None:
    rover = Rover(honest, 0.3)
    assert rover.cycle().command.steering_rad == pytest.approx((0.3,) * 4)
    assert rover.drive(0.9).mode is Mode.SETTLING
    assert rover.angles_rad == pytest.approx([0.3] * 4)


def test_angles_that_are_held_do_not_creep_where_the_reports_are_off() -> None:
    rover = Rover(lambda since_s, wheel, angle: angle + 0.02)
    assert rover.drive(0.9).mode is Mode.SETTLING
    assert rover.angles_rad == pytest.approx([0.02] * 4)


def test_an_angle_beyond_the_limits_is_held_at_the_limit() -> None:
    output = Rover(lambda since_s, wheel, angle: 1e9).cycle()
    assert output.command.steering_rad == pytest.approx((math.radians(100.0),) * 4)
