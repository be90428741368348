"""The gyro against a heading device: which difference of their turns stops the rover."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.heading_rules import HeadingTurnRule, HeadingTurnSettings
from controllers.safety.reasons import Cycle
from controllers.safety.settings import SafetySettings, make_rules
from controllers.safety.supervisor import SafetySupervisor
from drivers.clock import nanoseconds
from drivers.samples import HeadingReference, HeadingSample, PowerSample, RateSample, Sample
from tests.controllers.safety.cycles import changed, make_cycle

ROLES = DeviceRoles(wheels="wheels", gyro="imu", headings=("compass",), required={"imu": 0.1})
NAME = f"compass {HeadingReference.MAGNETIC}"
RATE_STEP_S = 0.02
HEADING_STEP_S = 0.1

Turn = Callable[[float], float]
"""From the time in s to an angle in rad, or to its rate."""


def constant(rate_rad_s: float) -> Turn:
    return lambda _: rate_rad_s


class Bench:
    """The rule on cycles of 20 ms, a gyro of 50 Hz and a compass of 10 Hz."""

    def __init__(
        self, *, lag_s: float = 0.0, scatter_rad: float = 0.0, noise_rad: float = 0.0, **settings: float
    ) -> None:
        self.rule = HeadingTurnRule(HeadingTurnSettings.model_validate(settings), ROLES, lag_s)
        self.cycles = 0
        self.heading_rad = 0.0
        self.late_rad = 0.0
        self.lag_s = lag_s
        self.rng = np.random.default_rng(1)
        self.scatter_rad = scatter_rad
        self.noise_rad = noise_rad
        self.is_accepted = True
        self.innovations: list[Innovation] = []
        self.apart_rad = 0.0

    @property
    def now_s(self) -> float:
        return self.cycles * RATE_STEP_S

    def observe(self, sample: Sample, t_s: float | None = None) -> None:
        self.rule.observe(sample, nanoseconds(self.now_s if t_s is None else t_s))
        if isinstance(sample, HeadingSample) and sample.device == "compass":
            self.innovations.append(
                Innovation(
                    measured=Measured("compass", HeadingReference.MAGNETIC),
                    residual=0.0,
                    variance=self.noise_rad**2,
                    nis=0.0,
                    outcome=Outcome.ACCEPTED if self.is_accepted else Outcome.REJECTED,
                )
            )

    def check(
        self, *, is_still: bool = False, bias_rad_s: float = 0.0, rejected_rad_s: float | None = None
    ) -> list[Fault]:
        cycle = make_cycle(
            now_ns=nanoseconds(self.now_s),
            is_still=is_still,
            gyro_bias_rad_s=bias_rad_s,
            innovations=tuple(self.innovations),
            rejected_rad_s=rejected_rad_s,
        )
        self.innovations.clear()
        faults = list(self.rule.check(cycle))
        symptoms = [fault for fault in faults if fault.severity is Severity.SYMPTOM]
        self.apart_rad = symptoms[0].bound.gyro_rad if symptoms else 0.0
        return [fault for fault in faults if fault.severity is not Severity.SYMPTOM]

    def drive(
        self, duration_s: float, true_rad_s: Turn, gyro_rad_s: Turn, *, bias_rad_s: float = 0.0
    ) -> tuple[float, Fault] | None:
        """Turn the rover; return the time of the first reason since the call, and the reason."""
        begin_s = self.now_s
        for _ in range(round(duration_s / RATE_STEP_S)):
            self.cycles += 1
            self.heading_rad += true_rad_s(self.now_s) * RATE_STEP_S
            share = -math.expm1(-RATE_STEP_S / self.lag_s) if self.lag_s else 1.0
            self.late_rad += share * (self.heading_rad - self.late_rad)
            self.observe(rate(gyro_rad_s(self.now_s)))
            if self.cycles % round(HEADING_STEP_S / RATE_STEP_S) == 0:
                self.observe(heading(self.late_rad + self.rng.normal(0.0, self.scatter_rad)))
            found = self.check(bias_rad_s=bias_rad_s)
            if found:
                return self.now_s - begin_s, found[0]
        return None


def rate(rate_rad_s: float, device: str = "imu") -> RateSample:
    return RateSample(device=device, t_ns=0, rate_z_rad_s=rate_rad_s)


def heading(heading_rad: float, device: str = "compass") -> HeadingSample:
    return HeadingSample(
        device=device,
        t_ns=0,
        heading_rad=math.remainder(heading_rad, math.tau),
        reference=HeadingReference.MAGNETIC,
    )


def settle(bench: Bench, bias_rad_s: float = 0.0) -> None:
    """Let gyro and compass agree for longer than a comparison."""
    assert bench.drive(8.0, constant(0.0), constant(bias_rad_s), bias_rad_s=bias_rad_s) is None


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_gyro_with_the_wrong_sign_is_named_when_the_rover_turns(side: float) -> None:
    bench = Bench()
    settle(bench)
    found = bench.drive(5.0, constant(0.01 * side), constant(-0.01 * side))
    assert found is not None
    time_s, reason = found
    # The average is half a second late: 0.02 (t - 0.45) rad against 0.01 rad and a tenth of it.
    assert time_s == pytest.approx(1.2, abs=0.15)
    assert (reason.name, reason.severity) == ("gyro heading", Severity.STOP)
    assert reason.text.startswith("imu: turn of ")
    assert reason.text.endswith(
        "one of them has a wrong sign, axis or bias, or a magnetic field has turned the heading"
    )
    assert f"in 7.0 s, by {NAME} {0.007 * side:.3f} rad" in reason.text
    assert 0.0105 < reason.bound.gyro_rad < 0.0165


def test_a_step_of_the_bias_of_half_a_degree_per_second_is_named_within_five_seconds() -> None:
    for side in (1.0, -1.0):
        bench = Bench(scatter_rad=math.radians(0.3), lag_s=0.45)
        settle(bench, 0.003)
        step_rad_s = side * math.radians(0.5)
        found = bench.drive(6.0, constant(0.0), constant(0.003 + step_rad_s), bias_rad_s=0.003)
        assert found is not None
        assert 1.5 < found[0] < 5.0


def test_scatter_lag_deviation_and_bias_are_no_contradiction() -> None:
    bench = Bench(scatter_rad=math.radians(0.3), lag_s=0.45)

    def turn(now_s: float) -> float:
        return 0.4 * math.sin(0.7 * now_s)

    assert (
        bench.drive(60.0, lambda t_s: 1.1 * turn(t_s), lambda t_s: turn(t_s) + 0.02, bias_rad_s=0.02) is None
    )


def test_the_lag_of_the_heading_device_counts() -> None:
    bench = Bench(lag_s=2.0, heading_share=0.0)
    settle(bench)
    assert bench.drive(20.0, constant(0.3), constant(0.3)) is None
    bench.rule = HeadingTurnRule(HeadingTurnSettings(heading_share=0.0), ROLES, 0.0)
    bench.heading_rad = bench.late_rad = 0.0
    settle(bench)
    assert bench.drive(20.0, constant(0.3), constant(0.3)) is not None


def test_turns_are_compared_over_the_time_of_the_setting() -> None:
    # 0.0025 rad/s are 0.015 rad in 6 s and 0.01 rad in 4 s; the limit is 0.01 rad and 0.2 of it.
    for turn_s, is_named in ((6.0, True), (4.0, False)):
        bench = Bench(heading_turn_s=turn_s)
        settle(bench)
        assert (bench.drive(30.0, constant(0.0), constant(0.0025)) is not None) == is_named


def test_whole_turns_of_the_heading_do_not_count() -> None:
    bench = Bench()
    assert bench.drive(30.0, constant(1.0), constant(1.0)) is None


def test_the_bias_of_the_begin_counts() -> None:
    bench = Bench()
    settle(bench)
    # The filter takes the fault for a bias.
    assert bench.drive(5.0, constant(0.0), constant(0.02), bias_rad_s=0.02) is not None


def test_at_rest_only_the_last_second_is_kept() -> None:
    bench = Bench()
    bench.drive(1.5, constant(0.0), constant(0.0))
    assert bench.drive(1.8, constant(0.0), constant(0.05)) is not None
    assert bench.check(is_still=True) == []
    assert bench.drive(0.8, constant(0.0), constant(0.0)) is None


def test_rejected_headings_a_gap_of_the_gyro_and_one_that_is_not_finite_begin_a_new_comparison() -> None:
    def none(bench: Bench) -> None:
        bench.check()

    def reject(bench: Bench, times: int) -> None:
        bench.is_accepted = False
        for _ in range(times):
            bench.cycles += 1
            bench.observe(rate(0.01))
            bench.observe(heading(0.0))
            bench.check()
        bench.is_accepted = True

    def two_rejections(bench: Bench) -> None:
        reject(bench, 2)

    def three_rejections(bench: Bench) -> None:
        reject(bench, 3)

    def gap(bench: Bench) -> None:
        bench.cycles += 6
        bench.observe(rate(0.0))

    def not_finite(bench: Bench) -> None:
        bench.observe(rate(math.nan))

    for event, is_named in (
        (none, True),
        (two_rejections, True),
        (three_rejections, False),
        (gap, False),
        (not_finite, False),
    ):
        bench = Bench()
        settle(bench)
        assert bench.drive(0.9, constant(0.0), constant(0.01)) is None
        event(bench)
        assert (bench.drive(1.5, constant(0.0), constant(0.01)) is not None) == is_named


def test_other_samples_and_old_ones_have_no_effect() -> None:
    bench = Bench()
    settle(bench)
    for _ in range(100):
        bench.cycles += 1
        bench.observe(rate(0.0))
        bench.observe(rate(5.0), bench.now_s - 0.01)
        bench.observe(rate(5.0, "other"))
        bench.observe(heading(0.0))
        bench.observe(heading(1.0), bench.now_s - 0.01)
        bench.observe(heading(1.0, "other"))
        bench.observe(heading(math.nan))
        bench.observe(PowerSample(device="imu", t_ns=0, voltage_v=24.0))
        assert bench.check() == []


def test_less_than_three_headings_a_second_are_not_judged() -> None:
    for step_s, is_named in ((0.3, True), (0.6, False)):
        bench = Bench()
        found: list[Fault] = []
        for index in range(500):
            bench.cycles += 1
            bench.observe(rate(0.1))
            if index % round(step_s / RATE_STEP_S) == 0:
                bench.observe(heading(0.0))
            found += bench.check()
        assert bool(found) == is_named


def test_two_seconds_of_headings_are_needed() -> None:
    bench = Bench()
    found = bench.drive(5.0, constant(0.0), constant(0.5))
    assert found is not None
    assert found[0] == pytest.approx(2.1)


def test_headings_rejected_now_and_then_do_not_hide_a_bias() -> None:
    bench = Bench()
    settle(bench)
    found = None
    for _ in range(10):
        found = found or bench.drive(0.4, constant(0.0), constant(0.01))
        bench.is_accepted = False
        bench.heading_rad += 1.0
        found = found or bench.drive(0.1, constant(0.0), constant(0.01))
        bench.heading_rad -= 1.0
        bench.is_accepted = True
    assert found is not None


@pytest.mark.parametrize("amplitude_rad", [0.02, 0.05])
def test_the_deviation_along_a_straight_line_is_no_contradiction(amplitude_rad: float) -> None:
    """A wave of 4 m at 0.2 m/s; successive headings hardly differ."""
    bench = Bench(scatter_rad=0.005, noise_rad=0.03)
    wave_rad_s = math.tau * 0.2 / 4.0

    def deviation_rate(now_s: float) -> float:
        return amplitude_rad * wave_rad_s * math.cos(wave_rad_s * now_s)

    assert bench.drive(60.0, deviation_rate, constant(0.0)) is None


def test_the_noise_of_a_heading_counts_with_three_standard_deviations_of_a_difference() -> None:
    # 0.01 + 3 * sqrt(2) * 0.02 rad and a fifth of the turn of 0.118 rad.
    for turn_rad, is_named in ((0.116, False), (0.122, True)):
        bench = Bench(noise_rad=0.02)
        settle(bench)
        assert bench.drive(1.0, constant(0.0), constant(turn_rad)) is None
        assert (bench.drive(3.0, constant(0.0), constant(0.0)) is not None) == is_named


def test_headings_that_the_filter_does_not_use_are_not_judged() -> None:
    bench = Bench()
    for _ in range(300):
        bench.cycles += 1
        bench.observe(rate(0.1))
        bench.observe(heading(0.0))
        bench.innovations.clear()
        assert bench.check() == []


def test_a_heading_without_a_number_says_nothing_about_the_noise() -> None:
    bench = Bench()
    settle(bench)
    bench.innovations.append(
        Innovation(
            measured=Measured("compass", HeadingReference.MAGNETIC),
            residual=None,
            variance=None,
            nis=None,
            outcome=Outcome.REJECTED,
        )
    )
    assert bench.check() == []
    # One such heading neither hides a wrong gyro nor begins a new comparison.
    assert bench.drive(6.0, constant(0.1), constant(-0.1)) is not None


def test_a_gyro_that_dies_is_no_contradiction() -> None:
    bench = Bench()
    settle(bench)
    for _ in range(300):
        bench.cycles += 1
        bench.heading_rad += 0.3 * RATE_STEP_S
        bench.observe(heading(bench.heading_rad))
        assert bench.check() == []


@pytest.mark.parametrize("others", [0, 1])
def test_a_rate_that_the_filter_rejects_is_not_integrated(others: int) -> None:
    bench = Bench()
    settle(bench)
    bench.cycles += 1
    bench.observe(rate(90.0), bench.now_s - 0.015)
    if others:
        bench.observe(rate(95.0))
    bench.check(rejected_rad_s=90.0)
    assert bench.drive(8.0, constant(0.0), constant(0.0)) is None
    bench.cycles += 1
    bench.observe(rate(90.0), bench.now_s - 0.015)
    bench.observe(rate(0.0))
    bench.check()
    assert bench.drive(8.0, constant(0.0), constant(0.0)) is None


def test_without_a_gyro_there_is_no_rule() -> None:
    for gyro, count in (("imu", 1), (None, 0)):
        roles = replace(ROLES, gyro=gyro)
        rules = make_rules(SafetySettings(), roles, 4, 0.0)
        assert sum(isinstance(rule, HeadingTurnRule) for rule in rules) == count


class Supervised(HeadingTurnRule):
    """The rule as the supervisor of a rover runs it."""

    def __init__(self, *lags_s: float) -> None:
        self.supervisor = SafetySupervisor(SafetySettings(), ROLES, 2, *lags_s)

    def observe(self, sample: Sample, t_ns: int) -> None:
        self.supervisor.observe(sample, t_ns)

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        self.supervisor.update(changed(cycle, motion_ns=cycle.now_ns))
        reasons = self.supervisor.reason
        yield from [Fault("imu", Cause.GYRO_HEADING, reasons)] * ("turn of" in reasons)


@pytest.mark.parametrize(("lags_s", "true_lag_s"), [((), 0.0), ((0.9,), 0.9)])
def test_the_supervisor_knows_the_lag_of_the_headings(lags_s: tuple[float, ...], true_lag_s: float) -> None:
    bench = Bench(lag_s=true_lag_s)
    bench.rule = Supervised(*lags_s)
    wave: Turn = lambda t_s: 1.5 * math.cos(2.0 * t_s)  # noqa: E731
    assert bench.drive(12.0, wave, wave) is None


def test_a_wrong_lag_is_noticed() -> None:
    bench = Bench(lag_s=0.9)
    bench.rule = Supervised()
    wave: Turn = lambda t_s: 1.5 * math.cos(2.0 * t_s)  # noqa: E731
    assert bench.drive(12.0, wave, wave) is not None


def test_the_least_noise_of_the_headings_counts() -> None:
    bench = Bench(noise_rad=0.02)
    settle(bench)
    bench.noise_rad = 0.2
    assert bench.drive(1.0, constant(0.0), constant(0.15)) is None
    assert bench.drive(3.0, constant(0.0), constant(0.0)) is not None


@pytest.mark.parametrize(("turn_rad", "is_named"), [(0.055, False), (0.075, True)])
def test_three_standard_errors_of_both_averages_count(turn_rad: float, is_named: bool) -> None:
    """Headings 0.02 rad to both sides in turn: a variance of 0.0008 rad2, averages of 11 and 10."""
    bench = Bench()
    found = None
    for index in range(500):
        bench.cycles += 1
        bench.observe(rate(turn_rad if 200 <= index < 250 else 0.0))
        if index % 5 == 0:
            bench.observe(heading(0.02 * (-1.0) ** (index // 5)))
        found = found or bench.check()
    assert bool(found) == is_named


def compared(
    headings: Sequence[tuple[float, float]],
    *,
    bias: Turn = lambda _: 0.0,
    gyro: Callable[[float], Sequence[float]] = lambda _: (0.0,),
    gyro_step_s: float = 0.02,
    **settings: float,
) -> str:
    """Return the first reason for headings of these times in s and angles in rad, and rates of the gyro."""
    rule = HeadingTurnRule(HeadingTurnSettings.model_validate(settings), ROLES, 0.0)
    coming = list(headings)
    for index in range(1 + round(headings[-1][0] / gyro_step_s)):
        now_s = index * gyro_step_s
        for rate_rad_s in gyro(now_s):
            rule.observe(rate(rate_rad_s), nanoseconds(now_s))
        innovations = []
        while coming and coming[0][0] <= now_s + 1e-9:
            t_s, heading_rad = coming.pop(0)
            rule.observe(heading(heading_rad), nanoseconds(t_s))
            innovations.append(
                Innovation(
                    measured=Measured("compass", HeadingReference.MAGNETIC),
                    residual=0.0,
                    variance=0.0,
                    nis=0.0,
                    outcome=Outcome.ACCEPTED,
                )
            )
        cycle = make_cycle(
            now_ns=nanoseconds(now_s), innovations=tuple(innovations), gyro_bias_rad_s=bias(now_s)
        )
        for reason in rule.check(cycle):
            return reason.text
    return ""


QUARTERS_S = [3.0 + 0.25 * index for index in range(9)]


def test_the_first_and_the_last_second_are_averaged_with_the_bias_at_the_end_of_the_first() -> None:
    """Headings at 0, 0.25, ..., 1 s and above 1 to 2 s; the bias is that at 1 s."""
    angles = [0.01, 0.02, 0.04, 0.08, 0.16, 3.0, 2.0, 2.5, 3.1]
    text = compared(
        [(0.0, 0.0), *zip(QUARTERS_S, angles, strict=True)][1:],
        bias=lambda t_s: 0.1 * t_s,
        gyro_step_s=0.05,
    )
    turned_rad = sum(angles[5:]) / 4.0 - sum(angles[:5]) / 5.0
    by_bias_rad = -0.1 * 4.0 * (1.625 - 0.5)
    assert text.startswith(f"imu: turn of {by_bias_rad:.3f} rad in 2.0 s, by {NAME} {turned_rad:.3f} rad: ")


def test_the_turn_of_the_gyro_is_its_integral() -> None:
    steps = [(t_s, 0.0) for t_s in QUARTERS_S]
    text = compared(steps, gyro=lambda _: (0.4,))
    assert text.startswith(f"imu: turn of {0.4 * (1.625 - 0.5):.3f} rad in 2.0 s")


def test_three_headings_in_each_average_suffice() -> None:
    times_s = [0.34 * index for index in range(7)]
    assert compared([(t_s, 0.0 if t_s < 1.1 else 1.0) for t_s in times_s]) != ""
    assert compared([(t_s, 0.0 if t_s < 1.1 else 1.0) for t_s in [0.0, 0.5, 1.0, 1.5, 2.0]]) == ""


def test_a_difference_of_exactly_the_limit_is_no_contradiction() -> None:
    steps = [(t_s, 0.0 if index < 5 else 0.5) for index, t_s in enumerate(QUARTERS_S)]
    assert compared(steps, heading_difference_rad=0.5, heading_share=0.0) == ""
    assert compared(steps, heading_difference_rad=0.499, heading_share=0.0) != ""


def test_a_gyro_may_be_as_slow_as_its_age_limit() -> None:
    steps = [(t_s, 0.0 if index < 5 else 0.5) for index, t_s in enumerate(QUARTERS_S)]
    assert compared(steps, gyro_step_s=0.1) != ""
    assert compared(steps, gyro_step_s=0.125) == ""


def test_a_second_reading_of_the_gyro_at_the_same_time_is_not_used() -> None:
    steps = [(t_s, 0.0 if index < 5 else 0.5) for index, t_s in enumerate(QUARTERS_S)]
    assert compared(steps, gyro=lambda _: (0.0, 3.0)).startswith("imu: turn of 0.000 rad")


def test_headings_of_20_hz_are_all_used_and_of_faster_ones_a_part() -> None:
    """The scatter of headings to both sides in turn explains the turn, unless one side is left out."""
    for step_s, is_explained in ((0.05, True), (0.04, False)):
        zigzag = [
            (step_s * index, 0.02 * (-1.0) ** index + (0.03 if step_s * index > 1.0 else 0.0))
            for index in range(round(2.0 / step_s) + 1)
        ]
        assert (compared(zigzag) == "") == is_explained


def test_while_the_gyro_is_silent_nothing_is_compared() -> None:
    steps = [(0.25 * index, 0.0 if index < 9 else 1.0) for index in range(20)]
    assert compared(steps) != ""
    assert compared(steps, gyro=lambda t_s: (0.0,) if t_s < 2.0 else ()) == ""


@pytest.mark.parametrize(("silent_s", "is_named"), [(0.1, True), (0.12, False)])
def test_a_reason_ends_when_the_gyro_is_silent_for_longer_than_its_age_limit(
    silent_s: float, is_named: bool
) -> None:
    bench = Bench()
    settle(bench)
    assert bench.drive(3.0, constant(0.0), constant(0.3)) is not None
    bench.cycles += round(silent_s / RATE_STEP_S)
    assert bool(bench.check()) == is_named


def test_a_yaw_rate_of_a_heading_device_is_not_taken_for_a_heading() -> None:
    bench = Bench()
    bench.observe(rate(0.5, device="compass"))
    assert list(bench.rule.check(make_cycle(now_ns=nanoseconds(1.0)))) == []


def test_a_shift_that_noise_does_not_explain_leaves_the_yaw_doubtful() -> None:
    """Below the limit of the stop, where a magnetic field or the gyro may have shifted: the size of it."""
    bench = Bench(scatter_rad=0.005, noise_rad=0.05)
    assert bench.drive(20.0, constant(0.0), constant(0.0)) is None
    assert bench.apart_rad == 0.0
    bench.late_rad += 0.05
    bench.heading_rad += 0.05
    assert bench.drive(4.0, constant(0.0), constant(0.0)) is None
    assert bench.apart_rad == pytest.approx(0.05, abs=0.01)
    assert bench.drive(60.0, constant(0.0), constant(0.0)) is None
    assert bench.apart_rad == pytest.approx(0.05, abs=0.01)


@pytest.mark.parametrize(("rest_s", "is_doubted"), [(5.0, True), (12.0, False)])
def test_the_doubt_ends_when_both_have_been_together_again_for_some_time(
    rest_s: float, is_doubted: bool
) -> None:
    bench = Bench(scatter_rad=0.002, noise_rad=0.05)
    bench.drive(10.0, constant(0.0), constant(0.0))
    for shift_rad, duration_s in ((0.05, 3.0), (-0.05, rest_s)):
        bench.heading_rad += shift_rad
        bench.late_rad += shift_rad
        assert bench.drive(duration_s, constant(0.0), constant(0.0)) is None
    assert bool(bench.apart_rad) is is_doubted


def test_a_drive_with_turns_and_noise_alone_leaves_no_doubt() -> None:
    bench = Bench(scatter_rad=0.01, noise_rad=0.02)
    turn = lambda t_s: 0.3 * math.sin(0.7 * t_s)  # noqa: E731
    for _ in range(600):
        assert bench.drive(0.2, turn, turn) is None
        assert bench.apart_rad == 0.0
