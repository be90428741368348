"""The account of added uncertainty: bounds that are raised, cleared and counted."""

import math
from dataclasses import replace
from functools import partial

import pytest

from controllers.estimation.filter.error_budget import Category, ErrorBudget
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.bounds import WheelBounds
from controllers.fault import Bound, Cause, Fault, Severity
from controllers.motion.kinematics import OmniKinematics
from tests.controllers.safety.cycles import AT_START
from tests.controllers.simulated import OMNI

STALL = Fault("wheels", Cause.WHEEL_STALL, "", bound=Bound(wheel_rad=(1.0, 0.0, -1.0), gyro_rad=0.3))
AHEAD_M = OmniKinematics(OMNI).body_motion((1.0, 0.0, -1.0))[0]


def uniform(*bounds: float) -> float:
    """Return the standard deviation of independent errors that lie anywhere up to their bounds."""
    return math.sqrt(sum(bound**2 for bound in bounds) / 3.0)


class Bench:
    """A budget, and what it has added to the covariance of a pose that was certain."""

    def __init__(self, *, has_gyro: bool = True, forgotten: list[str] | None = None) -> None:
        self.filter = PoseFilter(FilterSettings(), ())
        forget = None if forgotten is None else partial(forgotten.append, "gyro")
        bounds = WheelBounds(OmniKinematics(OMNI), (), 5.0, has_gyro=has_gyro)
        self.budget = ErrorBudget(self.filter, bounds, forget)

    def sds(self) -> tuple[float, float, float]:
        """Return the standard deviations of x, y and yaw."""
        xx, _, _, yy, _, yaw = self.filter.covariance
        return math.sqrt(xx), math.sqrt(yy), math.sqrt(yaw)


@pytest.mark.parametrize("path_rad", [(0.3, 0.5), (0.5,), (0.5, 0.4, 0.5), (0.1, 0.2, 0.3, 0.5)])
def test_a_bound_that_is_raised_adds_as_much_as_at_once(path_rad: tuple[float, ...]) -> None:
    bench = Bench()
    for yaw_rad in path_rad:
        bench.budget.raise_to("cause", Bound(position_m=2.0 * yaw_rad, yaw_rad=yaw_rad))
    assert bench.budget.greatest("cause") == Bound(position_m=1.0, yaw_rad=0.5)
    assert bench.sds() == pytest.approx((uniform(1.0), uniform(1.0), uniform(0.5)), rel=1e-5)


def test_after_its_end_a_cause_adds_anew_and_others_never_mix() -> None:
    bench = Bench()
    bench.budget.raise_to("cause", Bound(yaw_rad=0.3))
    bench.budget.clear("cause")
    bench.budget.clear("cause")
    bench.budget.raise_to("cause", Bound(yaw_rad=0.3))
    bench.budget.raise_to("other", Bound(yaw_rad=0.4))
    assert bench.sds()[2] == pytest.approx(uniform(0.3, 0.3, 0.4), rel=1e-5)


def test_a_wheel_that_is_measured_again_begins_anew_alone() -> None:
    bench = Bench(has_gyro=False)
    for wheel_rad in ((0.5, 0.0, -1.0), (1.0, 0.0, -0.5), (0.0, 0.0, -1.0)):
        bench.budget.raise_to("encoder", Bound(wheel_rad=wheel_rad))
    assert bench.budget.greatest("encoder").wheel_rad == (0.0, 0.0, -1.0)
    yaw_sd_rad = bench.sds()[2]
    bench.budget.raise_to("encoder", Bound(wheel_rad=(1.0, 0.0, -1.0)))
    assert bench.sds()[2] > yaw_sd_rad


def test_a_fault_adds_the_errors_of_its_wheels_once_and_those_of_the_gyro_as_they_grow() -> None:
    bench = Bench()
    for gyro_rad in (0.3, 0.5, 0.4, 0.5):
        bound = STALL.bound._replace(gyro_rad=gyro_rad)
        bench.budget.take([STALL._replace(bound=bound), STALL], 0.0)
    x_m, _, yaw_rad = bench.sds()
    assert yaw_rad == pytest.approx(uniform(0.5), rel=1e-5)
    assert x_m == pytest.approx(uniform(AHEAD_M), rel=1e-3)
    bench.budget.take([], 0.0)
    bench.budget.take([STALL], 0.0)
    assert bench.sds()[2] == pytest.approx(uniform(0.5, 0.3), rel=1e-5)


def test_the_path_on_which_the_yaw_became_wrong_is_added_once() -> None:
    bench = Bench()
    bound = Bound(gyro_rad=0.3, path_m=2.0)
    fault = Fault("imu", Cause.GYRO_DOES_NOT_FOLLOW, "", Severity.UNCERTAIN, bound)
    chord_m = 2.0 * math.sin(0.15)
    bench.budget.take([fault], 5.0)
    bench.budget.take([fault._replace(bound=bound._replace(path_m=3.0))], 6.0)
    assert bench.sds()[0] == pytest.approx(uniform(2.0 * chord_m), rel=1e-5)
    bench.budget.take([], 6.0)
    bench.budget.take([fault], 6.5)
    assert bench.sds()[0] == pytest.approx(uniform(2.0 * chord_m, 1.5 * chord_m), rel=1e-5)


@pytest.mark.parametrize("severity", [Severity.SYMPTOM, Severity.WARNING])
def test_a_symptom_counts_for_the_estimate_of_its_cycle_alone(severity: Severity) -> None:
    bench = Bench()
    bench.budget.take([STALL._replace(severity=severity)], 0.0)
    assert bench.sds()[2] == pytest.approx(0.0, abs=1e-5)
    estimate = bench.budget.with_symptoms(replace(AT_START, covariance=(0.0,) * 5 + (0.01,)))
    added_rad2 = 0.03 if severity is Severity.SYMPTOM else 0.0
    assert estimate.covariance == pytest.approx((0.0,) * 5 + (0.01 + added_rad2,))
    bench.budget.take([], 0.0)
    assert bench.budget.with_symptoms(AT_START) == AT_START


def test_what_is_undecided_makes_the_yaw_at_most_any() -> None:
    bench = Bench()
    for _ in range(5):
        bench.budget.add((0.0, 0.0, 3.0), Category.UNDECIDED)
    assert bench.sds()[2] == pytest.approx(uniform(math.pi), rel=1e-5)
    assert bench.budget.evidence.undecided_rad == 0.0
    bench.budget.begin_cycle()
    assert bench.budget.evidence.undecided_rad == pytest.approx(uniform(math.pi))
    assert bench.budget.evidence.unobserved_rad == 0.0


def test_what_a_measurement_has_removed_is_no_longer_counted() -> None:
    bench = Bench()
    bench.budget.limit()
    bench.budget.add((0.3, 0.0, 0.3), Category.UNOBSERVED)
    bench.budget.count(1.0, 1.0)
    assert bench.budget.evidence.unobserved_m == pytest.approx(math.sqrt(1.03))
    bench.budget.limit()
    assert bench.budget.evidence[:2] == pytest.approx((uniform(0.3), uniform(0.3)), rel=1e-4)


def test_a_rover_that_may_be_anywhere_may_be_at_the_end_of_its_travel() -> None:
    bench = Bench()
    bench.budget.raise_to("sensor", Bound(position_m=2.0, yaw_rad=math.pi, is_motion_unknown=True))
    assert bench.sds() == pytest.approx((2.0, 2.0, uniform(math.pi)), rel=1e-5)


def test_a_wrong_gyro_has_misled_the_slip_compensation() -> None:
    forgotten: list[str] = []
    bench = Bench(forgotten=forgotten)
    bench.budget.note_compensation(0.0, 0.3, -0.2)
    bench.budget.raise_to("gyro", Bound(gyro_rad=0.1))
    assert forgotten == ["gyro"]
    assert bench.sds()[:2] == pytest.approx((uniform(0.3), uniform(0.2)), rel=1e-5)
    bench.budget.raise_to("gyro", Bound(gyro_rad=0.2))
    assert bench.sds()[:2] == pytest.approx((uniform(0.3), uniform(0.2)), rel=1e-5)


def test_what_compensation_removed_long_ago_misleads_less() -> None:
    bench = Bench()
    bench.budget.note_compensation(0.0, 1.0, -2.0)
    bench.budget.note_compensation(ESTIMATION.pose.misled_slip_s, 0.5, 0.0)
    bench.budget.raise_to("gyro", Bound(gyro_rad=0.1))
    kept = math.exp(-1.0)
    assert bench.sds()[:2] == pytest.approx((uniform(kept + 0.5), uniform(2.0 * kept)), rel=1e-5)


def test_unobserved_motion_is_counted_with_that_before_and_along_both_axes() -> None:
    bench = Bench()
    bench.budget.count(0.01, 0.02)
    bench.budget.count(0.03, 0.04)
    evidence = bench.budget.evidence
    assert (evidence.unobserved_m**2, evidence.unobserved_rad**2) == pytest.approx((0.04, 0.06))
    bench.budget.add((1.0, 2.0, 0.0), Category.UNOBSERVED)
    assert bench.budget.evidence.unobserved_m**2 == pytest.approx(0.04 + 5.0 / 3.0, rel=1e-5)


@pytest.mark.parametrize(("position_m2", "yaw_rad2"), [(1.0, 0.0), (0.0, 1.0)])
def test_each_quantity_is_limited_alone(position_m2: float, yaw_rad2: float) -> None:
    bench = Bench()
    bench.budget.count(position_m2, yaw_rad2)
    bench.budget.limit()
    assert bench.budget.evidence[:2] == pytest.approx((0.0, 0.0), abs=1e-3)


def test_what_is_undecided_is_limited_to_what_the_filter_has_left() -> None:
    bench = Bench()
    bench.budget.add((0.0, 0.0, 0.3), Category.UNDECIDED)
    bench.budget.limit()
    bench.budget.begin_cycle()
    assert bench.budget.evidence.undecided_rad == pytest.approx(uniform(0.3), rel=1e-3)
