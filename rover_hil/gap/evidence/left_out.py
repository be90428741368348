"""How well the other runs predict each run, by linearisation of a fit."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.derivatives import Indices, Mask
from rover_hil.gap.evidence.fit import RIDGE, Fit
from rover_hil.gap.evidence.jackknife import scatter_of_runs
from rover_hil.gap.noise.sensor_noise import SensorNoise
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array
from sim_backends.models.parameter_key import ParameterKey


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """What each run says about a fit when it is left out, by linearisation.

    Attributes:
        channel_squares: Squared error of each run predicted by the others, its own unknowns fitted, in units
            of the declared noise: runs x channels.
        channel_counts: Values of each run: runs x channels.
        moved: Change of each parameter of all runs when one is left out, in prior deviations.
        by_samples: Standard error of each parameter from the samples, in prior deviations.
        informed: Part of the variance of each parameter that comes from each run; priors have the rest.
        keys: These parameters.
    """

    channel_squares: Array
    channel_counts: Array
    moved: Array
    by_samples: Array
    informed: Array
    keys: tuple[ParameterKey, ...]

    @property
    def squares(self) -> Array:
        """Squared error of each run over all channels."""
        total: Array = self.channel_squares.sum(axis=1)
        return total

    @property
    def counts(self) -> Array:
        """Values of each run."""
        total: Array = self.channel_counts.sum(axis=1)
        return total

    def scatter(self, index: int) -> tuple[float, float]:
        """Return the scatter of a parameter over runs, over that of samples, and its degrees of freedom.

        That over runs is the standard error by leaving them out (jackknife).
        """
        moved = self.moved[:, index]
        count = moved.size
        by_runs = math.sqrt((count - 1) / count * float(np.sum((moved - moved.mean()) ** 2)))
        return scatter_of_runs(by_runs / float(self.by_samples[index]), self.informed[:, index])


def leave_one_run_out(found: Fit, noise: SensorNoise, declared_sd: Array, owner: Indices) -> LeftOut:
    """Return how the other runs predict each run, and how its absence moves the parameters.

    Where units under test differ, all runs of one unit are left out together.

    `owner` is the number of the run, or of the unit under test, of each row with a value.
    """
    shared = shared_parameters(found)
    runs, parts = zip(*parts_of_runs(found, owner), strict=True)
    normal = np.eye(len(shared)) + sum(matrix.T @ matrix for _, matrix, _ in parts)
    # Derivatives of very different size leave rounding errors in the normal matrix.
    normal += np.diag(np.full(len(shared), RIDGE * float(np.diag(normal).max(initial=1.0))))
    covariance = np.linalg.inv(normal)
    scale = (noise.channel_sd / declared_sd)[noise.channel]
    # A bound that holds a parameter with all runs holds it without one of them too.
    is_free = 1.0 - held_parameters(found)
    moved, squares, informed = [], [], []
    for run, (error, matrix, rows) in zip(runs, parts, strict=True):
        without = normal - MACHINES.fit.left_out * matrix.T @ matrix
        without = np.where(np.outer(is_free, is_free) > 0.0, without, np.diag(np.diag(normal)))
        change = -np.linalg.solve(without, is_free * (matrix.T @ error))
        outside = (error - matrix @ change)[:rows] * scale[owner == run]
        moved.append(change)
        squares.append(by_channel(outside, noise, owner == run))
        informed.append(np.sum((matrix @ covariance) ** 2, axis=0))
    ones = np.ones(owner.size)
    return LeftOut(
        channel_squares=np.array(squares),
        channel_counts=np.array([by_channel(ones[owner == run], noise, owner == run) for run in runs]),
        moved=np.array(moved),
        by_samples=np.sqrt(np.diag(covariance)),
        informed=np.array(informed) / np.diag(covariance),
        keys=tuple(found.free[index].key for index in shared),
    )


def by_channel(values: Array, noise: SensorNoise, here: Mask) -> Array:
    """Return the sum of the squares of some rows in each channel."""
    sums = np.bincount(noise.channel[here], weights=values**2, minlength=noise.channel_sd.size)
    return sums.astype(np.float64)


def shared_parameters(found: Fit) -> list[int]:
    """Return the places of the parameters of all runs."""
    return [index for index, item in enumerate(found.free) if not item.key.run]


def held_parameters(found: Fit) -> Mask:
    """Return which parameters of all runs a bound keeps from a better value."""
    return np.array([_is_held(found, index) for index in shared_parameters(found)], dtype=np.bool_)


def parts_of_runs(found: Fit, owner: Indices) -> list[tuple[int, tuple[Array, Array, int]]]:
    """Return each run with its errors and derivatives, without what its own unknowns can absorb.

    Returns:
        Number; errors, derivatives by the parameters of all runs, and how many of their rows are samples.
    """
    shared = shared_parameters(found)
    return [(int(run), _without_own(found, owner == run, shared)) for run in np.unique(owner)]


def _is_held(found: Fit, index: int) -> bool:
    """Return True where a bound keeps a parameter from a better value."""
    item, value = found.free[index], found.point[found.free[index].key]
    slope = float(found.jacobian.columns([index])[:, 0] @ found.residual - found.pull[index])
    rounding = 1e-9 * max(item.sd, abs(value))
    return (value <= item.lower + rounding and slope < 0.0) or (
        value >= item.upper - rounding and slope > 0.0
    )


def _without_own(found: Fit, here: Mask, shared: Sequence[int]) -> tuple[Array, Array, int]:
    """Return error and derivatives of one run without what its own unknowns can absorb, and its rows."""
    values, places = found.jacobian.rows(here)
    column = {place: index for index, place in enumerate(places)}
    own = [place for place in places if place not in shared and np.any(values[:, column[place]])]
    error = np.concatenate((found.residual[here], -found.pull[own]))
    matrix = np.zeros((values.shape[0] + len(own), len(shared)))
    matrix[: values.shape[0]] = values[:, [column[place] for place in shared]]
    if own:
        starts = values[:, [column[place] for place in own]]
        basis = np.linalg.qr(np.vstack((starts, np.eye(len(own)))))[0]
        error = error - basis @ (basis.T @ error)
        matrix = matrix - basis @ (basis.T @ matrix)
    return error, matrix, int(here.sum())
