"""Positions of drives that count in a register of limited size."""

from drivers.clock import NANOSECONDS_PER_SECOND

LONGEST_BUNCHING_NS = 100_000_000
"""Readings may arrive in bunches, so at least this much time is assumed between two of them."""


class PositionCounter:
    """Continues a position across the end of its register, and refuses jumps that no motor can make.

    When the next reading continues from a refused one, the device has restarted its counter: the position
    continues from its last value, and the turns in between are unknown and not counted.

    Args:
        span: Number of counts after which the register wraps.
        largest_rate_per_s: Counts per second that the motor cannot exceed.
    """

    def __init__(self, span: int, largest_rate_per_s: float) -> None:
        self._span = span
        self._largest_rate_per_s = largest_rate_per_s
        self._accepted: tuple[int, int] | None = None
        self._suspect: tuple[int, int] | None = None
        self._position = 0

    def reset(self) -> None:
        """Start from the device's own count at the next reading."""
        self._accepted = self._suspect = None

    def count(self, t_ns: int, raw: int) -> int | None:
        """Return the position in counts, or None for a jump."""
        base = self._accepted
        if base is not None and not self._can_follow(base, t_ns, raw):
            base, self._suspect = self._suspect, (t_ns, raw)
            if base is None or not self._can_follow(base, t_ns, raw):
                return None
        self._position = raw if base is None else self._position + self._step(base[1], raw)
        self._accepted, self._suspect = (t_ns, raw), None
        return self._position

    def _can_follow(self, before: tuple[int, int], t_ns: int, raw: int) -> bool:
        elapsed_ns = max(t_ns - before[0], LONGEST_BUNCHING_NS)
        return abs(self._step(before[1], raw)) <= (
            self._largest_rate_per_s * elapsed_ns / NANOSECONDS_PER_SECOND
        )

    def _step(self, before: int, after: int) -> int:
        half = self._span // 2
        return (after - before + half) % self._span - half
