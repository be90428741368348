"""Slip ratio over slip angle as two straight lines: paper 000, eq 12, with |beta|."""

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from controllers.slip.scomp.combined_slip import CombinedSlip
from drivers.errors import ModelError
from drivers.settings import Settings

Array = NDArray[np.float64]

FEWEST_POINTS = 6
CORNERS = 200
LAST_CORNER = 0.8
STEEPEST_PER_RAD = 10.0


class TwoSegmentSlip(Settings):
    """s_x = s_x0 up to |beta| = beta0, then rising by k per rad.

    The fit depends on the range of slip angles it is made over, which the paper does not state: it is part
    of the law.

    Attributes:
        slip_0: s_x0.
        k_per_rad: Slope beyond the corner, not negative.
        beta_0_rad: The corner.
        fit_range_rad: Smallest and greatest |beta| of the fit.
        rms: Deviation of the fit from its data.
    """

    slip_0: Annotated[float, Field(ge=-1.0, le=1.0)]
    k_per_rad: Annotated[float, Field(ge=0.0, le=10.0)]
    beta_0_rad: Annotated[float, Field(ge=0.0, le=1.5)]
    fit_range_rad: tuple[float, float]
    rms: Annotated[float, Field(ge=0.0)] = 0.0

    def slip_at(self, slip_angle_rad: float) -> float:
        """Return the slip ratio at a slip angle, at most 1."""
        return min(1.0, self.slip_0 + self.k_per_rad * max(0.0, abs(slip_angle_rad) - self.beta_0_rad))


def fit_two_segments(
    slip_angle_rad: Array, slip: Array, fit_range_rad: tuple[float, float], slip_0: float | None = None
) -> TwoSegmentSlip:
    """Fit by least squares: both segments for each of 200 corners, none in the last fifth of angles.

    Args:
        slip_angle_rad: beta; its sign does not matter.
        slip: s_x at each.
        fit_range_rad: Smallest and greatest |beta| to use.
        slip_0: s_x0 where it is known; fitted otherwise.

    Raises:
        ModelError: Fewer than six points in the range, or a mean slip beyond 1.
    """
    angle = np.abs(slip_angle_rad)
    low, high = fit_range_rad
    inside = (angle >= low) & (angle <= high) & np.isfinite(slip)
    if np.count_nonzero(inside) < FEWEST_POINTS:
        raise ModelError(
            f"the two-segment law needs {FEWEST_POINTS} points with |beta| in [{low:.3f}, {high:.3f}] rad, "
            f"got {np.count_nonzero(inside)}: widen the range or give a longer run"
        )
    angle, value = angle[inside], slip[inside]
    if not abs(float(value.mean())) <= 1.0:
        raise ModelError(f"the mean slip is {value.mean():.2f}, beyond 1: check wheel radius and truth")
    best = (np.inf, 0.0, 0.0, 0.0)
    for corner in np.linspace(float(angle.min()), float(np.quantile(angle, LAST_CORNER)), CORNERS).tolist():
        level, slope = _lines(np.maximum(0.0, angle - corner), value, slip_0)
        square = float(np.mean((level + slope * np.maximum(0.0, angle - corner) - value) ** 2))
        if square < best[0] - 1e-15:
            best = (square, level, slope, corner)
    square, level, slope, corner = best
    return TwoSegmentSlip(
        slip_0=level, k_per_rad=slope, beta_0_rad=corner, fit_range_rad=fit_range_rad, rms=square**0.5
    )


def _lines(beyond: Array, value: Array, slip_0: float | None) -> tuple[float, float]:
    """Return level and slope, not negative, of value = level + slope beyond."""
    spread = beyond if slip_0 is not None else beyond - beyond.mean()
    over = value - slip_0 if slip_0 is not None else value - value.mean()
    square = float((spread * spread).sum())
    slope = min(max(0.0, float((spread * over).sum()) / square), STEEPEST_PER_RAD) if square > 0.0 else 0.0
    return (float(value.mean() - slope * beyond.mean()) if slip_0 is None else slip_0), slope


def two_segments_of_model(
    model: CombinedSlip, slope_rad: float, fit_range_rad: tuple[float, float]
) -> TwoSegmentSlip:
    """Return the law for a slope, fitted to the model at R_x = W sin(slope) every tenth of a degree.

    s_x0 is the model's own slip without drift, as section 3.3 defines it.
    """
    traction = math.sin(slope_rad)
    angle = np.arange(fit_range_rad[0], fit_range_rad[1] + 1e-9, math.radians(0.1))
    slip = np.array([model.slip_at(traction, beta) for beta in angle.tolist()])
    return fit_two_segments(angle, slip, fit_range_rad, slip_0=model.slip_at(traction, 0.0))
