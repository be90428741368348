"""Wheels that turn and do not move the rover: fixes decide, the slip reading alone is a suspicion."""

import cmath
import math
from dataclasses import replace
from typing import Any

import pytest

from controllers.roles import DeviceRoles
from controllers.safety.entrapment import EntrapmentRule, EntrapmentSettings
from controllers.safety.reasons import Cycle, Severity, StopReason
from drivers.samples import PoseFixSample
from tests.controllers.floor_fixes import FLOOR, on_floor

ROLES = DeviceRoles(wheels="wheels", fixes=("overhead",), required={})


class Travel:
    """A rule that is fed with travel of the wheels, fixes and slip.

    The wheels go in a direction of the local frame; the fixes come in the frame of their floor.
    """

    def __init__(self, settings: EntrapmentSettings | None = None, yaw_rad: float = 0.3) -> None:
        self.rule = EntrapmentRule(settings or EntrapmentSettings(), ROLES)
        self.yaw_rad = yaw_rad
        self.place_m = 0j

    def go(self, distance_m: float, slip: float | None = None, direction: complex = 1.0) -> list[StopReason]:
        cycle = Cycle(
            now_ns=0,
            distance_m=distance_m,
            travel_m=distance_m * direction,
            yaw_rad=self.yaw_rad,
            slip=slip,
        )
        return list(self.rule.check(cycle))

    def fix(self, place_m: complex | None = None, **changes: Any) -> None:
        seen = on_floor(self.place_m if place_m is None else place_m, self.yaw_rad)
        self.rule.observe(replace(seen, **changes), 0)

    def drive(self, wheels_m: float, moved: complex, sd_m: float = 0.003) -> list[StopReason]:
        """Let the wheels travel along x in small steps while the rover moves; then comes a fix."""
        for _ in range(10):
            assert self.go(wheels_m / 10) == []
        self.place_m += moved
        self.fix(position_std_m=sd_m)
        return self.go(0.0)


def test_without_progress_on_half_a_metre_the_stop_is_final() -> None:
    travel = Travel()
    assert travel.drive(0.0, 0j) == []
    assert travel.drive(0.3, 0.3) == []
    # It got stuck just after the fix at 0.3 m, as far as anybody knows after it had moved.
    assert travel.drive(0.3, 0j) == []
    (reason,) = travel.drive(0.3, 0j)
    assert reason.severity is Severity.FINAL
    assert reason.cause == "entrapment"
    assert reason.text == (
        "rover: entrapped, its wheels travelled 0.60 m and overhead shows no progress: free it and restart"
    )


def test_the_travel_counts_from_where_the_rover_may_have_got_stuck() -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    assert travel.drive(0.3, 0.05) == []
    (reason,) = travel.drive(0.3, 0j)
    # 0.25 m of the first 0.3 m may have been without progress.
    assert "travelled 0.55 m" in reason.text


def test_progress_long_before_the_newest_fixes_does_not_count_as_lost() -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    assert travel.drive(0.3, 0.11) == []
    assert travel.drive(0.3, 0j) == []
    assert travel.drive(0.3, 0j) != []


@pytest.mark.parametrize("slip", [0.5, 0.9, 0.96])
def test_a_rover_that_slips_and_moves_is_not_entrapped(slip: float) -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    for _ in range(50):
        assert travel.drive(0.3, (1.0 - slip) * 0.3) == []


@pytest.mark.parametrize("fixes_per_m", [4, 40])
def test_a_rover_that_creeps_is_seen_to_move_at_any_rate_of_the_fixes(fixes_per_m: int) -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    for _ in range(10 * fixes_per_m):
        assert travel.drive(1.0 / fixes_per_m, 0.05 / fixes_per_m) == []


def test_fixes_that_come_often_show_a_rover_that_is_stuck() -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    for _ in range(20):
        travel.drive(0.02, 0.02)
    steps = 1
    while not travel.drive(0.02, 0j):
        steps += 1
    assert steps * 0.02 == pytest.approx(0.5, abs=0.11)


def test_the_limit_of_the_noise_is_two_deviations_of_the_difference() -> None:
    noise_m = 2.0 * math.hypot(0.003, 0.003)
    for moved_m, is_stopped in ((0.99 * noise_m, True), (1.01 * noise_m, False)):
        for way in (1.0, -1.0):
            travel = Travel()
            travel.drive(0.0, 0j)
            assert bool(travel.drive(0.51, way * moved_m)) == is_stopped


def test_the_limit_of_the_travel_is_exact() -> None:
    for wheels_m, is_stopped in ((0.499, False), (0.501, True)):
        travel = Travel()
        travel.drive(0.0, 0j)
        assert bool(travel.drive(wheels_m, 0j)) == is_stopped


def test_sliding_sideways_is_no_progress() -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    assert travel.drive(0.6, 0.2j) != []


def test_fixes_that_are_too_coarse_need_a_longer_travel() -> None:
    noise_m = 2.0 * math.hypot(0.05, 0.05)
    travel = Travel()
    travel.drive(0.0, 0j, sd_m=0.05)
    assert travel.drive(0.99 * noise_m / 0.15, 0j, sd_m=0.05) == []
    assert travel.drive(0.1, 0j, sd_m=0.05) != []


def test_a_travel_to_and_fro_is_no_evidence_and_begins_anew() -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    for direction in (1.0, -1.0, 1.0):
        travel.go(0.4, direction=direction)
    travel.fix()
    assert travel.go(0.0) == []
    assert travel.drive(0.45, 0j) == []
    assert travel.drive(0.11, 0j) != []


def test_round_a_corner_the_travel_still_counts() -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    for direction in (1.0, 1.0j):
        travel.go(0.36, direction=direction)
    travel.fix()
    assert travel.go(0.0) != []


def test_a_wrong_fix_does_not_stop_a_healthy_rover() -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    for step in range(20):
        assert travel.drive(0.3, 0.2) == []
        if step % 4 == 3:
            travel.fix(travel.place_m + cmath.rect(2.0, step))
            assert travel.go(0.0) == []


@pytest.mark.parametrize(
    "useless",
    [{"x_m": math.nan}, {"yaw_rad": math.inf}, {"position_std_m": 0.0}, {"position_std_m": math.inf}],
)
def test_useless_fixes_are_left_out(useless: dict[str, float]) -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    travel.go(0.3)
    travel.fix(**useless)
    travel.go(0.3)
    assert travel.go(0.0) == []
    travel.fix()
    assert travel.go(0.0) != []


def test_fixes_of_other_devices_and_other_samples_do_not_count() -> None:
    travel = Travel()
    other = PoseFixSample(
        device="other",
        t_ns=0,
        x_m=FLOOR.x_m,
        y_m=FLOOR.y_m,
        yaw_rad=0.0,
        position_std_m=0.003,
        yaw_std_rad=0.01,
        t_capture_ns=0,
    )
    for _ in range(4):
        travel.rule.observe(other, 0)
        assert travel.go(0.3) == []


def test_two_devices_are_judged_apart() -> None:
    roles = DeviceRoles(wheels="wheels", fixes=("overhead", "marks"), required={})
    rule = EntrapmentRule(EntrapmentSettings(), roles)
    for _ in range(2):
        rule.observe(on_floor(0j, 0.0), 0)
        rule.observe(replace(on_floor(5.0 + 0j, 0.0), device="marks"), 0)
        found = list(rule.check(Cycle(now_ns=0, distance_m=0.6, travel_m=0.6)))
    assert [reason.text.split(" and ")[1].split()[0] for reason in found] == ["overhead", "marks"]


def test_a_slip_near_1_alone_is_a_suspicion() -> None:
    travel = Travel()
    assert travel.go(0.499, 0.85) == []
    (reason,) = travel.go(0.001, 0.85)
    assert reason.severity is Severity.SUSPICION
    assert reason.text == (
        "rover: may be entrapped, by the yaw excitation its wheels travelled 0.5 m at a slip of at least 0.85"
    )


def test_smaller_slip_clears_the_suspicion() -> None:
    travel = Travel()
    travel.go(0.4, 0.9)
    assert travel.go(0.1, 0.849) == []
    assert travel.go(0.4, 0.9) == []
    assert travel.go(0.1, 0.9) != []


@pytest.mark.parametrize("slip", [None, 0.5])
def test_without_valid_slip_near_1_nothing_is_suspected(slip: float | None) -> None:
    assert Travel().go(10.0, slip) == []


def test_unknown_slip_in_between_does_not_clear_the_suspicion() -> None:
    travel = Travel()
    travel.go(0.4, 1.0)
    assert travel.go(5.0, None) == []
    assert travel.go(0.1, 1.0) != []


def test_a_camera_that_sees_no_motion_is_a_suspicion() -> None:
    rule = Travel().rule
    (reason,) = rule.check(Cycle(now_ns=0, sees_no_motion=True))
    assert reason.severity is Severity.SUSPICION
    assert reason.text == (
        "rover: may be entrapped, the rear camera sees no motion of the ground: it is stuck, or the camera "
        "is covered, turned, or in the dark"
    )
