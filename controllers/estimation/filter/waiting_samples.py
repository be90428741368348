"""Samples that wait for the next cycle to correct the pose filter."""

from collections.abc import Hashable, Sequence

from controllers.estimation.filter.reader import Reader
from drivers.samples import Sample


class WaitingSamples:
    """Keeps samples that a reader knows, unless they are not newer than the last of their source.

    Args:
        readers: Of the measurements.
    """

    def __init__(self, readers: Sequence[Reader]) -> None:
        self._readers = readers
        self._waiting: list[tuple[Reader, Sample, int]] = []
        self._newest_ns: dict[Hashable, int] = {}

    def add(self, sample: Sample, t_ns: int) -> None:
        """Take a sample as of `t_ns`; without effect where no reader knows it."""
        for reader in self._readers:
            source = reader.source(sample)
            if source is None:
                continue
            newest_ns = self._newest_ns.get(source)
            if newest_ns is None or t_ns > newest_ns:
                self._newest_ns[source] = t_ns
                self._waiting.append((reader, sample, t_ns))

    def take(self) -> list[tuple[Reader, Sample, int]]:
        """Return the samples since the last call with their readers and times."""
        taken, self._waiting = self._waiting, []
        return taken
