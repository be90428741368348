"""Recordings of the OptiOdom robots, and which of them are fitted."""

import re
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RUN = re.compile(r"(\d+)_run-(\d+)\.csv\.gz")


@dataclass(frozen=True)
class Recording:
    """A recording.

    Attributes:
        name: Name of its file without the suffixes.
        t_s: Times, shape (n,).
        marker: Ground truth of the marker: x, y and yaw without jumps, shape (n, 3).
        counts: Readings of the wheels of each row, shape (n, columns).
    """

    name: str
    t_s: Array
    marker: Array
    counts: Array

    def pieces(self, count: int) -> list["Recording"]:
        """Return the recording in successive pieces of equal length."""
        ends = np.linspace(0, len(self.t_s), count + 1).astype(int)
        return [
            replace(
                self,
                t_s=self.t_s[begin:end],
                marker=self.marker[begin:end],
                counts=self.counts[begin:end],
            )
            for begin, end in pairwise(ends.tolist())
        ]


def read(path: Path) -> Recording:
    """Return the recording of a file."""
    rows = np.loadtxt(path, delimiter=",")
    marker = rows[:, 1:4].copy()
    marker[:, 2] = np.unwrap(marker[:, 2])
    return Recording(path.name.removesuffix(".csv.gz"), rows[:, 0], marker, rows[:, 4:])


def halves(folder: Path) -> tuple[list[Recording], list[Recording]]:
    """Return the recordings to fit and those to validate of one robot.

    They are sorted by number of the run, then by time, and counted from 1; even ones are fitted. By number
    of the run alone, the tricycle would be fitted on left circles and validated on right ones.
    """
    found = [(match, path) for path in folder.rglob("*.csv.gz") if (match := RUN.fullmatch(path.name))]
    ordered = [path for match, path in sorted(found, key=lambda each: (int(each[0][2]), each[0][1]))]
    return [read(path) for path in ordered[1::2]], [read(path) for path in ordered[::2]]
