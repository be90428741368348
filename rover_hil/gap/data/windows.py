"""Recorded drives in windows of equal length: mean rates between their edges."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from drivers.errors import ConfigError
from rover_hil.datasets.arrays import in_body_frame
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Array, Run

OVERLAP = (2, 1)
"""Values at the start and end of a stretch that overlap with its neighbours."""


@dataclass(frozen=True, slots=True)
class Windows:
    """Edges in time; n + 1 of them make n windows."""

    edges_s: Array

    @property
    def middle_s(self) -> Array:
        """The middle of each window."""
        middle: Array = 0.5 * (self.edges_s[1:] + self.edges_s[:-1])
        return middle

    def rate(self, t_s: Array, values: Array) -> Array:
        """Return the mean change per second of a cumulated quantity, NaN outside the record."""
        good = np.isfinite(values)
        at = np.interp(self.edges_s, t_s[good], values[good], left=np.nan, right=np.nan)
        rate: Array = np.diff(at) / np.diff(self.edges_s)
        return rate

    def mean(self, t_s: Array, values: Array) -> Array:
        """Return the mean of a quantity in each window, interpolated in windows without a value."""
        good = np.isfinite(values)
        t_s, values = t_s[good], values[good]
        place = np.searchsorted(self.edges_s, t_s, side="right") - 1
        inside = (place >= 0) & (place < self.edges_s.size - 1)
        size = self.edges_s.size - 1
        count = np.bincount(place[inside], minlength=size)
        total = np.bincount(place[inside], weights=values[inside], minlength=size)
        middle = np.interp(self.middle_s, t_s, values)
        mean: Array = np.where(count > 0, total / np.maximum(count, 1), middle)
        return mean


def windows_over(first_s: float, last_s: float, where: str) -> Windows:
    """Return windows over a drive: of 0.2 s, narrower for short drives and wider for long ones.

    Raises:
        ConfigError: The drive is too short.
    """
    duration_s = last_s - first_s
    if duration_s < DATA.windows.least_duration_s:
        raise ConfigError(
            f"{where} lasts {duration_s:.1f} s: {DATA.windows.least_duration_s:g} s or more are needed"
        )
    count = min(max(math.floor(duration_s / DATA.windows.window_s), DATA.windows.least), DATA.windows.most)
    return Windows(np.linspace(first_s, last_s, count + 1))


def windows_between(first: Array, second: Array, where: str) -> Windows:
    """Return windows over what two series of times have in common; see `windows_over`."""
    return windows_over(float(max(first[0], second[0])), float(min(first[-1], second[-1])), where)


def stretches(run: Run) -> list[Run]:
    """Return a run of windows cut into four or more of at least 64; itself where it is too short.

    Delays reach over a cut from both sides: values at both ends of each stretch are left out. Missing values
    of the drive are counted with its first stretch.
    """
    size = run.inputs["t_s"].size
    count = size // DATA.windows.least_stretch
    if count < DATA.windows.least_stretches:
        return [run]
    cuts = np.linspace(0, size, count + 1).astype(int)
    parts = []
    for number, (first, last) in enumerate(itertools.pairwise(cuts.tolist()), start=1):
        measured = {name: values[first:last].copy() for name, values in run.measured.items()}
        for values in measured.values():
            values[: OVERLAP[0]] = values[-OVERLAP[1] :] = np.nan
        inputs = {name: values[first:last] for name, values in run.inputs.items()}
        missing = run.missing if number == 1 else {}
        part = replace(run, inputs=inputs, measured=measured, overlap=OVERLAP, missing=missing)
        parts.append(replace(part, name=f"{run.name} part {number}"))
    return parts


def body_rates(
    windows: Windows, t_s: Array, x_m: Array, y_m: Array, yaw_rad: Array
) -> tuple[Array, Array, Array]:
    """Return a pose's velocity forward and to the left (m/s) and its turn (rad/s), in the body frame."""
    heading = np.unwrap(yaw_rad)
    middle = np.interp(windows.middle_s, t_s, heading)
    east, north = windows.rate(t_s, x_m), windows.rate(t_s, y_m)
    return *in_body_frame(east, north, middle), windows.rate(t_s, heading)
