"""Tests of the slip between pose fixes."""

import math
from dataclasses import replace

import pytest

from controllers.slip.effort.learned_curve import LearnedCurve
from controllers.slip.effort.slip_by_fixes import SlipAtForce, SlipByFixes
from drivers.samples import PoseFixSample

CYCLE_NS = 20_000_000
STEP_M = 0.004
SLIP = 0.4
FORCE_N = 20.0


class Drive:
    """A rover that goes straight ahead and slips by `SLIP`."""

    def __init__(self) -> None:
        self.slip = SlipByFixes()
        self.t_ns = CYCLE_NS
        self.x_m = 0.0

    def go(self, cycles: int) -> None:
        for _ in range(cycles):
            self.t_ns += CYCLE_NS
            self.x_m += STEP_M * (1.0 - SLIP)
            self.slip.move(self.t_ns, complex(STEP_M), 0.0, FORCE_N * STEP_M)

    def fix(self, device: str = "a", off_m: float = 0.0, **changes: float) -> SlipAtForce | None:
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
        return self.slip.take(replace(fix, **changes))  # type: ignore[arg-type]


def is_true(found: SlipAtForce | None) -> bool:
    return found is not None and tuple(found) == pytest.approx((FORCE_N, SLIP))


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
    assert drive.fix(**changes) is None
    drive.go(100)
    assert drive.fix(**changes) is None
    assert drive.fix(**changes) is None
    drive.go(100)
    assert is_true(drive.fix())


@pytest.mark.parametrize("changes", [{"x_m": 1.7e308, "y_m": -1.7e308}, {"x_m": -1.0}, {"y_m": 1.0}])
def test_pairs_with_an_outlier_teach_nothing(changes: dict[str, float]) -> None:
    drive = Drive()
    found = []
    for index in range(6):
        drive.go(100)
        found.append(drive.fix(**(changes if index == 3 else {})))
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
