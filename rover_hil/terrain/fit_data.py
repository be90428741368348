"""Wheel tests as arrays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rover_hil.drives.arrays import Array
from sim_backends.terramechanics.soil.any_angle_wheel import Motion


class WheelTests(NamedTuple):
    """Steady trials of a wheel in a test bed; one entry per trial in every array.

    Attributes:
        cell: Name of the trial's conditions; trials of one cell are replicates.
        slip_angle_deg: As commanded.
        rim_speed_mm_s: As commanded.
        motion: Speeds as measured.
        load_n: Vertical force as measured.
        drawbar_n: Force forward.
        side_n: Force to the left.
        sinkage_m: Below the undisturbed surface.
    """

    cell: NDArray[np.str_]
    slip_angle_deg: Array
    rim_speed_mm_s: Array
    motion: Motion
    load_n: Array
    drawbar_n: Array
    side_n: Array
    sinkage_m: Array

    def only(self, chosen: NDArray[np.bool_]) -> "WheelTests":
        """Return the chosen trials."""
        parts = {name: getattr(self, name)[chosen] for name in self._fields if name != "motion"}
        return WheelTests(motion=Motion(*(part[chosen] for part in self.motion)), **parts)

    def means(self) -> "WheelTests":
        """Return one entry per cell: the mean of its trials, cells in order of their names."""
        names, member = np.unique(self.cell, return_inverse=True)
        count = np.bincount(member)

        def mean(values: Array) -> Array:
            return np.asarray(np.bincount(member, weights=values) / count, dtype=np.float64)

        parts = {name: mean(getattr(self, name)) for name in self._fields if name not in ("cell", "motion")}
        return WheelTests(cell=names, motion=Motion(*(mean(part) for part in self.motion)), **parts)
