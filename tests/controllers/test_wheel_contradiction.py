"""Redundant wheels that contradict each other are reported, and widen the estimate."""

import pytest

from controllers.estimation.wheels.contradiction import ContradictionReport, WheelContradiction
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import RoverSettings, SkidSteerRoverSettings, WheelsRoverSettings

SKID = {"x_m": 0.0, "y_m": 0.0, "radius_m": 0.1}
FOUR = WheelsRoverSettings.model_validate(
    {
        "kinematics": "wheels",
        "wheels": [{**SKID, "x_m": x, "y_m": y} for x in (0.2, -0.2) for y in (0.2, -0.2)],
    }
)
PERIOD_S = 0.02


def after(
    speeds: tuple[float, ...], duration_s: float, rover: RoverSettings = FOUR
) -> ContradictionReport | None:
    monitor = WheelContradiction(make_kinematics(rover))
    for _ in range(round(duration_s / PERIOD_S)):
        turned = tuple(speed * PERIOD_S for speed in speeds)
        monitor.add(BodyIncrement(x_m=0.0, y_m=0.0, turn_rad=0.0, duration_s=PERIOD_S, turned_rad=turned))
    return monitor.report


@pytest.mark.parametrize("speeds", [(0.0,) * 4, (2.0,) * 4, (-1.0, 1.0, -1.0, 1.0), (2.0, 2.0, 2.05, 1.95)])
def test_wheels_that_agree_are_no_evidence(speeds: tuple[float, ...]) -> None:
    report = after(speeds, 2.0)
    assert report is not None
    assert report.scaled < 0.3
    assert report.wheel is None


def test_a_wheel_that_spins_is_named() -> None:
    report = after((2.0, 2.0, 2.0, 5.0), 2.0)
    assert report is not None
    assert report.scaled > 1.5
    # Front and rear right contradict each other equally: least squares cannot tell which of two is wrong.
    assert report.wheel in (1, 3)
    assert report.rolling_m[3] == pytest.approx(-report.rolling_m[1])
    assert report.rolling_m[3] > 0.0


def test_it_is_forgotten_when_the_wheels_agree_again() -> None:
    monitor = WheelContradiction(make_kinematics(FOUR))
    for speeds in [(2.0, 2.0, 2.0, 5.0)] * 50 + [(2.0,) * 4] * 100:
        turned = tuple(speed * PERIOD_S for speed in speeds)
        monitor.add(BodyIncrement(x_m=0.0, y_m=0.0, turn_rad=0.0, duration_s=PERIOD_S, turned_rad=turned))
    assert monitor.report is not None
    assert monitor.report.scaled < 0.3


def test_wheels_of_the_shipped_kinds_are_not_compared() -> None:
    rover = SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.1, track_m=0.4)
    assert after((2.0, 2.0, 2.0, 5.0), 1.0, rover) is None
