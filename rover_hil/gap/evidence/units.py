"""Units of observation, and how well a fit without each of them predicts it.

A unit is a run; where runs repeat under the same conditions and inputs, all of these; where units under test
differ, all runs of one. Where fewer than six are left, it is a stretch of a run, longer than the correlation
time of the errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.derivatives import Indices
from rover_hil.gap.data.problem import Problem
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.fit import RIDGE
from rover_hil.gap.evidence.left_out import (
    by_channel,
    held_parameters,
    leave_one_run_out,
    parts_of_runs,
    shared_parameters,
)
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array, Run


@dataclass(frozen=True, slots=True, kw_only=True)
class Units:
    """Units of observation.

    Attributes:
        kind: What one is, in the plural.
        of_row: Number of the unit of each row with a measured value.
        count: Their number.
        are_parts: Several units are one run.
    """

    kind: str
    of_row: Indices
    count: int
    are_parts: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Predicted:
    """Units predicted by a fit without them.

    Attributes:
        squares: Squared errors in units of the declared noise: units x channels.
        counts: Number of values: units x channels.
    """

    squares: Array
    counts: Array

    @property
    def densities(self) -> Array:
        """Logarithm of the predictive density of each unit, but for a constant that all fits have.

        Each channel of a unit has errors of its own size, which the declared noise knows no better than
        `size_freedom` values would: a unit predicted badly cannot decide alone.
        """
        total: Array = log_densities(self.squares, self.counts).sum(axis=1)
        return total


def log_densities(squares: Array, counts: Array) -> Array:
    """Return the logarithm of the density of errors, but for a constant, by their squares and number."""
    freedom = MACHINES.decide.size_freedom
    found: Array = -0.5 * (freedom + counts) * np.log1p(squares / freedom)
    return found


def observation_units(problem: Problem, found: MachineFit) -> Units:
    """Return the units of observation; `found` gives the correlation time of the errors."""
    owner = problem.owner[found.noise.keep]
    if owner is not problem.observations.site and not np.array_equal(owner, found.noise.site):
        return _numbered("units under test", owner)
    if problem.observations.is_steady:
        return _numbered("conditions", found.noise.site)
    kinds: dict[object, int] = {}
    condition = np.array([kinds.setdefault(_condition(site), len(kinds)) for site in problem.sites])
    units = _numbered(
        "runs" if len(kinds) == len(problem.sites) else "conditions", condition[found.noise.site]
    )
    if units.count >= MACHINES.decide.least_units:
        return units
    return _stretches(found, len(problem.sites)) or units


def _numbered(kind: str, labels: Indices) -> Units:
    names, numbers = np.unique(labels, return_inverse=True)
    return Units(kind=kind, of_row=numbers.reshape(-1).astype(np.intp), count=names.size)


def _condition(site: Run) -> object:
    inputs = tuple((name, np.asarray(values).tobytes()) for name, values in sorted(site.inputs.items()))
    return tuple(sorted(site.conditions.items())), inputs or site.name


def _stretches(found: MachineFit, runs: int) -> Units | None:
    """Return stretches of runs that are long enough; None where there are too few."""
    cells = _cells(found)
    longest = max(_correlation_length(found.errors, cells), 1.0)
    shortest = min(cell.size for cell in cells)
    parts = min(int(shortest / longest), -(-MACHINES.decide.most_stretches // runs))
    if parts * runs < MACHINES.decide.least_units:
        return None
    number = np.zeros(found.noise.site.size, dtype=np.intp)
    for cell in cells:
        place = np.arange(cell.size) * parts // cell.size
        number[cell] = found.noise.site[cell] * parts + place
    units = _numbered("stretches of runs", number)
    return Units(kind=units.kind, of_row=units.of_row, count=units.count, are_parts=True)


def _cells(found: MachineFit) -> list[Indices]:
    """Return the rows of each channel in each run."""
    site, channel = found.noise.site, found.noise.channel
    ends = np.flatnonzero((np.diff(site) != 0) | (np.diff(channel) != 0)) + 1
    return [rows.astype(np.intp) for rows in np.split(np.arange(site.size), ends)]


def _correlation_length(errors: Array, cells: Sequence[Indices]) -> float:
    """Return the sum of the autocorrelation of errors up to its first zero, both ways, in samples."""
    most = max(cell.size for cell in cells) // 2
    products = np.zeros(most + 1)
    for cell in cells:
        own = errors[cell]
        size = 2 * own.size
        spectrum = np.abs(np.fft.rfft(own, size)) ** 2
        own_products = np.fft.irfft(spectrum, size)[: most + 1]
        products[: own_products.size] += own_products
    correlation = products / max(float(products[0]), 1e-300)
    ends = np.flatnonzero(correlation <= 0.0)
    end = int(ends[0]) if ends.size else correlation.size
    return 1.0 + 2.0 * float(correlation[1:end].sum())


def predict_units(found: MachineFit, units: Units) -> Predicted:
    """Return how fits without each unit predict it, by linearisation of the fit to all."""
    found = found.decorrelated
    if not units.are_parts:
        left = leave_one_run_out(found.fit, found.noise, found.declared_sd, units.of_row)
        return Predicted(squares=left.channel_squares, counts=left.channel_counts)
    return _leave_stretches_out(found, units)


def _leave_stretches_out(found: MachineFit, units: Units) -> Predicted:
    """The same where the rest of its run informs the unknowns of the run of a stretch."""
    fit, noise = found.fit, found.noise
    shared = shared_parameters(fit)
    parts = dict(parts_of_runs(fit, noise.site))
    normal = np.eye(len(shared)) + sum(matrix.T @ matrix for _, matrix, _ in parts.values())
    normal += np.diag(np.full(len(shared), RIDGE * float(np.diag(normal).max(initial=1.0))))
    is_held = held_parameters(fit)
    scale = (noise.channel_sd / found.declared_sd)[noise.channel]
    squares = np.zeros((units.count, noise.channel_sd.size))
    counts = np.zeros_like(squares)
    for run, (_, matrix, _) in parts.items():
        here = noise.site == run
        values, places = fit.jacobian.rows(here)
        own = [place for place in places if place not in shared]
        order = [places.index(place) if place in places else -1 for place in (*shared, *own)]
        columns = np.where(np.array(order) >= 0, values[:, order], 0.0)
        whole = np.eye(len(order))
        whole[: len(shared), : len(shared)] = normal - matrix.T @ matrix
        whole += columns.T @ columns
        is_free = np.concatenate((~is_held, np.ones(len(own), dtype=np.bool_)))
        for unit in np.unique(units.of_row[here]):
            rows = units.of_row[here] == unit
            part, error = columns[rows], fit.residual[here][rows]
            without = whole - MACHINES.fit.left_out * part.T @ part
            without = np.where(np.outer(is_free, is_free), without, np.diag(np.diag(whole)))
            change = -np.linalg.solve(without, is_free * (part.T @ error))
            inside = units.of_row == unit
            squares[unit] = by_channel((error - part @ change) * scale[inside], noise, inside)
            counts[unit] = by_channel(np.ones(error.size), noise, inside)
    return Predicted(squares=squares, counts=counts)
