"""Ground whose pattern repeats along the motion: tiles, ribs, furrows across.

A picture of it fits itself once more after a period, so the motion is known only up to whole periods. The
correlation of the structure with itself shows it: it falls, and rises again at the period. Of random ground
it falls and stays low, and along furrows it does not fall.
"""

import numpy as np

from controllers.ground_motion.ground_patch import Floats, GroundPatch, Patch
from controllers.ground_motion.parameters import RepeatingGroundParameters

REPEATS = "several motions explain the ground, its pattern repeats: take more frames per second"


class RepeatingGround:
    """Examines some of the frames.

    Args:
        ground: The rectified ground.
        parameters: Tuned numbers.
    """

    def __init__(self, ground: GroundPatch, parameters: RepeatingGroundParameters) -> None:
        self._pixel_m, self._numbers = ground.pixel_m, parameters
        visible = ground.visible.astype(np.float32)
        self._shared = [np.maximum(_correlation(visible, axis), 1.0) for axis in (0, 1)]
        self._periods_m = [0.0, 0.0]
        self._frames = 0

    def take(self, structure: Patch, *, is_needed: bool = False) -> None:
        """Take a frame; it is examined where that is needed, and once in some frames."""
        if is_needed or self._frames % self._numbers.every == 0:
            self._periods_m = [self._period_m(structure, axis) for axis in (0, 1)]
        self._frames += 1

    def period_m(self, wheel_m: Floats | None) -> float:
        """Return the period along the motion of the wheels, ahead or aside; 0 for none."""
        moves_aside = wheel_m is not None and abs(wheel_m[1]) > abs(wheel_m[0])
        return self._periods_m[int(moves_aside)]

    @property
    def limit(self) -> str:
        """Which motion between two frames the ground leaves open, ahead or aside; "" for none."""
        periods_m = [period_m for period_m in self._periods_m if period_m]
        if not periods_m:
            return ""
        period_mm = 1e3 * min(periods_m)
        return (
            f"the ground's pattern repeats every {period_mm:.0f} mm: take a frame before the rover has moved "
            "by that"
        )

    def _period_m(self, structure: Patch, axis: int) -> float:
        shared = self._shared[axis]
        alike = _correlation(structure, axis) / shared
        if alike[0] <= 0.0:
            return 0.0
        alike = alike[: int(self._numbers.most_lag_share * len(alike))] / alike[0]
        rise = alike - np.minimum.accumulate(alike)
        is_peak = (alike[1:-1] >= alike[:-2]) & (alike[1:-1] >= alike[2:])
        lags = 1 + np.flatnonzero(is_peak & (rise[1:-1] >= self._numbers.least_rise))
        return float(lags[0] * self._pixel_m) if len(lags) else 0.0


def _correlation(patch: Patch, axis: int) -> Floats:
    """Return the sum of products of all pixels at each distance along an axis."""
    length = patch.shape[axis]
    spectrum = np.fft.rfft(patch, 2 * length, axis=axis)
    power = (spectrum.real**2 + spectrum.imag**2).sum(axis=1 - axis)
    return np.asarray(np.fft.irfft(power)[:length], np.float64)
