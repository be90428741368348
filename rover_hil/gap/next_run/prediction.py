"""What each explanation predicts of runs that were not made, with all that is uncertain about it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_hil.gap.data.problem import Free, Indices, Observations, Point, Problem, observe
from rover_hil.gap.next_run.hypotheses import Hypothesis
from rover_hil.gap.next_run.planned import PlannedRun
from rover_hil.gap.noise.random_force import ForceBasis, force_basis, prior_covariance, root_of
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array
from sim_backends.models.parameter_key import ParameterKey
from sim_backends.state_model.model import StateModel

FAR_NOISES = 1e6
"""Change of a prediction, in sensor noises, where a model runs away."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blocks:
    """Means of neighbouring samples of one run, each with noise of size one.

    Attributes:
        rows: Rows with a value, in the order of the observations of all planned runs.
        begins: First of the rows of each block.
        scale: Weight of the sum over a block.
        weight: A constant error of one unit in a block.
        channel: Channel of each block.
        place: First sample of each block.
    """

    rows: Indices
    begins: Indices
    scale: Array
    weight: Array
    channel: Indices
    place: Array

    def of(self, values: Array) -> Array:
        """Return the scaled means of full rows, of one vector or of columns."""
        sums = np.add.reduceat(values[self.rows], self.begins, axis=0)
        found: Array = sums * (self.scale if values.ndim == 1 else self.scale[:, None])
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """One explanation's prediction of one run, linearised.

    Attributes:
        mean: Of each block, in units of its noise.
        slopes: Derivatives by the parameters of all runs, per prior deviation: blocks x parameters.
        shared: Factor of the covariance by these parameters: blocks x directions.
        starts: The same by the unknowns of this run.
        errors: The same by the model error.
        excess: Factor on the noise.
        channel: Of each block.
        mean_rows: Prediction of each row, in the unit of its channel.
        sd_rows: Standard deviation of a reading of each row, in that unit.
    """

    mean: Array
    slopes: Array
    shared: Array
    starts: Array
    errors: Array
    excess: float
    channel: Indices
    mean_rows: Array
    sd_rows: Array

    def of_one_run(self) -> Array:
        """Return the covariance of the blocks by what differs from run to run."""
        found: Array = self.excess**2 * np.eye(self.mean.size)
        return found + self.starts @ self.starts.T + self.errors @ self.errors.T

    def covariance(self) -> Array:
        """Return the covariance of the blocks."""
        return self.of_one_run() + self.shared @ self.shared.T


class Planning:
    """Predictions of planned runs by all explanations."""

    def __init__(
        self, hypotheses: Sequence[Hypothesis], planned: Sequence[PlannedRun], basis: ForceBasis | None
    ) -> None:
        self.hypotheses = hypotheses
        self.planned = planned
        self._basis = basis
        machine = hypotheses[0].machine
        self.observations = observe(machine, [one.run for one in planned])
        self.problems = [Problem(one.machine, self.observations) for one in hypotheses]
        self.blocks = [_blocks(self.observations, index) for index in range(len(planned))]
        self._responses: tuple[ForceBasis, Array] | None = None

    def points(self) -> list[dict[ParameterKey, float]]:
        """Return the parameters of each explanation, with the starts of all planned runs."""
        return [{**one.point(), **self._starts()} for one in self.hypotheses]

    def means(self) -> list[Array]:
        """Return the predictions of all rows by each explanation."""
        return [problem.predict(point) for problem, point in zip(self.problems, self.points(), strict=True)]

    def predictions(self) -> list[list[Prediction]]:
        """Return, by planned run, the prediction of each explanation."""
        by_hypothesis = [self._of(index) for index in range(len(self.hypotheses))]
        return [list(row) for row in zip(*by_hypothesis, strict=True)]

    def own_free(self, index: int) -> list[Free]:
        """Return the unknowns of each planned run."""
        starts = self._starts()
        return [
            replace(item, mean=starts.get(item.key, item.mean), start=starts.get(item.key, item.start))
            for item in self.problems[index].run_free(self.hypotheses[index].fit.names)
        ]

    def _starts(self) -> dict[ParameterKey, float]:
        return {
            ParameterKey(name=name, run=one.run.name): value
            for one in self.planned
            for name, value in one.starts.items()
        }

    def _of(self, index: int) -> list[Prediction]:
        hypothesis, problem, point = self.hypotheses[index], self.problems[index], self.points()[index]
        own = self.own_free(index)
        owned = [problem.rows_of(item.key) for item in own]
        free = [*hypothesis.shared, *own]
        mean = problem.predict(point)
        change = problem.derivatives(point, free) * np.array([item.sd for item in free])
        count = len(hypothesis.shared)
        slopes = change[:, :count]
        known = slopes @ root_of(hypothesis.covariance)
        forces = self._forces(hypothesis, point)
        found = []
        for site, blocks in enumerate(self.blocks):
            here = self.observations.site == site
            mine = change[:, [count + place for place, rows in enumerate(owned) if rows[here].any()]]
            columns = np.hstack((known, mine, forces))[here]
            found.append(
                Prediction(
                    mean=blocks.of(np.nan_to_num(mean)),
                    slopes=clipped(blocks.of(slopes)),
                    shared=clipped(blocks.of(known)),
                    starts=clipped(blocks.of(mine)),
                    errors=clipped(np.hstack((blocks.of(forces), _channel_errors(hypothesis, blocks)))),
                    excess=hypothesis.discrepancy.excess,
                    channel=blocks.channel,
                    mean_rows=mean[here],
                    sd_rows=self._deviation(hypothesis, columns, site),
                )
            )
        return found

    def _deviation(self, hypothesis: Hypothesis, columns: Array, site: int) -> Array:
        channel = self.observations.channel[self.observations.site == site]
        declared = np.array([one.noise_sd for one in self.observations.channels])[channel]
        variance = (columns**2).sum(axis=1) + (hypothesis.discrepancy.excess * declared) ** 2
        if hypothesis.discrepancy.channels:
            variance += np.array([size**2 for size, _ in hypothesis.discrepancy.channels])[channel]
        deviation: Array = np.sqrt(variance)
        return deviation

    def _forces(self, hypothesis: Hypothesis, point: Point) -> Array:
        """Return the responses of all rows to independent standard forces, in the unit of their channel."""
        machine = hypothesis.machine
        if self._basis is None or not isinstance(machine, StateModel) or hypothesis.discrepancy.is_negligible:
            return np.zeros((self.observations.values.size, 0))
        if self._responses is None:
            self._responses = self._force_responses(self._basis, machine, point)
        basis, responses = self._responses
        found: Array = responses @ root_of(prior_covariance(basis, hypothesis.discrepancy.sizes))
        return found

    def _force_responses(
        self, measured: ForceBasis, machine: StateModel, point: Point
    ) -> tuple[ForceBasis, Array]:
        """Return the responses to forces; those of one explanation serve for all."""
        keep = np.arange(self.observations.values.size, dtype=np.intp)
        problem = Problem(machine, self.observations)
        basis = force_basis(problem, machine, point, keep, np.ones(keep.size), spacing=measured.spacing)
        full = np.zeros((keep.size, basis.knots * len(basis.ports)))
        for site, responses in enumerate(basis.responses):
            full[self.observations.site == site] = responses
        return basis, full


def clipped(factor: Array) -> Array:
    """Return a factor without numbers whose squares would be lost."""
    found: Array = np.clip(np.nan_to_num(factor), -FAR_NOISES, FAR_NOISES)
    return found


def _channel_errors(hypothesis: Hypothesis, blocks: Blocks) -> Array:
    """Return the factor of the model error in channels without ports."""
    parts = []
    for channel, (size, correlation) in enumerate(hypothesis.discrepancy.channels):
        here = np.flatnonzero(blocks.channel == channel)
        if size == 0.0 or not here.size:
            continue
        apart = np.abs(np.subtract.outer(blocks.place[here], blocks.place[here]))
        root = np.linalg.cholesky(np.exp(-apart / max(correlation, 1.0)) + 1e-9 * np.eye(here.size))
        part = np.zeros((blocks.channel.size, here.size))
        part[here] = size * blocks.weight[here][:, None] * root
        parts.append(part)
    return np.hstack(parts) if parts else np.zeros((blocks.channel.size, 0))


def _blocks(observations: Observations, site: int) -> Blocks:
    rows, begins, scales, weights, channels, places = [], [], [], [], [], []
    present = [
        index
        for index in range(len(observations.channels))
        if np.any((observations.site == site) & (observations.channel == index))
    ]
    most = max(MACHINES.decision.most_blocks // max(len(present), 1), 10)
    total = 0
    for index in present:
        cell = np.flatnonzero((observations.site == site) & (observations.channel == index))
        has_value = np.flatnonzero(np.isfinite(observations.values[cell]))
        if not has_value.size:
            continue
        width = math.ceil(has_value.size / most)
        first = np.arange(0, has_value.size, width)
        count = np.diff(first, append=has_value.size)
        rows.append(cell[has_value])
        begins.append(total + first)
        scales.append(1.0 / (np.sqrt(count) * observations.channels[index].noise_sd))
        weights.append(np.sqrt(count) / observations.channels[index].noise_sd)
        channels.append(np.full(first.size, index))
        places.append(has_value[first].astype(np.float64))
        total += has_value.size
    return Blocks(
        rows=np.concatenate(rows).astype(np.intp),
        begins=np.concatenate(begins).astype(np.intp),
        scale=np.concatenate(scales),
        weight=np.concatenate(weights),
        channel=np.concatenate(channels).astype(np.intp),
        place=np.concatenate(places),
    )
