"""Readings that wait until the recorded motion reaches the time when they were measured."""

from collections import deque
from collections.abc import Hashable, Sequence
from typing import Any

from controllers.estimation.filter.reader import Reader
from drivers.samples import Sample

MOST_WAITING = 8
"""Readings of one source that wait; a source that sends more is faster than the wheels."""

Reading = tuple[int, Reader[Any], Sample]
"""When it was measured, who reads it, and the sample."""


class LateReadings:
    """Keeps samples that a reader knows, unless they are not newer than the last of their source.

    Args:
        readers: Of the measurements; several may read one sample.
    """

    def __init__(self, readers: Sequence[Reader[Any]]) -> None:
        self._readers: dict[type[Sample], list[Reader[Any]]] = {}
        for reader in readers:
            self._readers.setdefault(reader.kind, []).append(reader)
        self._waiting: dict[Hashable, deque[Reading]] = {}
        self._newest_ns: dict[Hashable, int] = {}

    def add(self, sample: Sample, t_ns: int) -> None:
        """Take a sample that arrived at `t_ns`; without effect where no reader knows it."""
        for reader in self._readers.get(type(sample), ()):
            source = reader.source(sample)
            if source is not None:
                self._keep((reader, source), (reader.measured_ns(sample, t_ns), reader, sample))

    def _keep(self, source: Hashable, reading: Reading) -> None:
        measured_ns = reading[0]
        newest_ns = self._newest_ns.get(source)
        if newest_ns is None or measured_ns > newest_ns:
            self._newest_ns[source] = measured_ns
            self._waiting.setdefault(source, deque(maxlen=MOST_WAITING)).append(reading)

    def take(self, known_ns: int | None) -> list[Reading]:
        """Return the readings from up to the end of the recorded motion, in the order of their times.

        Before the first motion nothing has to be reached: the rover has not moved.
        """
        ready: list[Reading] = []
        for waiting in self._waiting.values():
            while waiting and (known_ns is None or waiting[0][0] <= known_ns):
                ready.append(waiting.popleft())
        return sorted(ready, key=lambda reading: reading[0])
