"""Wheels that turn and do not move the rover: fixes decide, the slip reading alone is a suspicion."""

import cmath
import math
from dataclasses import replace
from typing import Any

import pytest

from controllers.estimation.ground.travel import GroundPair
from controllers.fault import NO_ERROR, Fault, Severity
from controllers.ground_motion.motion import GroundMotion
from controllers.roles import DeviceRoles
from controllers.safety.entrapment import EntrapmentRule, EntrapmentSettings
from drivers.samples import PoseFixSample
from tests.controllers.floor_fixes import FLOOR, on_floor
from tests.controllers.safety.cycles import make_cycle

CYCLE_NS = 20_000_000
ROLES = DeviceRoles(wheels="wheels", gyro="imu", fixes=("overhead",), required={})


class Travel:
    """A rule that is fed with travel of the wheels, fixes and slip.

    The wheels go in a direction of the local frame; the fixes come in the frame of their floor.
    """

    def __init__(
        self, settings: EntrapmentSettings | None = None, yaw_rad: float = 0.3, lag_ns: int = 0
    ) -> None:
        self.rule = EntrapmentRule(settings or EntrapmentSettings(), ROLES)
        self.yaw_rad = yaw_rad
        self.lag_ns = lag_ns
        self.now_ns = 0
        self.place_m = 0j

    def go(self, distance_m: float, slip: float | None = None, direction: complex = 1.0) -> list[Fault]:
        self.now_ns += CYCLE_NS
        cycle = make_cycle(
            now_ns=self.now_ns,
            motion_ns=self.now_ns,
            distance_m=distance_m,
            travel_m=distance_m * direction,
            yaw_rad=self.yaw_rad,
            slip=slip,
        )
        return list(self.rule.check(cycle))

    def fix(self, place_m: complex | None = None, **changes: Any) -> None:
        seen = on_floor(self.place_m if place_m is None else place_m, self.yaw_rad)
        seen = replace(seen, t_ns=self.now_ns, t_capture_ns=self.now_ns - self.lag_ns)
        self.rule.observe(replace(seen, **changes), self.now_ns)

    def drive(self, wheels_m: float, moved: complex, sd_m: float = 0.003) -> list[Fault]:
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
    assert reason.name == "entrapment"
    assert reason.text == (
        "rover: stuck, its wheels travelled 0.60 m and overhead shows no progress: free it and restart"
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


@pytest.mark.parametrize(("share", "is_stuck"), [(0.021, False), (0.019, True), (-0.019, True)])
def test_a_rover_that_slides_along_a_wall_does_not_get_on(share: float, *, is_stuck: bool) -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    stops = [travel.drive(0.12, share * 0.12, sd_m=1e-4) for _ in range(5)]
    assert any(stops) is is_stuck


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
    noise_m = 2.0 * math.hypot(0.005, 0.005)
    for moved_m, is_stopped in ((0.99 * noise_m, True), (1.01 * noise_m, False)):
        for way in (1.0, -1.0):
            travel = Travel()
            travel.drive(0.0, 0j, sd_m=0.005)
            assert bool(travel.drive(0.51, way * moved_m, sd_m=0.005)) == is_stopped


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
    for t_ns in range(2):
        for place_m, device in ((0j, "overhead"), (5.0 + 0j, "marks")):
            rule.observe(replace(on_floor(place_m, 0.0), device=device, t_capture_ns=t_ns), t_ns)
        found = list(rule.check(make_cycle(now_ns=t_ns, motion_ns=t_ns, distance_m=0.6, travel_m=0.6)))
    assert [reason.text.split(" and ")[1].split()[0] for reason in found] == ["overhead", "marks"]


def late_drive(speed_m_s: float, lag_s: float, travels: float) -> list[Fault]:
    """Drive 4 m; fixes at 10 Hz say how far a share of the travel had moved the rover a while before."""
    travel = Travel()
    found = []
    step_m = speed_m_s * CYCLE_NS / 1e9
    rest = lag = round(lag_s * 1e9 / CYCLE_NS)
    places = [0.0] * rest + [travels * step_m * index for index in range(round(4.0 / step_m))]
    for cycle, _ in enumerate(places):
        found += travel.go(step_m if cycle > rest else 0.0)
        if cycle >= lag and cycle % 5 == 0:
            travel.fix(complex(places[cycle - lag]), t_capture_ns=travel.now_ns - lag * CYCLE_NS)
    return found


@pytest.mark.parametrize(("speed_m_s", "lag_s"), [(0.5, 1.2), (1.0, 0.6), (1.0, 1.9)])
def test_late_fixes_are_compared_with_the_travel_at_their_capture(speed_m_s: float, lag_s: float) -> None:
    assert late_drive(speed_m_s, lag_s, travels=1.0) == []
    assert late_drive(speed_m_s, lag_s, travels=0.0) != []


def test_fixes_from_before_the_known_travel_do_not_count() -> None:
    travel = Travel(lag_ns=2_100_000_000)
    for _ in range(150):
        assert travel.go(0.02) == []
        travel.fix()


def test_without_a_known_motion_of_the_wheels_fixes_do_not_count() -> None:
    rule = Travel().rule
    for t_ns in range(2):
        rule.observe(replace(on_floor(0j, 0.0), t_capture_ns=t_ns), t_ns)
        assert list(rule.check(make_cycle(now_ns=t_ns, distance_m=0.6, travel_m=0.6))) == []


def test_a_motion_that_stays_the_newest_is_noted_once() -> None:
    travel = Travel()
    travel.drive(0.0, 0j)
    travel.go(0.3)
    travel.fix()
    repeated = make_cycle(
        now_ns=travel.now_ns + CYCLE_NS, motion_ns=travel.now_ns, distance_m=0.3, travel_m=0.3
    )
    # What is travelled by an unknown time counts from the next known one on.
    assert list(travel.rule.check(repeated)) == []
    travel.fix()
    assert travel.go(0.0) == []
    travel.fix()
    assert travel.go(0.0) != []


@pytest.mark.parametrize("yaw_std_rad", [math.pi / 8.0 + 1e-9, 10.0, math.inf, math.nan, -1.0])
def test_where_the_yaw_of_a_fix_is_not_known_any_displacement_is_progress(yaw_std_rad: float) -> None:
    travel = Travel()
    for _ in range(10):
        travel.go(0.02)
        travel.place_m += 0.02
        # The yaw is wrong by 90 deg, so that the displacement seems to be sideways.
        seen = on_floor(travel.place_m, travel.yaw_rad)
        travel.fix(yaw_rad=seen.yaw_rad - math.pi / 2.0, yaw_std_rad=yaw_std_rad)
    for _ in range(30):
        seen = on_floor(travel.place_m, travel.yaw_rad)
        travel.fix(yaw_rad=seen.yaw_rad - math.pi / 2.0, yaw_std_rad=yaw_std_rad)
        assert travel.go(0.1) == []
        travel.place_m += 0.1


def test_a_yaw_that_is_known_shows_the_direction() -> None:
    travel = Travel()
    for _ in range(10):
        travel.go(0.0)
    travel.fix(yaw_std_rad=math.pi / 8.0)
    assert travel.go(0.0) == []
    assert travel.drive(0.6, 0.2j) != []


def test_a_slip_near_1_alone_is_a_suspicion() -> None:
    travel = Travel()
    assert travel.go(0.499, 0.85) == []
    (reason,) = travel.go(0.001, 0.85)
    assert reason.severity is Severity.WARNING
    assert reason.text == (
        "rover: may be stuck, by the yaw excitation its wheels travelled 0.5 m at a slip of at least 0.85"
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
    (reason,) = rule.check(make_cycle(now_ns=0, unmoved_m=0.3))
    assert reason.severity is Severity.WARNING
    assert "the rear camera sees no motion of the ground" in reason.text


class Doubted(Travel):
    """The same with a response of the yaw, and wheels that turn by 25 rad per metre."""

    lost_response = "no answer"
    unknown_share = 0.0
    unanswered_m = 0.0
    is_still = False

    def go(self, distance_m: float, slip: float | None = None, direction: complex = 1.0) -> list[Fault]:
        self.now_ns += CYCLE_NS
        cycle = make_cycle(
            now_ns=self.now_ns,
            motion_ns=self.now_ns,
            distance_m=distance_m,
            travel_m=distance_m * direction,
            yaw_rad=self.yaw_rad,
            slip=slip,
            lost_response=self.lost_response,
            unknown_share=self.unknown_share,
            unanswered_m=self.unanswered_m,
            measured_rad_s=(25.0 * distance_m * 1e9 / CYCLE_NS, 0.0),
            is_still=self.is_still,
        )
        return list(self.rule.check(cycle))


def test_a_suspicion_that_nothing_decides_stops_once_and_counts_anew_after_a_rest() -> None:
    travel = Doubted()
    travel.unanswered_m = 0.3
    for _ in range(11):
        (reason,) = travel.go(0.1)
        assert (reason.name, reason.severity) == ("lost response", Severity.WARNING)
        assert reason.text == "rover: may be stuck, or imu has no signal: no answer"
    (reason,) = travel.go(0.1)
    assert reason.severity is Severity.RECOVERABLE
    assert reason.text == (
        "rover: progress unknown on 1.50 m of its wheels, may be stuck, or imu has no signal: no answer"
    )
    # All that the wheels turned since the rover may have got stuck, but for the first cycle.
    assert reason.bound.wheel_rad == pytest.approx((25.0 * 1.5, 0.0), rel=0.1)
    assert travel.go(0.1) == [reason]
    travel.is_still, travel.unanswered_m = True, 5.0
    (reason,) = travel.go(0.0)
    assert reason.severity is Severity.WARNING
    travel.is_still = False
    # At most half of the travel lies before the suspicion.
    assert [travel.go(0.1)[0].severity for _ in range(8)] == [Severity.WARNING] * 7 + [Severity.RECOVERABLE]


def test_an_answer_and_progress_by_fixes_clear_the_travel() -> None:
    travel = Doubted(EntrapmentSettings(progress_unknown_m=1.0))
    for step in range(30):
        travel.place_m += 0.1
        travel.fix()
        (reason,) = travel.go(0.1)
        assert (step, reason.severity) == (step, Severity.WARNING)
    assert [travel.go(0.3)[0].severity for _ in range(3)] == [Severity.WARNING] * 3
    travel.lost_response = ""
    assert travel.go(0.3) == []
    travel.lost_response = "no answer"
    assert [travel.go(0.3)[0].severity for _ in range(4)][2:] == [Severity.WARNING, Severity.RECOVERABLE]


def test_unknown_slip_widens_the_region_until_progress_is_seen() -> None:
    travel = Doubted(EntrapmentSettings(progress_unknown_m=1.0))
    travel.unknown_share, travel.unanswered_m = 0.5, 0.2
    for step in range(8):
        (reason,) = travel.go(0.1)
        assert (step, reason.severity) == (step, Severity.UNCERTAIN)
        assert reason.bound.position_m == pytest.approx(0.5 * (0.2 + 0.1 * step))
    (reason,) = travel.go(0.1)
    assert reason.severity is Severity.RECOVERABLE
    assert reason.bound.position_m == pytest.approx(0.5 * 1.0)
    # The rest of the stop does not end the doubt.
    travel.is_still = True
    assert travel.go(0.0)[0].bound.position_m == pytest.approx(0.5 * 1.0)
    travel.is_still = False
    travel.fix()
    assert travel.go(0.2)[0].bound.position_m > 0.5
    travel.place_m += 0.9
    travel.fix()
    # A warning has no bound: the account of the uncertainty forgets the cause, and counts anew from here on.
    (reason,) = travel.go(0.1)
    assert (reason.severity, reason.bound) == (Severity.WARNING, NO_ERROR)
    (reason,) = travel.go(0.1)
    assert reason.severity is Severity.UNCERTAIN
    assert reason.bound.position_m == pytest.approx(0.05)
    travel.unknown_share, travel.lost_response = 0.0, ""
    assert travel.go(0.1) == []


def test_an_odd_force_stops_once() -> None:
    rule = Travel().rule

    def go(index: int, *, is_still: bool = False) -> Fault:
        cycle = make_cycle(
            now_ns=index * CYCLE_NS,
            distance_m=0.0 if is_still else 0.1,
            unusual_force="40 N",
            unusual_force_m=0.3,
            measured_rad_s=(1.0,),
            is_still=is_still,
        )
        (reason,) = rule.check(cycle)
        return reason

    found = [go(index) for index in range(13)]
    assert [reason.severity for reason in found[10:]] == [
        Severity.WARNING,
        Severity.RECOVERABLE,
        Severity.RECOVERABLE,
    ]
    assert "progress unknown on 1.50 m of its wheels, may be stuck, or on a slope" in found[-1].text
    assert go(13, is_still=True).severity is Severity.WARNING
    assert {go(index).severity for index in range(14, 60)} == {Severity.WARNING}


def test_a_rover_that_is_to_back_out_is_stopped_for_good_only_the_second_time() -> None:
    travel = Doubted(EntrapmentSettings(back_out_m=0.3))
    severities = []
    for _ in range(2):
        for _ in range(10):
            travel.fix()
            severities += [reason.severity for reason in travel.go(0.1)]
        travel.is_still = True
        severities += [reason.severity for reason in travel.go(0.0)]
        travel.is_still = False
    assert severities.index(Severity.RECOVERABLE) < severities.index(Severity.FINAL)


def unmoved(
    travel: Travel, index: int, unmoved_m: float, distance_m: float = 0.1, *, is_still: bool = False
) -> Severity:
    cycle = make_cycle(
        now_ns=index * CYCLE_NS,
        distance_m=distance_m,
        unmoved_m=unmoved_m,
        measured_rad_s=(1.0,),
        is_still=is_still,
    )
    (reason,) = travel.rule.check(cycle)
    return reason.severity


def test_a_camera_that_sees_no_motion_stops_as_early_as_fixes_would() -> None:
    travel = Travel()
    assert list(travel.rule.check(make_cycle(now_ns=0, distance_m=0.3, measured_rad_s=(1.0,)))) == []
    found = [unmoved(travel, index, 0.1 * index) for index in range(4, 8)]
    assert found == [Severity.WARNING, *[Severity.RECOVERABLE] * 3]
    # After a rest the travel counts anew.
    assert unmoved(travel, 9, 0.8, 0.0, is_still=True) is Severity.WARNING
    assert [unmoved(travel, index, 0.1 * index) for index in range(10, 15)][-2:] == [
        Severity.WARNING,
        Severity.RECOVERABLE,
    ]


def test_a_limit_below_the_travel_that_a_camera_needs_stops_at_once() -> None:
    travel = Travel(EntrapmentSettings(entrapment_m=0.1))
    assert list(travel.rule.check(make_cycle(now_ns=0, distance_m=0.3, measured_rad_s=(1.0,)))) == []
    assert unmoved(travel, 1, 0.3, 0.0) is Severity.RECOVERABLE


def test_what_fixes_have_shown_is_no_travel_without_progress_under_a_camera() -> None:
    travel = Travel()
    for _ in range(10):
        travel.place_m += 0.1
        travel.fix()
        travel.go(0.1)
    travel.now_ns += CYCLE_NS
    found = [unmoved(travel, 1000 + index, 1.0) for index in range(6)]
    assert found == [Severity.WARNING] * 4 + [Severity.RECOVERABLE] * 2


def test_the_slip_reading_never_stops() -> None:
    travel = Travel()
    assert {reason.severity for _ in range(100) for reason in travel.go(0.1, 1.0)} == {Severity.WARNING}


def ground_pair(rolled_m: complex, ground_m: complex) -> GroundPair:
    motion = GroundMotion(
        from_ns=0,
        to_ns=CYCLE_NS,
        point_m=(0.0, 0.0),
        foot_m=(0.0, 0.0),
        forward_m=ground_m.real,
        left_m=ground_m.imag,
        turn_rad=0.0,
        forward_sd_m=2e-4,
        left_sd_m=2e-4,
        turn_sd_rad=1e-3,
        scale_sd=0.015,
        direction_sd_rad=0.0,
    )
    return GroundPair(rolled_m, ground_m, 0.0, motion)


def over_ground(rolled_m: complex | list[complex], moved_m: list[complex]) -> list[int]:
    """Return the pairs, counted from 0, at which a camera's motions over the ground stop the rover."""
    rule = EntrapmentRule(EntrapmentSettings(), ROLES)
    rolled = rolled_m if isinstance(rolled_m, list) else [rolled_m] * len(moved_m)
    pairs = map(ground_pair, rolled, moved_m)
    cycles = [make_cycle(now_ns=0, ground_pairs=(pair,)) for pair in pairs]
    return [number for number, cycle in enumerate(cycles) if list(rule.check(cycle))]


def test_without_progress_over_the_ground_the_stop_comes_after_15_cm() -> None:
    assert over_ground(0.01 + 0j, [0j] * 20) == [14, 15, 16, 17, 18, 19]
    rule = EntrapmentRule(EntrapmentSettings(), DeviceRoles(wheels="wheels", camera="rear", required={}))
    for _ in range(14):
        assert list(rule.check(make_cycle(now_ns=0, ground_pairs=(ground_pair(0.01j, 0j),)))) == []
    (reason,) = rule.check(make_cycle(now_ns=0, ground_pairs=(ground_pair(0.01j, 0j),)))
    assert reason.severity is Severity.FINAL
    assert "its wheels travelled 0.15 m and rear shows no progress" in reason.text


@pytest.mark.parametrize("moved_m", [0.0002 + 0j, -0.0002 + 0j, 0.01 + 0j])
def test_a_rover_that_slips_and_moves_or_slides_back_is_not_entrapped(moved_m: complex) -> None:
    assert over_ground(0.01 + 0j, [moved_m] * 60) == []


@pytest.mark.parametrize("share", [0.11, -0.11, 0.5, 1.0])
def test_a_rover_that_slides_aside_is_not_stuck(share: float) -> None:
    assert over_ground(0.01 + 0j, [0.01j * share] * 60) == []


@pytest.mark.parametrize("share", [0.09, -0.09])
def test_one_that_creeps_along_a_wall_is(share: float) -> None:
    assert over_ground(0.01 + 0j, [0.01j * share] * 15) == [14]


def test_progress_is_seen_from_the_course_of_the_wheels() -> None:
    """Of a rover that keeps its heading round a corner; its travel is the same in both directions."""
    there_and_aside: list[complex] = [0.005 + 0j] * 7 + [0.005j] * 8
    assert over_ground([2.0 * each for each in there_and_aside], there_and_aside) == []


def test_the_window_of_the_ground_moves_with_the_wheels() -> None:
    assert over_ground(0.01 + 0j, [0.01 + 0j] * 20 + [0j] * 16) == [34, 35]


def test_wheels_that_rest_or_turn_the_rover_on_the_spot_say_nothing_of_progress() -> None:
    assert over_ground(0j, [0j] * 3000) == []


@pytest.mark.parametrize("swing_m", [0.0004, 0.004])
def test_wheels_that_hunt_at_rest_say_nothing_of_progress(swing_m: float) -> None:
    assert over_ground([swing_m + 0j, -swing_m + 0j] * 2000, [0j] * 4000) == []


@pytest.mark.parametrize("speed_m_s", [0.006, 0.012])
def test_wheels_that_spin_slowly_are_counted_at_30_frames_per_second(speed_m_s: float) -> None:
    pair_m = speed_m_s / 30.0
    stops = over_ground(pair_m + 0j, [0j] * round(0.2 / pair_m))
    assert stops[0] * pair_m == pytest.approx(0.15, abs=0.003)


def test_after_wheels_have_hunted_a_rover_that_is_stuck_is_told() -> None:
    hunted: list[complex] = [0.004 + 0j, -0.004 + 0j] * 40
    stops = over_ground(hunted + [0.01 + 0j] * 16, [0j] * 96)
    assert stops[0] <= 80 + 14
