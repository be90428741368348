"""Fit the combined-slip model to single-wheel test-bed data: steps (i)-(iv) of paper 000, section 3.2.1.

The paper takes mu from F_x,max = mu W (eq 10). That is not the limit of its own model, eq 8, at full slip,
and contradicts its table 3 (28.1 N against 38.8 N), so here step (i) compares eq 8 itself with the data. The
steps then depend on each other and are repeated. They converge slowly (a higher mu with a higher A_x is
nearly the same curve), so one least-squares fit of all parameters to all forces ends the procedure.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from controllers.slip.scomp.combined_slip import CombinedSlip
from drivers.errors import ModelError
from rover_hil.drives.arrays import Array

LOW_SLIP = 0.2
HIGH_SLIP = 0.5
SMALL_ANGLES = 2
SWEEPS = 10
LIMITS = {"mu": (0.05, 2.0), "c_x_n": (1.0, 1e4), "c_y_n": (1.0, 1e4), "a_x": (-1.0, 1.0), "a_y": (-1.0, 1.0)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SingleWheelData:
    """Steady forces of one wheel under a constant load; n trials.

    Attributes:
        slip: Slip ratio of each, 0 to 1.
        slip_angle_rad: Slip angle of each, 0 to less than pi/2.
        force_x_n: Longitudinal force, N.
        force_y_n: Lateral force, N, positive for a positive angle.
        load_n: Vertical load, N.
    """

    slip: Array
    slip_angle_rad: Array
    force_x_n: Array
    force_y_n: Array
    load_n: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleWheelFit:
    """The model, and the rms residual of both forces in N."""

    model: CombinedSlip
    force_x_rms_n: float
    force_y_rms_n: float


def fit_single_wheel_data(data: SingleWheelData) -> SingleWheelFit:
    """Fit mu, C_x, C_y, A_x and A_y.

    (i) mu from F_x at high slip and small angles, (ii) C_y from F_y at low slip, (iii) C_x from F_x at low
    slip, (iv) A_x and A_y from the forces at high slip; each by least squares with the others kept. Then all
    at once.

    Raises:
        ModelError: No trials at low slip (up to 0.2) or at high slip (0.5 and more), or fewer than eight.
    """
    low, high = data.slip <= LOW_SLIP, data.slip >= HIGH_SLIP
    angles = np.unique(data.slip_angle_rad[high])
    if len(data.slip) < 8 or not (low.any() and high.any()):
        raise ModelError(
            f"the fit needs eight trials with slips up to {LOW_SLIP:g} and from {HIGH_SLIP:g} on, got "
            f"{len(data.slip)}, {np.count_nonzero(low)} and {np.count_nonzero(high)}: measure more slips"
        )
    small = high & (data.slip_angle_rad <= angles[min(SMALL_ANGLES, len(angles)) - 1])
    model = CombinedSlip(load_n=data.load_n)
    for _ in range(SWEEPS):
        model = _fit(model, data, ("mu",), small, along=True, across=False)
        model = _fit(model, data, ("c_y_n",), low, along=False, across=True)
        model = _fit(model, data, ("c_x_n",), low, along=True, across=False)
        model = _fit(model, data, ("a_x",), high, along=True, across=False)
        model = _fit(model, data, ("a_y",), high, along=False, across=True)
    model = _fit(model, data, tuple(LIMITS), np.ones_like(low), along=True, across=True)
    force_x_n, force_y_n = model.forces_n(data.slip, data.slip_angle_rad)
    return SingleWheelFit(
        model=model,
        force_x_rms_n=float(np.sqrt(np.mean((force_x_n - data.force_x_n) ** 2))),
        force_y_rms_n=float(np.sqrt(np.mean((force_y_n - data.force_y_n) ** 2))),
    )


def _fit(
    model: CombinedSlip,
    data: SingleWheelData,
    names: Sequence[str],
    use: NDArray[np.bool_],
    *,
    along: bool,
    across: bool,
) -> CombinedSlip:
    """Return the model with the named parameters fitted to the chosen forces of the chosen trials."""
    slip, angle = data.slip[use], data.slip_angle_rad[use]

    def misfit(values: Array) -> Array:
        trial = model.model_copy(update=dict(zip(names, values.tolist(), strict=True)))
        force_x_n, force_y_n = trial.forces_n(slip, angle)
        parts = [force_x_n - data.force_x_n[use]] if along else []
        return np.concatenate([*parts, force_y_n - data.force_y_n[use]] if across else parts)

    start = [getattr(model, name) for name in names]
    low, high = zip(*(LIMITS[name] for name in names), strict=True)
    found = least_squares(misfit, start, bounds=(low, high), x_scale=[max(abs(v), 0.01) for v in start]).x
    return model.model_copy(update=dict(zip(names, found.tolist(), strict=True)))
