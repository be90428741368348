"""A model of series that can only be called, as a machine without ports; its sensor noise may be learned."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rover_hil.drives.arrays import rms
from rover_hil.gap.data.observed_model import ObservedModel
from rover_hil.gap.data.problem import Point, Problem, cells, observe
from rover_hil.gap.evidence.card_changes import card_changes
from rover_hil.gap.evidence.evidence import Evidence, LearnedEvidence
from rover_hil.gap.evidence.terms import series_terms, term_changes
from rover_hil.gap.noise.autoregression import Autoregression, learn_autoregression
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import (
    Array,
    Channel,
    DrivenModel,
    Model,
    Parameter,
    Run,
    RunParameter,
    Values,
)

TIME = "t_s"
ROUNDING = 1e-9
"""Least size of errors, as a share of the values: below it is rounding of the arithmetic."""


class CalledMachine(ObservedModel):
    """A model that predicts series, as a machine without ports and without states of its own.

    What it is fed with was measured and cannot be chosen, so that its inputs count as signals inside.
    """

    def __init__(
        self,
        model: Model,
        runs: Sequence[Run],
        channels: tuple[Channel, ...] = (),
        evidence: Evidence | None = None,
    ) -> None:
        super().__init__(model, runs)
        self.channels = channels or self.channels
        self.evidence: Evidence = evidence or Evidence()
        units = dict(self.input_units) if isinstance(model, DrivenModel) else {}
        self.input_units: Mapping[str, str] = units
        self.states: Mapping[str, str] = {name: unit for name, unit in units.items() if name != TIME}
        self.inputs: Mapping[str, str] = {}
        self.step_s: float | None = None if TIME in units else float(getattr(model, "step_s", None) or 1.0)
        self.run_parameters: tuple[RunParameter, ...] = ()
        self._names = frozenset(one.name for one in self.parameters)

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict every channel of every run. See `Model.predict`."""
        return self.predict_points(runs, [(parameters, effects)])[0]

    def predict_points(
        self, runs: Sequence[Run], points: Sequence[tuple[Values, Mapping[str, Values]]]
    ) -> list[list[dict[str, Array]]]:
        """Predict at several points; deviations of single runs act there. See `Machine.predict_points`.

        Points that appear more than once, as the middle of derivatives does, are predicted once.
        """
        found: dict[tuple[object, ...], list[dict[str, Array]]] = {}
        keys = [_key_of(*one) for one in points]
        for key, (parameters, effects) in zip(keys, points, strict=True):
            if key not in found:
                found[key] = self._at(runs, parameters, effects)
        return [found[key] for key in keys]

    def trajectories(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Return what the model is fed with in each run."""
        return [{name: run.inputs[name] for name in self.states} for run in runs]

    def refined(self, runs: Sequence[Run]) -> "CalledMachine":
        """Return itself: its steps are its own."""
        return self

    def _at(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        if parameters.keys() <= self._names:
            return super().predict(runs, parameters, effects)
        return [
            table
            for run in runs
            for table in super(CalledMachine, self).predict([run], *self._of_run(run, parameters, effects))
        ]

    def _of_run(
        self, run: Run, parameters: Values, effects: Mapping[str, Values]
    ) -> tuple[Values, Mapping[str, Values]]:
        """Return the parameters of a run with its deviations."""

        def moved(item: Parameter, value: float, effect: str = "") -> float:
            by = parameters.get(item.deviation_in(run, effect).text, 0.0)
            return min(max(value + by, item.lower), item.upper)

        own = {one.name: moved(one, parameters.get(one.name, one.nominal)) for one in self.parameters}
        active = {name: dict(values) for name, values in effects.items()}
        for card in self.effects:
            if card.name in active:
                first = card.parameters[0]
                value = active[card.name].get(first.name, first.nominal)
                active[card.name][first.name] = moved(first, value, card.name)
        return own, active


def _key_of(parameters: Values, effects: Mapping[str, Values]) -> tuple[object, ...]:
    active = [(name, tuple(sorted(values.items()))) for name, values in effects.items()]
    return tuple(sorted(parameters.items())), tuple(sorted(active))


def called_machine(model: Model, runs: Sequence[Run]) -> CalledMachine:
    """Return a model of series as a machine; noise that a channel does not declare is learned.

    It is what remains if base parameters, effects and free-form terms take away all that they can, to first
    order. Errors that are slower than noise may be errors of the model: then only their fast part counts.
    """
    whole = CalledMachine(model, runs)
    if all(one.sigma for one in whole.channels):
        return whole
    problem = Problem(whole, observe(whole, runs))
    remaining = _remaining(problem)
    channels, slow, errors = list[Channel](), list[str](), list[tuple[Array, float]]()
    for index, channel in enumerate(whole.channels):
        rows = [one for one in cells(problem.observations) if problem.observations.channel[one[0]] == index]
        if channel.sigma or not rows:
            channels.append(channel)
            errors.append((np.zeros(0), 1.0))
            continue
        values = [remaining[one][np.isfinite(remaining[one])] for one in rows]
        fast = rms(np.concatenate([np.diff(one) for one in values])) / np.sqrt(2.0)
        size = rms(np.concatenate(values))
        if size > MACHINES.noise.slow * fast:
            slow.append(channel.name)
            size = fast
        measured = problem.observations.values[np.concatenate(rows)]
        size = max(size, ROUNDING * rms(measured[np.isfinite(measured)]), 1e-12)
        lags, new_sd = learn_autoregression([remaining[one] for one in rows])
        errors.append((lags, max(new_sd / size, ROUNDING)))
        step = channel.quantum / np.sqrt(12.0)
        channels.append(replace(channel, sigma=float(np.sqrt(max(size**2 - step**2, (1e-3 * size) ** 2)))))
    neighbours = Autoregression(
        lags=tuple(lags for lags, _ in errors), new_sd=tuple(new_sd for _, new_sd in errors)
    )
    evidence = LearnedEvidence(tuple(slow), neighbours)
    return CalledMachine(model, runs, tuple(channels), evidence)


def _remaining(problem: Problem) -> Array:
    """Return measured minus predicted of an overfitted model, larger by the freedom that the fit took."""
    observations = problem.observations
    point: Point = {}
    predicted = problem.predict(point)
    units = problem.model.input_units if isinstance(problem.model, DrivenModel) else {}
    terms = series_terms(observations, predicted, units, problem.model.condition_units)
    columns = list(problem.derivatives(point, problem.base_free()).T)
    columns += [one.change for one in card_changes(problem, point, problem.model.effects)]
    columns += [one.change for one in term_changes(observations, terms)]
    residual = observations.values - predicted
    here = np.isfinite(residual)
    matrix = np.nan_to_num(np.stack(columns, axis=1))
    matrix /= np.maximum(np.sqrt((matrix**2).mean(axis=0)), 1e-300)
    shift, _, rank, _ = np.linalg.lstsq(matrix[here], residual[here], rcond=1e-6)
    count = int(here.sum())
    remaining: Array = (residual - matrix @ shift) * np.sqrt(count / max(count - int(rank), 1))
    return remaining
