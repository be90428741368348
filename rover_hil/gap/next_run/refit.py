"""What new runs change in the errors of the measured ones: a new fit to all of them, linearised."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Indices
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.fit import RIDGE
from rover_hil.gap.evidence.left_out import held_parameters, parts_of_runs
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """Sums over the samples of one measured run, in the units of the fit and in those of the sensors."""

    gram: Array
    moment: Array
    declared_gram: Array
    declared_moment: Array
    declared_square: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NewRun:
    """Simulated outcomes of one new run.

    Attributes:
        errors: Data minus prediction, in noises of the sensors: blocks x draws.
        slopes: Derivatives of the prediction by the parameters of all runs: blocks x parameters.
        starts: The same by the unknowns of this run.
        channel: Of each block.
    """

    errors: Array
    slopes: Array
    starts: Array
    channel: Indices


class Refit:
    """The measured runs under one explanation, and their left-out errors once new runs are added."""

    def __init__(self, found: MachineFit, owner: Indices) -> None:
        declared = (found.noise.channel_sd / found.declared_sd)[found.noise.channel]
        self._ratio = found.declared_sd / found.noise.channel_sd
        self._runs: list[_Run] = []
        for number, (error, matrix, rows) in parts_of_runs(found.fit, owner):
            scale = declared[owner == number]
            inside, change = error[:rows] * scale, matrix[:rows] * scale[:, None]
            self._runs.append(
                _Run(
                    gram=matrix.T @ matrix,
                    moment=matrix.T @ error,
                    declared_gram=change.T @ change,
                    declared_moment=change.T @ inside,
                    declared_square=float(inside @ inside),
                )
            )
        self._held = held_parameters(found.fit)

    def squares(self, new: Sequence[NewRun]) -> Array:
        """Return the squared errors of all runs when they are left out, measured ones first: draws x runs."""
        count = self._held.size
        added = [self._without_own(run) for run in new]
        gram: Array = np.eye(count)
        for one in self._runs:
            gram = gram + one.gram
        moment = np.zeros((count, new[0].errors.shape[1]))
        for matrix, errors, _ in added:
            gram = gram + matrix.T @ matrix
            moment = moment + matrix.T @ errors
        gram = gram + RIDGE * float(np.diag(gram).max(initial=1.0)) * np.eye(count)
        found = []
        for one in self._runs:
            moved = self._moved(gram, one.gram, moment - one.moment[:, None])
            square = one.declared_square - 2.0 * one.declared_moment @ moved
            found.append(square + np.einsum("ij,ik,kj->j", moved, one.declared_gram, moved))
        for matrix, errors, weight in added:
            moved = self._moved(gram, matrix.T @ matrix, moment - matrix.T @ errors)
            outside = (errors - matrix @ moved)[: weight.size] / weight[:, None]
            found.append((outside**2).sum(axis=0))
        squares: Array = np.maximum(np.stack(found, axis=1), 1e-9)
        return squares

    def _moved(self, gram: Array, own: Array, aim: Array) -> Array:
        """Return how the absence of a run moves the parameters."""
        without: Array = gram - MACHINES.fit.left_out * own
        without[self._held, :], without[:, self._held] = 0.0, 0.0
        without[self._held, self._held] = 1.0
        return np.asarray(np.linalg.solve(without, np.where(self._held[:, None], 0.0, aim)))

    def _without_own(self, run: NewRun) -> tuple[Array, Array, Array]:
        """Return derivatives and errors of a new run, without what its own unknowns can absorb, and weights.

        As in the left-out errors of the search, the priors of the unknowns are further rows.
        """
        weight = self._ratio[run.channel]
        own = run.starts.shape[1]
        matrix = np.vstack((run.slopes * weight[:, None], np.zeros((own, run.slopes.shape[1]))))
        errors = np.vstack((run.errors * weight[:, None], np.zeros((own, run.errors.shape[1]))))
        basis = np.linalg.qr(np.vstack((run.starts * weight[:, None], np.eye(own))))[0]
        return matrix - basis @ (basis.T @ matrix), errors - basis @ (basis.T @ errors), weight
