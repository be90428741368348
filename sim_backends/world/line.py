"""One direction of a bus: a payload arrives after the time that the real bus needs for its bits."""

from bisect import insort
from collections import deque
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Generic

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.link import PayloadT, Received

NEVER_NS = 2**63 - 1
"""Later than any event."""


class Line(Generic[PayloadT]):
    """One direction of one bus, first in first out.

    Args:
        bits_of: Number of bits of a payload on the wire, framing included.
        bits_per_s: Speed of the wire.

    Attributes:
        disturb: Applied to each arrival; a fault drops, delays, duplicates or corrupts it here.
    """

    def __init__(self, bits_of: Callable[[PayloadT], float], bits_per_s: float) -> None:
        self._bits_of: Callable[[PayloadT], float] = bits_of
        self._ns_per_bit = NANOSECONDS_PER_SECOND / bits_per_s
        self._queue: deque[Received[PayloadT]] = deque()
        self._busy_until_ns = 0
        self.disturb: Callable[[Received[PayloadT]], Sequence[Received[PayloadT]]] = _undisturbed

    @property
    def next_arrival_ns(self) -> int:
        """When the next payload is complete at the far end; `NEVER_NS` when nothing is in transit."""
        return self._queue[0].t_ns if self._queue else NEVER_NS

    def put(self, t_ns: int, payload: PayloadT) -> None:
        """Start sending at `t_ns`, or as soon as the wire is free."""
        start_ns = max(t_ns, self._busy_until_ns)
        self._busy_until_ns = start_ns + round(self._bits_of(payload) * self._ns_per_bit)
        for arrival in self.disturb(Received(self._busy_until_ns, payload)):
            if self._queue and self._queue[-1].t_ns > arrival.t_ns:
                insort(self._queue, arrival, key=attrgetter("t_ns"))
            else:
                self._queue.append(arrival)

    def take(self, until_ns: int) -> list[Received[PayloadT]]:
        """Return what has arrived by `until_ns`, with its arrival times."""
        arrived: list[Received[PayloadT]] = []
        while self._queue and self._queue[0].t_ns <= until_ns:
            arrived.append(self._queue.popleft())
        return arrived

    def clear(self) -> None:
        """Drop everything in transit, as when the plug is pulled."""
        self._queue.clear()
        self._busy_until_ns = 0


def _undisturbed(arrival: Received[PayloadT]) -> Sequence[Received[PayloadT]]:
    return (arrival,)


def serial_bits(payload: bytes) -> float:
    """Return the bits of a byte string on an 8N1 line: start, eight data, stop."""
    return 10.0 * len(payload)
