"""Readings of the gyro that are wrong by themselves: stuck, too great, not the bias at rest."""

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn
from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.gyro_reading_rules import (
    GreatestRateRule,
    GyroJumpRule,
    GyroReadingSettings,
    GyroRestRule,
    StuckGyroRule,
)
from controllers.safety.reasons import StopRule
from drivers.clock import nanoseconds
from drivers.samples import PowerSample, RateSample, Sample
from tests.controllers.safety.cycles import make_cycle

ROLES = DeviceRoles(wheels="wheels", gyro="imu", required={"imu": 0.1})
SETTINGS = GyroReadingSettings(gyro_rest_s=0.3)
STEP_S = 0.02


def reading(rate_rad_s: float, device: str = "imu") -> RateSample:
    return RateSample(device=device, t_ns=0, rate_z_rad_s=rate_rad_s)


class Bench:
    """One rule on a cycle of 20 ms."""

    def __init__(self, rule: StopRule) -> None:
        self.rule = rule
        self.now_s = 0.0

    def cycle(
        self,
        *samples: Sample,
        is_still: bool = False,
        turns: bool = False,
        bias_rad_s: float = 0.0,
        rejected_rad_s: float | None = None,
        turned_s: float = STEP_S,
    ) -> list[Fault]:
        """Return the reasons of one cycle; with `turns` the wheels turn the rover by 0.5 rad/s."""
        self.now_s += STEP_S
        for sample in samples:
            self.rule.observe(sample, 0)
        wheels = WheelTurn(duration_s=turned_s, left_rad=0.5 * STEP_S)
        return list(
            self.rule.check(
                make_cycle(
                    now_ns=nanoseconds(self.now_s),
                    is_still=is_still,
                    turn=TurnEvidence(gyro_rad=0.1 * STEP_S, wheels=wheels) if turns else None,
                    gyro_bias_rad_s=bias_rad_s,
                    rejected_rad_s=rejected_rad_s,
                )
            )
        )


def stuck() -> Bench:
    return Bench(StuckGyroRule(SETTINGS, ROLES))


def test_a_reading_that_never_changes_while_the_wheels_turn_is_stuck_after_a_second() -> None:
    bench = stuck()
    bench.cycle(reading(0.2))
    for _ in range(49):
        assert bench.cycle(reading(0.2), reading(0.2, "other"), turns=True) == []
    bench.cycle(reading(0.2), turns=True)
    (reason,) = bench.cycle(reading(0.2), turns=True)
    assert (reason.name, reason.severity) == ("gyro stuck", Severity.STOP)
    assert reason.text == "imu: yaw rate stuck at 0.2 rad/s for 1 s while the wheels turned"
    assert reason.bound.gyro_rad == pytest.approx(0.4 * 1.02)
    assert bench.cycle(reading(0.2)) == [reason]


def test_a_gyro_is_not_stuck_because_the_wheels_were_silent() -> None:
    """Meanwhile the rover has come to rest, where a coarse gyro may show one value."""
    bench = stuck()
    for _ in range(20):
        assert bench.cycle(reading(0.2), turns=True) == []
    assert bench.cycle(reading(0.2), turns=True, turned_s=1.0) == []


def test_only_a_change_clears_a_stuck_reading_not_a_rest() -> None:
    bench = stuck()
    for _ in range(60):
        found = bench.cycle(reading(0.2), turns=True)
    assert found
    assert bench.cycle(is_still=True) == found
    assert bench.cycle(reading(0.2), turns=True, is_still=True) == found
    assert bench.cycle(reading(0.2001), is_still=True) == []
    for _ in range(49):
        assert bench.cycle(reading(0.2001), turns=True) == []
    bench.cycle(turns=True)
    (reason,) = bench.cycle(turns=True)
    assert reason.bound.gyro_rad == pytest.approx(0.4 * 1.02)


def test_a_rest_begins_the_time_of_a_reading_anew() -> None:
    bench = stuck()
    for _ in range(40):
        bench.cycle(reading(0.2), turns=True)
    bench.cycle(is_still=True)
    for _ in range(49):
        assert bench.cycle(reading(0.2), turns=True) == []


def test_other_samples_do_not_change_the_reading() -> None:
    bench = stuck()
    power = PowerSample(device="imu", t_ns=0, voltage_v=24.0)
    for index in range(60):
        found = bench.cycle(reading(0.2), power, reading(float(index), "other"), turns=True)
    assert found


def test_rates_that_are_too_great_stop_when_no_other_has_come_for_the_age_limit() -> None:
    bench = Bench(GreatestRateRule(ROLES))
    for _ in range(2):
        for _ in range(5):
            assert bench.cycle(rejected_rad_s=30.0) == []
        assert bench.cycle(rejected_rad_s=None) == []
    for _ in range(5):
        bench.cycle(rejected_rad_s=30.0)
    expected = Fault("imu", Cause.GYRO_RATE, "imu: yaw rate 30.0 rad/s: the rover cannot turn that fast")
    assert bench.cycle(rejected_rad_s=30.0) == [expected]


def noisy(mean_rad_s: float, count: int = 2) -> list[RateSample]:
    """Return readings whose mean is exact and whose scatter is 1 mrad/s."""
    return [reading(mean_rad_s + (0.001 if i % 2 else -0.001)) for i in range(count)]


def rest_bench() -> Bench:
    return Bench(GyroRestRule(SETTINGS, ROLES))


def rest(bench: Bench, mean_rad_s: float, bias_rad_s: float, duration_s: float = 0.4) -> list[list[Fault]]:
    """Return the reasons of every cycle of a rest."""
    return [
        bench.cycle(*noisy(mean_rad_s), is_still=True, bias_rad_s=bias_rad_s)
        for _ in range(round(duration_s / STEP_S))
    ]


def drive(bench: Bench, duration_s: float, bias_rad_s: float) -> None:
    for _ in range(round(duration_s / STEP_S)):
        assert bench.cycle(*noisy(9.0), bias_rad_s=bias_rad_s) == []


def flat(found: Sequence[Sequence[Fault]]) -> list[Fault]:
    return [reason for reasons in found for reason in reasons]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_gyro_that_does_not_read_its_bias_at_rest_keeps_the_rover_stopped(side: float) -> None:
    bench = rest_bench()
    found = rest(bench, side * 0.07, side * 0.01)
    # An average takes 0.3 s: 15 periods after the first cycle.
    assert found[:15] == [[]] * 15
    expected = Fault(
        "imu",
        Cause.GYRO_OFFSET,
        f"imu: reads {side * 0.07:.3f} rad/s at rest, its bias was {side * 0.01:.3f} rad/s",
    )
    assert found[15:] == [[expected]] * 5
    assert flat(rest(bench, side * 0.055, side * 0.01)[15:]) == []


def test_a_bias_that_is_right_at_rest_gives_no_reason() -> None:
    bench = rest_bench()
    assert flat(rest(bench, 0.05, 0.01, 5.0)) == []
    drive(bench, 2.0, 0.05)
    assert flat(rest(bench, 0.0555, 0.05, 5.0)) == []


@pytest.mark.parametrize("step_rad_s", [0.0087, -0.0087])
def test_a_bias_that_changed_between_two_rests_is_named_once_with_what_it_did_to_the_yaw(
    step_rad_s: float,
) -> None:
    bench = rest_bench()
    rest(bench, 0.02, 0.02)
    drive(bench, 10.0, 0.02)
    (reason,) = flat(rest(bench, 0.02 + step_rad_s, 0.02, 3.0))
    assert (reason.name, reason.severity) == ("gyro bias", Severity.STOP)
    # 10 s on the way, less the first cycle, and 0.34 s until the average is complete.
    driven_s = 10.0 + 0.3
    assert reason.text == (
        f"imu: bias changed by {step_rad_s:.4f} rad/s while driving for {driven_s:.1f} s: the yaw may be "
        f"{0.0087 * driven_s:.2f} rad wrong"
    )
    assert reason.bound.gyro_rad == pytest.approx(0.0087 * driven_s, rel=0.01)


def test_a_change_counts_from_the_bias_at_the_end_of_the_rest() -> None:
    bench = rest_bench()
    rest(bench, 0.02, 0.0)
    bench.cycle(bias_rad_s=0.02)
    drive(bench, 2.0, 0.5)
    assert flat(rest(bench, 0.02, 0.02)) == []


def test_a_noisy_average_is_weak_evidence_of_a_change() -> None:
    bench = rest_bench()
    rest(bench, 0.0, 0.0)
    drive(bench, 2.0, 0.0)
    scatter = [reading(0.009 + (0.02 if i % 2 else -0.02)) for i in range(2)]
    # Standard error 0.02 / sqrt(30): four of them and 6 mrad/s are more than 9 mrad/s.
    assert flat([bench.cycle(*scatter, is_still=True) for _ in range(20)]) == []


def test_one_reading_is_no_average_and_useless_ones_do_not_count() -> None:
    bench = rest_bench()
    useless: list[Sample] = [
        reading(math.nan),
        reading(math.inf),
        reading(5.0, "other"),
        PowerSample(device="imu", t_ns=0, voltage_v=24.0),
    ]
    for index in range(30):
        samples = [*useless, reading(1.0)] if index == 2 else useless
        assert bench.cycle(*samples, is_still=True) == []
    (reason,) = bench.cycle(reading(1.0), is_still=True)
    assert reason.text == "imu: reads 1.000 rad/s at rest, its bias was 0.000 rad/s"


def test_readings_from_before_the_rest_do_not_count() -> None:
    bench = rest_bench()
    drive(bench, 0.1, 0.0)
    bench.rule.observe(reading(9.0), 0)
    assert flat(rest(bench, 0.0, 0.0)) == []


class Jumps:
    """A jump rule and the time of its readings."""

    def __init__(self) -> None:
        self.rule = GyroJumpRule(SETTINGS, ROLES)
        self.now_s = 0.0
        self.rate_rad_s = 0.0

    def read(
        self,
        *rates_rad_s: float,
        period_s: float = 0.02,
        is_still: bool = False,
        wheels_rad_s: float = 0.1,
        judged: bool = True,
    ) -> list[Fault]:
        """Return the reasons after these readings, and after gyro and wheels have been compared."""
        for rate_rad_s in rates_rad_s:
            self.now_s += period_s
            self.rule.observe(reading(rate_rad_s), nanoseconds(self.now_s))
            self.rule.observe(reading(-9.0 * rate_rad_s, "other"), nanoseconds(self.now_s))
            self.rate_rad_s = rate_rad_s
        found: list[Fault] = []
        for _ in range(3 if judged else 1):
            wheels = WheelTurn(duration_s=STEP_S, left_rad=wheels_rad_s * STEP_S)
            evidence = TurnEvidence(gyro_rad=self.rate_rad_s * STEP_S, wheels=wheels)
            now_ns = nanoseconds(self.now_s)
            found = list(self.rule.check(make_cycle(now_ns=now_ns, is_still=is_still, turn=evidence)))
        return found


@pytest.mark.parametrize(("rates", "jump"), [((0.1, 0.6, 0.7), "0.50"), ((0.1, -0.4, -0.45), "-0.50")])
def test_a_reading_that_jumps_and_stays_is_named_until_the_wheels_are_at_rest(
    rates: tuple[float, ...], jump: str
) -> None:
    jumps = Jumps()
    jumps.read(0.1)
    (reason,) = jumps.read(*rates)
    assert (reason.name, reason.severity) == ("gyro jump", Severity.STOP)
    assert reason.text == f"imu: yaw rate jumped by {jump} rad/s within 0.05 s"
    assert reason.bound.gyro_rad == pytest.approx(0.5 * 0.02)
    (reason,) = jumps.read(*[rates[-1]] * 50)
    assert reason.bound.gyro_rad == pytest.approx(0.5 * 1.02)
    (reason,) = jumps.read(5.0, 5.0, 5.0)
    assert reason.text == f"imu: yaw rate jumped by {jump} rad/s within 0.05 s"
    assert jumps.read(5.0, is_still=True) == []
    assert jumps.read(5.0) == []


@pytest.mark.parametrize(
    "rates",
    [
        (0.1, 0.6, 0.1, 0.1),
        (0.1, 0.6, -0.5, 0.1),
        (0.1, 0.45, 0.8, 0.45),
        (0.1, 0.6, 0.27, 0.1),
        (0.1, 0.6, 0.1, 0.6, 0.1),
        (math.nan, 0.1, math.nan, 0.1, math.nan),
        (0.0, 0.3, 0.6, 0.9, 0.6, 0.3, 0.0),
    ],
)
def test_one_wrong_reading_and_a_steady_change_are_no_jump(rates: tuple[float, ...]) -> None:
    settings = GyroReadingSettings(gyro_jump_rad_s=0.36)
    jumps = Jumps()
    jumps.rule = GyroJumpRule(settings, ROLES)
    assert jumps.read(*rates) == []


@pytest.mark.parametrize(("wheels_rad_s", "is_jump"), [(0.34, True), (0.36, False), (-0.3, True)])
def test_a_jump_of_the_wheels_too_is_none_of_the_gyro(wheels_rad_s: float, is_jump: bool) -> None:
    jumps = Jumps()
    jumps.read(0.1)
    assert jumps.read(0.6, 0.6, wheels_rad_s=wheels_rad_s, judged=False) == []
    assert bool(jumps.read(wheels_rad_s=wheels_rad_s)) == is_jump


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("rates", "is_jump"), [((0.6, 0.28), True), ((0.6, 0.26), False)])
def test_half_of_the_limit_must_stay_of_a_jump(rates: tuple[float, ...], is_jump: bool, side: float) -> None:
    jumps = Jumps()
    jumps.read(0.1 * side, wheels_rad_s=0.0)
    found = jumps.read(*(side * rate for rate in rates), wheels_rad_s=-0.2 * side)
    assert bool(found) == is_jump


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_jump_while_the_rover_turns_ever_faster_is_one_of_the_gyro(side: float) -> None:
    jumps = Jumps()
    turn_rad_s = 0.0
    for _ in range(8):
        turn_rad_s += 0.1
        assert jumps.read(side * turn_rad_s, wheels_rad_s=side * turn_rad_s, judged=False) == []
    for _ in range(4):
        turn_rad_s += 0.1
        found = jumps.read(side * (turn_rad_s + 0.5), wheels_rad_s=side * turn_rad_s, judged=False)
    assert [reason.name for reason in found] == ["gyro jump"]


def test_a_jump_in_the_first_cycles_after_a_rest_is_compared_with_the_rest() -> None:
    jumps = Jumps()
    jumps.read(0.9, 0.9, wheels_rad_s=0.9)
    jumps.read(0.0, 0.0, is_still=True)
    for _ in range(4):
        found = jumps.read(0.5, wheels_rad_s=0.0, judged=False)
    assert [reason.name for reason in found] == ["gyro jump"]


def test_after_a_pause_of_the_readings_any_change_is_possible() -> None:
    jumps = Jumps()
    assert jumps.read(0.0, 1.0, 2.0, 3.0, period_s=0.051) == []
    jumps.rule.observe(PowerSample(device="imu", t_ns=0, voltage_v=24.0), 0)
    jumps.read(3.0, period_s=0.05)
    assert jumps.read(4.0, 4.0, period_s=0.05) != []


def turning(wheels_rad_s: float, gyro_rad_s: float = 0.0) -> TurnEvidence:
    duration_s = 0.25
    return TurnEvidence(
        gyro_rad=gyro_rad_s * duration_s,
        wheels=WheelTurn(duration_s=duration_s, left_rad=wheels_rad_s * duration_s),
    )


def test_a_reading_may_stay_for_exactly_the_limit_and_there_must_be_one() -> None:
    slow = replace(ROLES, required={"imu": 0.1, "wheels": 0.5})
    rule = StuckGyroRule(GyroReadingSettings(gyro_stuck_s=1.0), slow)
    cycle = make_cycle(now_ns=0, turn=turning(0.5))
    for _ in range(8):
        assert list(rule.check(cycle)) == []
    rule.observe(reading(0.2), 0)
    for _ in range(4):
        assert list(rule.check(cycle)) == []
    assert list(rule.check(cycle)) != []


def test_a_change_of_exactly_the_limit_is_no_jump() -> None:
    jumps = Jumps()
    jumps.rule = GyroJumpRule(GyroReadingSettings(gyro_jump_rad_s=0.5), ROLES)
    assert jumps.read(0.25, 0.75, 0.75) == []
    assert jumps.read(0.2, 0.2) != []


def after_a_jump(*wheels_rad_s: float) -> list[bool]:
    """Let the reading jump by 0.5 rad/s three cycles before the end; return which cycles gave a reason."""
    rule = GyroJumpRule(SETTINGS, ROLES)
    found: list[bool] = []
    rule.observe(reading(0.0), 0)
    for index, rate_rad_s in enumerate(wheels_rad_s):
        gyro_rad_s = 0.5 if index >= len(wheels_rad_s) - 3 else 0.0
        if index == len(wheels_rad_s) - 3:
            rule.observe(reading(0.5), nanoseconds(0.02))
            rule.observe(reading(0.5), nanoseconds(0.04))
        cycle = make_cycle(now_ns=nanoseconds(0.04), turn=turning(rate_rad_s, gyro_rad_s))
        found.append(bool(list(rule.check(cycle))))
    return found


def test_the_wheels_have_three_cycles_to_show_a_jump_of_their_own() -> None:
    assert after_a_jump(0.0, 0.0, 0.0) == [False, False, True]
    assert after_a_jump(0.0, 0.0, 0.0, 0.0) == [False] * 3 + [True]


@pytest.mark.parametrize(
    ("wheels_rad_s", "is_jump"),
    [
        ((0.0, 0.0, 0.0, 0.0, 0.0, 0.26), False),
        ((0.0, 0.0, 0.0, 0.0, 0.0, 0.25), True),
        ((0.0, 0.0, 0.26, 0.26, 0.26, 0.26), False),
        ((0.0, 0.26, 0.26, 0.26, 0.26, 0.26), True),
        ((0.0, 0.0, 0.26, 0.26, 0.26, 0.26, 0.26), True),
    ],
)
def test_the_wheels_are_compared_from_two_cycles_before_the_jump_on(
    wheels_rad_s: tuple[float, ...], is_jump: bool
) -> None:
    *before, last = after_a_jump(*wheels_rad_s)
    assert (before, last) == ([False] * len(before), is_jump)


def test_a_jump_of_the_wheels_in_the_third_cycle_settles_it() -> None:
    rule = GyroJumpRule(SETTINGS, ROLES)
    for t_s, rate_rad_s in ((0.0, 0.0), (0.02, 0.5), (0.04, 0.5)):
        rule.observe(reading(rate_rad_s), nanoseconds(t_s))
    for wheels_rad_s in (0.0, 0.0, 0.5, 0.5, 0.5):
        assert list(rule.check(make_cycle(now_ns=0, turn=turning(wheels_rad_s, 0.5)))) == []


def test_one_average_follows_the_other_without_a_pause() -> None:
    bench = rest_bench()
    rest(bench, 0.07, 0.0, 16 * STEP_S)
    found = rest(bench, 0.0, 0.0, 16 * STEP_S)
    assert [bool(reasons) for reasons in found] == [True] * 14 + [False] * 2


def test_a_change_and_an_offset_of_exactly_the_limit_give_no_reason() -> None:
    settings = GyroReadingSettings(gyro_rest_s=0.3, gyro_rest_rad_s=0.0625, gyro_step_rad_s=0.0625)
    bench = Bench(GyroRestRule(settings, ROLES))

    def steady(rate_rad_s: float, **flags: bool) -> list[Fault]:
        found = [bench.cycle(*[reading(rate_rad_s)] * 2, **flags) for _ in range(20)]
        return flat(found)

    steady(0.0, is_still=True)
    steady(0.0)
    assert steady(0.0625, is_still=True) == []
    steady(0.0)
    assert {reason.name for reason in steady(0.063, is_still=True)} == {"gyro bias", "gyro rest"}


@pytest.mark.parametrize(("wheels_rad_s", "is_jump"), [(0.0, True), (0.5, False)])
def test_in_the_first_cycle_after_a_rest_both_rates_are_compared_with_zero(
    wheels_rad_s: float, is_jump: bool
) -> None:
    rule = GyroJumpRule(SETTINGS, ROLES)
    for _ in range(6):
        list(rule.check(make_cycle(now_ns=0, turn=turning(0.3, 0.9))))
    list(rule.check(make_cycle(now_ns=0, is_still=True)))
    for t_s, rate_rad_s in ((0.0, 0.0), (0.02, 0.5), (0.04, 0.5)):
        rule.observe(reading(rate_rad_s), nanoseconds(t_s))
    found = [list(rule.check(make_cycle(now_ns=0, turn=turning(wheels_rad_s, 0.5)))) for _ in range(3)]
    assert bool(found[-1]) == is_jump
