"""Quantities of a recorded drive in windows of time."""

from dataclasses import dataclass

import numpy as np

from rover_hil.drives.arrays import Array, in_body_frame


@dataclass(frozen=True, slots=True)
class Windows:
    """Edges in time; n + 1 of them make n windows."""

    edges_s: Array

    @property
    def middle_s(self) -> Array:
        """The middle of each window."""
        middle: Array = 0.5 * (self.edges_s[1:] + self.edges_s[:-1])
        return middle

    def step(self, t_s: Array, values: Array) -> Array:
        """Return the change of a cumulated quantity, NaN outside the record."""
        good = np.isfinite(values)
        at = np.interp(self.edges_s, t_s[good], values[good], left=np.nan, right=np.nan)
        step: Array = np.diff(at)
        return step

    def rate(self, t_s: Array, values: Array) -> Array:
        """Return the mean change per second of a cumulated quantity, NaN outside the record."""
        rate: Array = self.step(t_s, values) / np.diff(self.edges_s)
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


def body_steps(windows: Windows, t_s: Array, x_m: Array, y_m: Array, yaw_rad: Array) -> tuple[Array, Array]:
    """Return a pose's travel forward and to the left in each window, by the heading in its middle."""
    middle = np.interp(windows.middle_s, t_s, yaw_rad)
    return in_body_frame(windows.step(t_s, x_m), windows.step(t_s, y_m), middle)


def body_rates(
    windows: Windows, t_s: Array, x_m: Array, y_m: Array, yaw_rad: Array
) -> tuple[Array, Array, Array]:
    """Return a pose's velocity forward and to the left (m/s) and its turn (rad/s), in the body frame."""
    heading = np.unwrap(yaw_rad)
    middle = np.interp(windows.middle_s, t_s, heading)
    east, north = windows.rate(t_s, x_m), windows.rate(t_s, y_m)
    return *in_body_frame(east, north, middle), windows.rate(t_s, heading)
