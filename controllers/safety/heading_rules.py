"""Stop rule that compares the turn by the gyro with the turn by a heading device."""

import math
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from itertools import pairwise
from statistics import fmean
from typing import Annotated, NamedTuple

from pydantic import Field

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.parameters import ESTIMATION
from controllers.fault import Bound, Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import nanoseconds, seconds
from drivers.safety_event import AFTER_A_WAIT, Outcome, SafetyEvent
from drivers.samples import HeadingSample, RateSample, Sample
from drivers.settings import Settings


class HeadingTurnSettings(Settings):
    """Which differences between gyro and heading devices their errors can explain.

    Attributes:
        heading_turn_s: Rotations by gyro and by headings are compared over this time, less at first. Headings
            that come less often than three times a second are not compared.
        heading_difference_rad: The rover stops when they differ by more than the sum of this, `heading_share`
            of the rotation, three standard errors of the headings, and 3 √2 times the noise of a heading in
            the filter; greater than the resolution of the headings. With `heading_noise_rad` of 0.05 rad that
            is at least 0.22 rad: a wrong sign is found when the rover has turned by 0.12 rad, a step of the
            bias above 2.7 deg/s. For a better compass set a smaller `heading_noise_rad`.
        heading_share: Share of the rotation by which deviation and lag of a compass may falsify it.
    """

    heading_turn_s: Annotated[float, Field(ge=1.0, le=60.0)] = 6.0
    heading_difference_rad: Annotated[float, Field(ge=0.001, le=3.0)] = 0.01
    heading_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.2


AVERAGE_S = 1.0
"""Headings are averaged over this time at both ends of the comparison; chosen by hand."""

LEAST_STEP_S = 0.05
"""Headings that come faster are left out: their errors are hardly independent; chosen by hand."""

READINGS = 3
"""Fewer headings have no scatter to judge them by; chosen by hand."""

STANDARD_ERRORS = 3.0
"""Averages and correlated errors count with this many standard deviations; chosen by hand."""

REJECTIONS = 3
"""After this many rejected headings in a row the comparison begins anew; chosen by hand."""


class _Heading(NamedTuple):
    """A heading and what the gyro had turned by then, since any time, as late as the heading device.

    Attributes:
        offset_rad: The heading less the turn by the gyro without the bias, as that was estimated.
    """

    t_ns: int
    heading_rad: float
    gyro_rad: float
    bias_rad_s: float
    offset_rad: float


class _Doubt:
    """How far headings and gyro have come apart, since noise first did not explain it.

    It ends when they have been together again for some time: two errors may meet for a moment.

    Args:
        duration_s: So long.

    Attributes:
        apart_rad: 0 without a doubt.
    """

    def __init__(self, duration_s: float) -> None:
        self._duration_ns = nanoseconds(duration_s)
        self._begin_rad: float | None = None
        self._apart_ns = 0
        self.apart_rad = 0.0

    def take(self, now_ns: int, first_rad: float, last_rad: float, noise_rad: float, turn_rad: float) -> None:
        """Take a comparison.

        Args:
            now_ns: Its time.
            first_rad: Mean offset at its begin.
            last_rad: The same at its end.
            noise_rad: Their difference that noise explains.
            turn_rad: And that the rotation in between explains beside it.
        """
        least_rad = noise_rad + turn_rad
        if self._begin_rad is None and (
            self.apart_rad or abs(math.remainder(last_rad - first_rad, math.tau)) > least_rad
        ):
            self._begin_rad, self._apart_ns = first_rad, now_ns
        if self._begin_rad is None:
            return
        apart_rad = abs(math.remainder(last_rad - self._begin_rad, math.tau))
        self.apart_rad = max(self.apart_rad, apart_rad)
        if apart_rad > noise_rad:
            self._apart_ns = now_ns
        elif now_ns - self._apart_ns > self._duration_ns:
            self._begin_rad, self.apart_rad = None, 0.0

    def lose_offset(self) -> None:
        """Begin anew: the gyro or the headings have a gap. The doubt stays until both are together."""
        self._begin_rad = None


class HeadingTurnRule(StopRule):
    """Stops when gyro and heading device turn differently: wrong sign, wrong axis, a bias that has changed.

    Two sensors cannot outvote each other: the reason names both. While the rover does not turn, a wrong sign
    cannot be seen. The bias is that of the begin of the comparison, as later ones contain the fault. What the
    filter rejects does not count: `GreatestRateRule` and `InnovationMonitor` judge it.

    What noise does not explain, but an error of the headings may, leaves the yaw as uncertain as both have
    come apart, until they are together again.

    Errors of headings may be correlated, such as the deviation along a line: averages do not reduce them,
    and the scatter does not show them. They count with the noise of one heading. It is taken from the
    innovations: the least variance of a heading device is its noise and the least variance of the yaw.

    Args:
        settings: Thresholds.
        roles: Gyro and heading devices.
        heading_lag_s: Time constant of the heading devices.
    """

    observes = (RateSample, HeadingSample)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "Gyro and heading device measure different rotations: wrong sign or axis, a bias "
            "that has changed, a disturbed compass.",
            "`…: turn of … rad in … s, by … … rad: one of them has a wrong sign, axis or bias, "
            "or a magnetic field has turned the heading`",
            (
                "tests/controllers/safety/test_heading_rules.py::"
                "test_a_gyro_with_the_wrong_sign_is_named_when_the_rover_turns",
            ),
            within="0.9 s after the difference has reached its limit",
            settings=(
                "heading_turn_s",
                "heading_difference_rad",
                "heading_share",
                "filter.heading_noise_rad",
            ),
            clears=AFTER_A_WAIT,
        ),
    )

    def __init__(self, settings: HeadingTurnSettings, roles: DeviceRoles, heading_lag_s: float) -> None:
        self._settings = settings
        self._roles = roles
        self._lag_s = heading_lag_s
        self._greatest_rad_s = ESTIMATION.pose.greatest_rate_rad_s
        self._arrived: list[tuple[RateSample | HeadingSample, int]] = []
        self._rate: tuple[int, float] | None = None
        self._gyro_rad = 0.0
        self._late_rad = self._bias_rad = 0.0
        self._headings: dict[str, deque[_Heading]] = {}
        self._noise_rad2: dict[str, float] = {}
        self._rejections = Counter[str]()
        self._found: dict[str, tuple[tuple[int, int], Fault | None]] = {}
        self._doubts: dict[str, _Doubt] = {}

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a reading of the gyro or a heading; `check` uses it when the filter has judged it."""
        if (isinstance(sample, RateSample) and sample.device == self._roles.gyro) or (
            isinstance(sample, HeadingSample)
            and sample.device in self._roles.headings
            and math.isfinite(sample.heading_rad)
        ):
            self._arrived.append((sample, t_ns))

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Compare the turns; return a reason for every heading device that contradicts the gyro."""
        self._take_arrived(cycle)
        greatest_age_ns = nanoseconds(self._roles.max_age_s(self._roles.gyro))
        if self._rate is None or cycle.now_ns - self._rate[0] > greatest_age_ns:
            self._headings.clear()
            for doubt in self._doubts.values():
                doubt.lose_offset()
        for name, headings in self._headings.items():
            if cycle.wheels.is_still:
                _keep(headings, AVERAGE_S)
            span_ns = (headings[0].t_ns, headings[-1].t_ns)
            if name not in self._found or self._found[name][0] != span_ns:  # pragma: no mutate
                self._found[name] = (span_ns, self._compare(name, headings))
            reason = self._found[name][1] or self._doubtful(name)
            if reason is not None:
                yield reason

    def _doubtful(self, name: str) -> Fault | None:
        doubt = self._doubts.get(name)
        if doubt is None or not doubt.apart_rad:
            return None
        text = (
            f"{self._roles.gyro}: {doubt.apart_rad:.3f} rad apart from {name}, more than its noise explains"
        )
        bound = Bound(gyro_rad=doubt.apart_rad)
        return Fault(str(self._roles.gyro), Cause.GYRO_APART, text, Severity.SYMPTOM, bound)

    def _take_arrived(self, cycle: Cycle) -> None:
        """Take what arrived in this cycle, except what the filter rejected."""
        if cycle.gyro.rejected_rad_s is not None:
            # The filter's limit is that of the rover's wheels; what it rejects shows how low it is.
            self._greatest_rad_s = min(self._greatest_rad_s, abs(cycle.gyro.rejected_rad_s))
        rejected = {
            innovation.name for innovation in cycle.measurements.innovations if not innovation.accepted
        }
        for sample, t_ns in self._arrived:
            if isinstance(sample, RateSample):
                self._turn(t_ns, sample.rate_z_rad_s, cycle.estimate.gyro_bias_rad_s)
            elif (name := f"{sample.device} {sample.reference}") not in rejected:
                bias_rad_s, late_rad = cycle.estimate.gyro_bias_rad_s, self._late_rad
                offset_rad = sample.heading_rad - late_rad + self._bias_rad
                self._take(name, _Heading(t_ns, sample.heading_rad, late_rad, bias_rad_s, offset_rad))
        self._arrived.clear()
        for innovation in cycle.measurements.innovations:
            self._judge(innovation)

    def _judge(self, innovation: Innovation) -> None:
        """Take the variance of an innovation; several rejections in a row begin a new comparison."""
        name = innovation.name
        if innovation.variance is not None:
            self._noise_rad2[name] = min(self._noise_rad2.get(name, math.inf), innovation.variance)
        self._rejections[name] = 0 if innovation.accepted else self._rejections[name] + 1
        if self._rejections[name] >= REJECTIONS:
            self._headings.pop(name, None)
            self._doubt(name).lose_offset()

    def _doubt(self, name: str) -> _Doubt:
        return self._doubts.setdefault(name, _Doubt(self._settings.heading_turn_s))

    def _turn(self, t_ns: int, rate_rad_s: float, bias_rad_s: float) -> None:
        """Integrate the gyro; a gap begins new comparisons."""
        if abs(rate_rad_s) >= self._greatest_rad_s:
            return
        before, self._rate = self._rate, (t_ns, rate_rad_s)
        elapsed_s = math.inf if before is None else seconds(t_ns - before[0])
        if not math.isfinite(rate_rad_s):
            self._rate = None
        if before is None or self._rate is None or elapsed_s > self._roles.max_age_s(self._roles.gyro):
            self._headings.clear()
            for doubt in self._doubts.values():
                doubt.lose_offset()
        elif elapsed_s <= 0.0:
            self._rate = before
        else:
            self._gyro_rad += 0.5 * (before[1] + rate_rad_s) * elapsed_s
            self._bias_rad += bias_rad_s * elapsed_s
            share = -math.expm1(-elapsed_s / self._lag_s) if self._lag_s else 1.0
            self._late_rad += share * (self._gyro_rad - self._late_rad)

    def _take(self, name: str, heading: _Heading) -> None:
        headings = self._headings.setdefault(name, deque())
        before = headings[-1] if headings else heading
        if headings and heading.t_ns < before.t_ns + nanoseconds(LEAST_STEP_S):
            return
        step_rad = math.remainder(heading.heading_rad - before.heading_rad, math.tau)
        turned_rad = before.heading_rad + step_rad - heading.heading_rad
        headings.append(
            heading._replace(
                heading_rad=heading.heading_rad + turned_rad, offset_rad=heading.offset_rad + turned_rad
            )
        )
        _keep(headings, self._settings.heading_turn_s + AVERAGE_S)

    def _compare(self, name: str, headings: deque[_Heading]) -> Fault | None:
        average_ns = nanoseconds(AVERAGE_S)
        first_ns, last_ns = headings[0].t_ns, headings[-1].t_ns
        first = [heading for heading in headings if heading.t_ns <= first_ns + average_ns]
        last = [heading for heading in headings if heading.t_ns > last_ns - average_ns]
        noise_rad2 = self._noise_rad2.get(name)
        if last_ns - first_ns < 2 * average_ns or min(len(first), len(last)) < READINGS or noise_rad2 is None:
            return None
        bias_rad_s = first[-1].bias_rad_s

        def gyro_rad(heading: _Heading) -> float:
            return heading.gyro_rad - bias_rad_s * seconds(heading.t_ns - first_ns)  # pragma: no mutate

        turned_rad = fmean(heading.heading_rad for heading in last)
        turned_rad -= fmean(heading.heading_rad for heading in first)
        by_gyro_rad = fmean(map(gyro_rad, last)) - fmean(map(gyro_rad, first))
        difference_rad = by_gyro_rad - turned_rad
        angles_rad = [gyro_rad(heading) for heading in headings]
        greatest_rad = max(abs(turned_rad), max(angles_rad) - min(angles_rad))
        scatter_rad2 = sum(
            _scatter_rad2([heading.heading_rad - gyro_rad(heading) for heading in part]) / len(part)
            for part in (first, last)
        )
        least_rad = self._settings.heading_difference_rad + STANDARD_ERRORS * math.sqrt(scatter_rad2)
        share_rad = self._settings.heading_share * greatest_rad
        first_rad, last_rad = (fmean(heading.offset_rad for heading in part) for part in (first, last))
        self._doubt(name).take(last_ns, first_rad, last_rad, least_rad, share_rad)
        limit_rad = least_rad + share_rad + STANDARD_ERRORS * math.sqrt(2.0 * noise_rad2)
        if abs(difference_rad) <= limit_rad:
            return None
        text = (
            f"{self._roles.gyro}: turn of {by_gyro_rad:.3f} rad in {seconds(last_ns - first_ns):.1f} s, "
            f"by {name} {turned_rad:.3f} rad: one of them has a wrong sign, axis or bias, or a magnetic "
            "field has turned the heading"
        )
        return Fault(
            str(self._roles.gyro), Cause.GYRO_HEADING, text, bound=Bound(gyro_rad=abs(difference_rad))
        )


def _scatter_rad2(angles_rad: Sequence[float]) -> float:
    """Return the variance by the differences of successive angles, in which a steady drift hardly counts."""
    return 0.5 * fmean((after - before) ** 2 for before, after in pairwise(angles_rad))


def _keep(headings: deque[_Heading], duration_s: float) -> None:
    """Remove headings that are older than the newest one by more than this."""
    while headings[-1].t_ns - headings[0].t_ns > nanoseconds(duration_s):
        headings.popleft()
