"""Tests of the slip between pose fixes."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.estimator import Estimator
from controllers.slip.effort.learned_curve import LearnedCurve
from controllers.slip.effort.slip_by_fixes import SlipAtForce, SlipByFixes
from drivers.clock import nanoseconds
from drivers.samples import LinkSample, PoseFixSample, WheelSample
from tests.controllers.simulated import ROLES
from tests.controllers.slip_bench import KINEMATICS, Bench, currents_for, wheel_speeds

CYCLE_NS = 20_000_000
STEP_M = 0.004
SLIP = 0.4
FORCE_N = 20.0
UNCHANGED: Mapping[str, float] = {}


class Drive:
    """A rover that goes straight ahead and slips by `SLIP`."""

    def __init__(self) -> None:
        self.slip = SlipByFixes()
        self.t_ns = CYCLE_NS
        self.x_m = 0.0

    def go(self, cycles: int, *, are_lost: bool = False) -> None:
        for _ in range(cycles):
            self.t_ns += CYCLE_NS
            self.x_m += STEP_M * (1.0 - SLIP)
            increment = BodyIncrement(x_m=STEP_M, y_m=0.0, turn_rad=0.0, duration_s=CYCLE_NS * 1e-9)
            if not are_lost:
                self.slip.move(self.t_ns, increment, 0.0, FORCE_N * STEP_M)

    def fix(
        self, device: str = "a", off_m: float = 0.0, changes: Mapping[str, float] = UNCHANGED
    ) -> SlipAtForce | None:
        fix = PoseFixSample(
            device=device,
            t_ns=self.t_ns,
            x_m=self.x_m + off_m,
            y_m=0.0,
            yaw_rad=0.0,
            position_std_m=0.01,
            yaw_std_rad=0.02,
            t_capture_ns=self.t_ns,
        )
        return self.slip.take(replace(fix, **dict[str, Any](changes)))


def is_true(found: SlipAtForce | None) -> bool:
    return found is not None and (found.force_n, found.slip) == pytest.approx((FORCE_N, SLIP))


def test_the_fixes_of_two_devices_are_not_compared() -> None:
    drive = Drive()
    found = []
    for index in range(8):
        drive.go(60)
        device = "ab"[index % 2]
        found.append(drive.fix(device, off_m=0.0 if device == "a" else 2.0))
    assert found[:2] == [None, None]
    assert all(map(is_true, found[2:]))


@pytest.mark.parametrize(
    "changes",
    [
        {"x_m": math.nan},
        {"y_m": math.inf},
        {"yaw_rad": math.nan},
        {"position_std_m": math.nan},
        {"position_std_m": math.inf},
        {"position_std_m": 0.0},
        {"position_std_m": -0.01},
    ],
)
def test_a_fix_that_the_pose_filter_would_not_take_teaches_nothing(changes: dict[str, float]) -> None:
    drive = Drive()
    drive.go(100)
    assert drive.fix() is None
    assert drive.fix(changes=changes) is None
    drive.go(100)
    assert drive.fix(changes=changes) is None
    assert drive.fix(changes=changes) is None
    drive.go(100)
    assert is_true(drive.fix())


@pytest.mark.parametrize("changes", [{"x_m": 1.7e308, "y_m": -1.7e308}, {"x_m": -1.0}, {"y_m": 1.0}])
def test_pairs_with_an_outlier_teach_nothing(changes: dict[str, float]) -> None:
    drive = Drive()
    found = []
    for index in range(6):
        drive.go(100)
        found.append(drive.fix(changes=changes if index == 3 else UNCHANGED))
    assert [None if one is None else is_true(one) for one in found] == [None, True, True, None, None, True]


def test_noise_beyond_a_slip_of_zero_is_no_outlier() -> None:
    drive = Drive()
    drive.go(100)
    drive.fix()
    drive.go(100)
    found = drive.fix(off_m=100 * STEP_M * (SLIP + 0.1))
    assert found is not None
    assert found.slip == 0.0


def test_a_curve_that_learned_no_number_is_not_valid() -> None:
    curve = LearnedCurve(10.0)
    for slip in (0.4, math.nan, 0.4, 0.4):
        curve.learn(FORCE_N, slip)
    assert curve.at(FORCE_N).reason != ""


def test_a_way_that_was_lost_is_no_part_of_a_comparison() -> None:
    drive = Drive()
    drive.go(100)
    assert drive.fix() is None
    drive.go(80)
    drive.go(40, are_lost=True)
    drive.go(20)
    assert drive.fix() is None
    drive.go(100)
    assert is_true(drive.fix())


def test_a_fix_from_before_the_known_motion_is_not_compared() -> None:
    drive = Drive()
    drive.t_ns = 3 * CYCLE_NS
    drive.go(100)
    assert drive.fix(changes={"t_capture_ns": 2 * CYCLE_NS, "x_m": 0.0}) is None
    drive.go(100)
    assert drive.fix() is None


@pytest.mark.parametrize("has_break", [False, True])
def test_the_estimator_learns_from_fixes_and_wheels_that_report_one_by_one(has_break: bool) -> None:
    bench = Bench(learn=True, fixes=("overhead",))
    speeds = wheel_speeds(0.0, 0.2)
    currents = currents_for(18.0, 0.0, speeds)
    estimator = Estimator(KINEMATICS, FilterSettings(), 20.0, replace(ROLES, fixes=("overhead",)), bench.slip)
    for cycle in range(1, 330):
        now_s = 0.02 * cycle
        if has_break and 110 <= cycle < 140:
            continue
        if has_break and cycle == 140:
            estimator.take(
                LinkSample(device="wheels", t_ns=nanoseconds(now_s), up=True, reason=""), nanoseconds(now_s)
            )
        for wheel, (speed_rad_s, current_a) in enumerate(zip(speeds, currents, strict=True)):
            t_s = now_s - 0.002 * ((cycle * wheel) % 3)
            sample = WheelSample(
                device="wheels",
                t_ns=nanoseconds(t_s),
                wheel=wheel,
                position_rad=speed_rad_s * t_s,
                current_a=current_a,
                current_is_signed=True,
            )
            estimator.take(sample, sample.t_ns)
        if cycle % 50 == 0:
            capture_s = now_s - 0.1
            fix = PoseFixSample(
                device="overhead",
                t_ns=nanoseconds(now_s),
                x_m=0.2 * capture_s * (1.0 - SLIP),
                y_m=0.0,
                yaw_rad=0.0,
                position_std_m=0.003,
                yaw_std_rad=0.01,
                t_capture_ns=nanoseconds(capture_s),
            )
            estimator.take(fix, fix.t_ns)
        estimator.advance(nanoseconds(now_s), speeds)
    rover = bench.report.rover
    assert rover is not None
    assert (rover.source, rover.reason) == ("learned", "")
    assert rover.slip == pytest.approx(SLIP, abs=0.01)
