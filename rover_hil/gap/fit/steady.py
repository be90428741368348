"""Steady experiments as runs of a machine with one sample each, transformed to independent errors.

Replicates of one condition are one run, their mean. Their scatter moves the channels of a run together, grows
with their size and falls with the number of replicates: each run is transformed so that its errors are
independent and as large as the typical error of each channel. The prediction is transformed alike.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from drivers.errors import ModelError
from rover_hil.gap.data.observed_model import ObservedModel
from rover_hil.gap.data.problem import Group, group_runs
from rover_hil.gap.evidence.evidence import RowEvidence
from rover_hil.gap.fit.called_machine import CalledMachine
from rover_hil.gap.noise.replicates import Scatter, estimate_scatter, group_covariance, winsorise
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array, Channel, Model, Run, Values


class SteadyMachine(CalledMachine):
    """A model of steady experiments as a machine whose runs have one sample.

    The channels have their typical error as noise; `typical` is the covariance of those of one usual run.
    """

    def __init__(
        self,
        model: Model,
        runs: Sequence[Run],
        channels: tuple[Channel, ...],
        freedom: float,
        typical: Array,
    ) -> None:
        super().__init__(model, runs, channels, RowEvidence(freedom))
        self._given = tuple(ObservedModel(model, runs).channels)
        self._typical = typical
        self._roots: dict[str, Array] = {}

    def predict_points(
        self, runs: Sequence[Run], points: Sequence[tuple[Values, Mapping[str, Values]]]
    ) -> list[list[dict[str, Array]]]:
        """Predict at several points, transformed. See `Machine.predict_points`."""
        found = super().predict_points(runs, points)
        return [
            [self._transformed(run, table) for run, table in zip(runs, tables, strict=True)]
            for tables in found
        ]

    def observed(self, groups: Sequence[Group], covariance: Array | None = None) -> list[Run]:
        """Return groups of replicates as runs of this machine."""
        for index, group in enumerate(groups):
            single = self._typical if covariance is None else covariance[index]
            self._roots[group.site.name] = self._root(group, single)
        return [
            replace(group.site, measured=self._transformed(group.site, group.site.measured))
            for group in groups
        ]

    def _root(self, group: Group, single: Array) -> Array:
        here = self._places(group.site)
        names = [self._given[one].name for one in here]
        counts = np.array([float(sum(1 for run in group.runs if name in run.measured)) for name in names])
        covariance = group_covariance([self._given[one] for one in here], single[np.ix_(here, here)], counts)
        values, vectors = np.linalg.eigh(covariance)
        root: Array = vectors @ np.diag(1.0 / np.sqrt(np.maximum(values, 1e-300))) @ vectors.T
        sizes = np.array([self.channels[one].noise_sd for one in here])
        return sizes[:, None] * root

    def _places(self, run: Run) -> list[int]:
        return [index for index, one in enumerate(self._given) if one.name in run.measured]

    def _transformed(self, run: Run, table: Mapping[str, Array]) -> dict[str, Array]:
        here = self._places(run)
        if run.name not in self._roots:
            self._roots[run.name] = self._root(Group(site=run, runs=(run,)), self._typical)
        values = self._roots[run.name] @ np.array([float(table[self._given[one].name][0]) for one in here])
        return {self._given[one].name: values[place : place + 1] for place, one in enumerate(here)}


def steady_machine(
    model: Model, runs: Sequence[Run], locked: Sequence[Run]
) -> tuple[SteadyMachine, list[Run], list[Run]]:
    """Return a model of steady experiments as a machine, with its runs and its locked runs.

    Raises:
        ModelError: The model has no solution for many of the runs.
    """
    solved = _solved(model, runs)
    groups = group_runs(model, solved)
    scatter = _scatter(model, groups)
    cleaned = winsorise(groups, model.channels, scatter)
    if any(new is not old for new, old in zip(cleaned, solved, strict=True)):
        groups = group_runs(model, cleaned)
        scatter = _scatter(model, groups)
    mean = scatter.covariance.mean(axis=0)
    channels = []
    for index, channel in enumerate(model.channels):
        counts = [sum(1 for run in group.runs if channel.name in run.measured) for group in groups]
        typical = group_covariance(
            [channel], mean[index : index + 1, index : index + 1], np.array([np.mean(counts)])
        )
        channels.append(replace(channel, sigma=float(np.sqrt(typical[0, 0])), quantum=0.0, tolerance=0.0))
    freedom = float(scatter.freedom.min())
    machine = SteadyMachine(model, runs, tuple(channels), freedom, mean)
    return machine, machine.observed(groups, scatter.covariance), machine.observed(group_runs(model, locked))


def _scatter(model: Model, groups: Sequence[Group]) -> Scatter:
    return estimate_scatter(groups, model.channels, _condition_gradient(model, [one.site for one in groups]))


def _condition_gradient(model: Model, sites: Sequence[Run]) -> Array:
    """Return the change of each channel per unit of each condition: sites x channels x conditions."""
    base = _table(model, sites)
    gradient = np.zeros((*base.shape, len(model.condition_units)))
    for index, name in enumerate(model.condition_units):
        values = [site.conditions[name] for site in sites]
        step = MACHINES.steady.condition_step * float(np.ptp(values))
        if step <= 0.0:
            continue
        moved = [
            replace(site, conditions={**site.conditions, name: site.conditions[name] + step})
            for site in sites
        ]
        gradient[:, :, index] = (_table(model, moved) - base) / step
    return np.where(np.isfinite(gradient), gradient, 0.0)


def _table(model: Model, sites: Sequence[Run]) -> Array:
    predicted = model.predict(sites, {}, {})
    return np.array([[float(one[item.name][0]) for item in model.channels] for one in predicted])


def _solved(model: Model, runs: Sequence[Run]) -> list[Run]:
    groups = group_runs(model, runs)
    tables = model.predict([group.site for group in groups], {}, {})
    good: list[Run] = []
    bad: list[str] = []
    for group, table in zip(groups, tables, strict=True):
        if all(np.isfinite(table[name]).all() for name in group.site.measured):
            good += group.runs
        else:
            bad += [run.name for run in group.runs]
    if len(bad) > MACHINES.steady.unsolved_share * len(runs):
        raise ModelError(
            f"{model.name} has no solution for {len(bad)} of {len(runs)} runs, {bad[0]} among them: "
            "its parameters or the conditions are out of its domain"
        )
    return good
