"""A gyro that was wrong has misled the slip compensation, too: its way is doubted, once."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from controllers.estimation.filter.measurement_model import Expected, Measured
from controllers.estimation.filter.slip_states import SlipEstimate
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_compensator import NO_SLIP_EVIDENCE
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.estimator import Estimator
from controllers.fault import Bound, Cause, Fault, Severity
from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import SkidSteerKinematics
from controllers.roles import DeviceRoles
from controllers.slip.scomp.compensator import ScompCompensator
from controllers.slip.scomp.settings import ScompSettings
from drivers.clock import nanoseconds
from drivers.samples import Sample, WheelSample
from tests.controllers.simulated import SKID
from tests.controllers.test_scomp_compensator import (
    RIM_M_S,
    ROVER,
    UPHILL,
    Bench,
    SeenTrace,
    attitude,
)

QUIET = FilterSettings(position_noise_m_sqrt_m=1e-4, unsure_position_noise_m_sqrt_m=1e-4)
SPEED_RAD_S = 2.0


def distrust_gyro(estimator: Estimator, gyro_rad: float, severity: Severity = Severity.STOP) -> None:
    """Let a stop rule begin to find an error of the gyro."""
    estimator.take_faults([])
    estimator.take_faults([Fault("imu", Cause.GYRO_JUMP, "", severity, Bound(gyro_rad=gyro_rad))])


class HalfOfTheWay:
    """A compensator that takes half of the way for slip."""

    states = None
    readers = ()
    unsettled_m = 0j
    evidence = NO_SLIP_EVIDENCE

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

    def forget_gyro(self) -> None:
        """Forget nothing."""

    def follow(self, estimate: SlipEstimate) -> None:
        """Follow nothing."""

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
    assert estimator.motion_ns is not None
    return math.sqrt(estimator.estimate(estimator.motion_ns).covariance[0])


def test_a_wrong_gyro_makes_the_compensated_way_uncertain_once() -> None:
    estimator, rolled_m = driven(0.5, 0.5)
    assert x_sd_m(estimator) < 0.01 * rolled_m
    distrust_gyro(estimator, 0.1)
    # Any share of what was removed is equally likely; the memory has faded a little.
    sd_m = x_sd_m(estimator)
    assert sd_m == pytest.approx(0.5 * rolled_m / math.sqrt(3.0), rel=0.15)
    distrust_gyro(estimator, 0.1)
    assert x_sd_m(estimator) == pytest.approx(sd_m, rel=1e-6)


@pytest.mark.parametrize("is_unobserved", [True, False])
def test_an_uncertain_gyro_inflates_the_covariance_and_does_not_count_as_unobserved(
    is_unobserved: bool,
) -> None:
    estimator, _ = driven(0.5, 0.5)
    assert estimator.motion_ns is not None
    distrust_gyro(estimator, 0.6, Severity.STOP if is_unobserved else Severity.UNCERTAIN)
    assert estimator.estimate(estimator.motion_ns).covariance[5] == pytest.approx(0.6**2 / 3.0, rel=0.01)
    assert estimator.budget.evidence.unobserved_rad == pytest.approx(
        0.6 / math.sqrt(3.0) if is_unobserved else 0.0, abs=0.01
    )


@pytest.mark.parametrize(("share", "yaw_rad"), [(0.5, 0.0), (0.0, 0.1)])
def test_without_a_doubt_of_the_gyro_or_compensation_nothing_is_added(share: float, yaw_rad: float) -> None:
    estimator, rolled_m = driven(share, 0.5)
    distrust_gyro(estimator, yaw_rad)
    assert x_sd_m(estimator) < 0.01 * rolled_m


def test_a_wrong_gyro_makes_the_slip_that_was_learnt_as_uncertain_as_at_the_start() -> None:
    bench = Bench(SeenTrace(math.radians(5.0)))
    bench.run(1.0, rim_m_s=0.0)
    bench.run(5.0)
    block, values = bench.filter.layout.block, bench.filter.slip_values

    class FirstState:
        """A measurement of the slip angle's residual."""

        names, angles = (Measured("trace"),), ()

        def predict(self, state: np.ndarray) -> Expected:
            return Expected(state[block][:1], np.eye(len(state))[block][:1], np.array([1e-9]))

    def trace_sd_rad() -> float:
        """Return the standard deviation that the filter expects of a trace; nothing is changed."""
        (innovation,) = bench.filter.correct(FirstState(), (10.0,))
        assert innovation.variance is not None
        assert not innovation.accepted
        return math.sqrt(innovation.variance)

    start_sd_rad = math.sqrt(bench.told.states.start_variances[0])
    assert trace_sd_rad() < 0.5 * start_sd_rad
    bench.filter.reset_slip_variances()
    assert trace_sd_rad() == pytest.approx(start_sd_rad, rel=1e-6)
    assert bench.filter.slip_values == pytest.approx(values)
    bench.filter.reset_slip_variances()
    assert trace_sd_rad() == pytest.approx(start_sd_rad, rel=1e-6)


def test_until_the_rover_has_stopped_no_trace_is_compared_with_a_gyro_that_was_wrong() -> None:
    finder = SeenTrace(0.0)
    bench = Bench(finder)
    bench.run(1.0, rim_m_s=0.0)
    bench.run(5.0)
    bench.told.forget_gyro()
    # With a turn that the rover does not make, a trace straight behind would be a slip angle.
    bench.run(1.0, yaw_rate_rad_s=0.3)
    angle_rad = bench.told.drift_rad
    assert abs(angle_rad) < math.radians(1.0)
    assert finder.rates[-1] is None
    bench.run(0.5, rim_m_s=0.0)
    bench.run(1.0)
    assert finder.rates[-1] is not None


def test_the_way_that_states_of_slip_removed_is_doubted_with_the_gyro() -> None:
    """Uphill, on the shipped ground, a part of the way is slip."""
    roles = DeviceRoles(wheels="wheels", required={}, gyro="imu")
    kinematics = SkidSteerKinematics(ROVER)
    slip = ScompCompensator(ScompSettings(), roles, kinematics, None)
    estimator = Estimator(kinematics, QUIET, 20.0, roles, slip)
    for cycle in range(51):
        t_ns = nanoseconds(1.0 + 0.02 * cycle)
        estimator.take(attitude(t_ns, UPHILL), t_ns)
        for wheel in range(4):
            angle_rad = RIM_M_S / ROVER.wheel_radius_m * 0.02 * cycle
            estimator.take(WheelSample(device="wheels", t_ns=t_ns, wheel=wheel, position_rad=angle_rad), t_ns)
        estimator.advance(t_ns, (RIM_M_S / ROVER.wheel_radius_m,) * 4)
    removed_m = RIM_M_S - estimator.estimate(0).x_m
    assert removed_m > 0.01
    before_m2 = estimator.estimate(0).covariance[0]
    distrust_gyro(estimator, 0.1)
    added_m2 = estimator.estimate(0).covariance[0] - before_m2
    assert math.sqrt(added_m2) == pytest.approx(removed_m / math.sqrt(3.0), rel=0.25)
