"""A gyro that was wrong has misled the slip compensation, too: its way is doubted, once."""

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from controllers.estimation.odometry import BodyIncrement
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_states import SlipEstimate
from controllers.estimator import Estimator
from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import SkidSteerKinematics
from controllers.roles import DeviceRoles
from drivers.clock import nanoseconds
from drivers.samples import Sample, WheelSample
from tests.controllers.simulated import SKID

QUIET = FilterSettings(position_noise_m_sqrt_m=1e-4, unsure_position_noise_m_sqrt_m=1e-4)
SPEED_RAD_S = 2.0


class HalfOfTheWay:
    """A compensator that takes half of the way for slip."""

    states = None

    def __init__(self, share: float) -> None:
        self._share = share

    def feed(self, sample: Sample, t_ns: int) -> None:
        """Take nothing."""

    def compensate(
        self, increment: BodyIncrement, set_speed_rad_s: Sequence[float], gyro_rate_rad_s: float | None
    ) -> BodyIncrement:
        """Remove its share."""
        kept = 1.0 - self._share
        return replace(increment, x_m=kept * increment.x_m, y_m=kept * increment.y_m)

    def correct(self, estimate: SlipEstimate) -> None:
        """Correct nothing."""

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return rest."""
        return (0.0, 0.0, 0.0)

    def report(self) -> None:
        """Return nothing."""


def driven(share: float, duration_s: float) -> tuple[Estimator, float]:
    """Return the estimator of a rover that has driven straight ahead, and how far its wheels have rolled."""
    roles = DeviceRoles(wheels="wheels", required={}, gyro="imu")
    estimator = Estimator(SkidSteerKinematics(SKID), QUIET, 20.0, roles, HalfOfTheWay(share))
    for cycle in range(round(50 * duration_s) + 1):
        t_ns = nanoseconds(1.0 + 0.02 * cycle)
        for wheel in range(4):
            angle_rad = SPEED_RAD_S * 0.02 * cycle
            estimator.take(WheelSample(device="wheels", t_ns=t_ns, wheel=wheel, position_rad=angle_rad), t_ns)
        estimator.advance(t_ns, (SPEED_RAD_S,) * 4)
    return estimator, SPEED_RAD_S * SKID.wheel_radius_m * duration_s


def x_sd_m(estimator: Estimator) -> float:
    return math.sqrt(estimator.estimate(0).covariance[0])


def test_a_wrong_gyro_makes_the_compensated_way_uncertain_once() -> None:
    estimator, rolled_m = driven(0.5, 0.5)
    assert x_sd_m(estimator) < 0.01 * rolled_m
    estimator.doubt((), 0.1)
    # Any share of what was removed is equally likely; the memory has faded a little.
    sd_m = x_sd_m(estimator)
    assert sd_m == pytest.approx(0.5 * rolled_m / math.sqrt(3.0), rel=0.15)
    estimator.doubt((), 0.1)
    assert x_sd_m(estimator) == pytest.approx(sd_m, rel=1e-6)


@pytest.mark.parametrize(("share", "yaw_rad"), [(0.5, 0.0), (0.0, 0.1)])
def test_without_a_doubt_of_the_gyro_or_compensation_nothing_is_added(share: float, yaw_rad: float) -> None:
    estimator, rolled_m = driven(share, 0.5)
    estimator.doubt((), yaw_rad)
    assert x_sd_m(estimator) < 0.01 * rolled_m
