"""Positions of drives that count in a register of limited size."""

from typing import TypeAlias

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.samples import LinkSample

LONGEST_BUNCHING_NS = 100_000_000
"""Readings may arrive in bunches, so at least this much time is assumed between two of them."""

_TOLERANCE = 1.01
"""Angles of 0 to 360 deg may be given with a little noise beyond."""

_SUDDEN = 4
"""A step this many times the one before is no acceleration; where a wheel turns by less than a fifth of a
revolution between two readings, the end of the revolution is such a step."""

_Reading: TypeAlias = tuple[int, float]
"""Time in ns and counts."""


class PositionCounter:
    """Continues a position across the end of its register, and refuses jumps that no motor can make.

    When the next reading continues from a refused one, the device has restarted its counter: the position
    continues from its last value. The turns in between are unknown, which `restart_sample` reports.

    Refused is: a step faster than the motor; a reading further from another one than the span, as the
    register is then larger than stated; and, where the revolution is given, a sudden step of more than half
    of it while all readings lie within one, as the register then ends at a revolution.

    Args:
        span: Counts after which the register wraps; None for never.
        largest_rate_per_s: Counts per second that the motor cannot exceed.
        revolution: Counts per revolution, where the register may end there although `span` differs.

    Attributes:
        has_restarted: The last position continues a restarted counter.
        is_ambiguous: The last step was more than a quarter of the span. At twice this speed whole spans are
            lost unnoticed.
    """

    def __init__(
        self, span: float | None, largest_rate_per_s: float, revolution: float | None = None
    ) -> None:
        self._span = span
        self._largest_rate_per_s = largest_rate_per_s
        self._revolution = revolution
        self.reset()

    def reset(self) -> None:
        """Start from the device's own count at the next reading."""
        self._accepted: _Reading | None = None
        self._suspect: _Reading | None = None
        self._extent = (0.0, 0.0)
        self._last_step: float | None = None
        self._spans = 0
        self._shift = 0.0
        self.has_restarted = False
        self.is_ambiguous = False

    def count(self, t_ns: int, raw: float) -> float | None:
        """Return the position in counts, or None for a jump."""
        self.has_restarted = False
        before = self._accepted
        if before is None:
            self._extent = (raw, raw)
            return self._accept(t_ns, raw, raw, 0.0, None)
        step, suspect = self._step(before[1], raw), self._suspect
        can_go_on = self._can_follow(before, self._extent, t_ns, raw, step)
        if suspect is not None:
            restarted = self._step(suspect[1], raw)
            is_nearer = not can_go_on or abs(restarted) < abs(step)
            if is_nearer and self._can_follow(suspect, (suspect[1], suspect[1]), t_ns, raw, restarted):
                self._shift, self._spans = self._position(before[1]) - suspect[1], 0
                self._extent = (suspect[1], suspect[1])
                self.has_restarted = True
                return self._accept(t_ns, raw, suspect[1], restarted, abs(restarted))
        if can_go_on:
            return self._accept(t_ns, raw, before[1], step, abs(step))
        self._suspect = t_ns, raw
        return None

    def _accept(self, t_ns: int, raw: float, before: float, step: float, last_step: float | None) -> float:
        span = self._span
        if span is not None:
            if step != raw - before:
                self._spans += round((step - raw + before) / span)
            self.is_ambiguous = 4 * abs(step) > span
        low, high = self._extent
        if not low <= raw <= high:
            self._extent = min(low, raw), max(high, raw)
        self._last_step = last_step
        self._accepted, self._suspect = (t_ns, raw), None
        return self._position(raw)

    def _position(self, raw: float) -> float:
        return raw + self._shift + (0 if self._span is None else self._spans * self._span)

    def _can_follow(
        self, before: _Reading, extent: tuple[float, float], t_ns: int, raw: float, step: float
    ) -> bool:
        elapsed_ns = max(t_ns - before[0], LONGEST_BUNCHING_NS)
        if abs(step) > self._largest_rate_per_s * elapsed_ns / NANOSECONDS_PER_SECOND:
            return False
        apart = max(extent[1], raw) - min(extent[0], raw)
        if self._span is not None and apart > _TOLERANCE * self._span:
            return False
        return self._revolution is None or not self._ends(
            self._revolution, t_ns - before[0], abs(step), apart
        )

    def _ends(self, revolution: float, elapsed_ns: int, step: float, apart: float) -> bool:
        """Return whether a step is the end of the register at a revolution."""
        return (
            2 * step > revolution > apart
            and elapsed_ns <= LONGEST_BUNCHING_NS
            and self._last_step is not None
            and step > _SUDDEN * self._last_step
        )

    def _step(self, before: float, after: float) -> float:
        if self._span is None:
            return after - before
        half = self._span / 2
        return (after - before + half) % self._span - half


def restart_sample(device: str, t_ns: int, what: str) -> LinkSample:
    """Return the report that turns may be missing: odometry begins anew, and its estimate is wider.

    Args:
        device: Name of the device in the configuration.
        t_ns: Time of the first reading after the restart.
        what: What counts, such as "wheel 0".
    """
    return LinkSample(device=device, t_ns=t_ns, up=True, reason=f"{what}: the position counter has restarted")
