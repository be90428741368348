"""A functional mock-up unit as a model of a machine."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.errors import ConfigError
from sim_backends.fmu.instance import Job, Result
from sim_backends.fmu.workers import Workers
from sim_backends.models.interface import Array, Channel, EffectCard, Parameter, Run, RunParameter, Values
from sim_backends.models.parameter_key import ParameterKey, joined_name
from sim_backends.state_model.model import MOST_SUBSTEPS, SOLVED_SHARE
from sim_backends.state_model.sample_times import even_step_s


@dataclass(frozen=True, kw_only=True)
class UnitModel:
    """A unit with parameters, effects and unknowns of each run; all are variables of the unit.

    It has no ports: a unit does not let a force act inside.

    Attributes:
        name: Its identifier.
        inputs: Input to unit.
        states: Further signals that are read from it, to unit.
        channels: What is measured.
        parameters: Base parameters.
        run_parameters: Unknowns of each run.
        condition_units: Conditions of each run.
        effects: Effects that may be missing.
        settings: Name of what is set before each simulation, in the order of the unit; a parameter of an
            effect is called `effect.parameter`.
        outputs: Channels and signals, in the order of the unit.
        errors: Parameter of an effect, to the base parameter that it is added to.
        workers: Simulate.
        step_s: Time between samples; None where the runs have an input `t_s`.
        is_held: Inputs keep their value until the next sample.
        communication_step_s: As the file gives it; None where it is chosen.
        substeps: Communication steps per sample where the file gives no step.
    """

    name: str
    inputs: Mapping[str, str]
    states: Mapping[str, str]
    channels: tuple[Channel, ...]
    parameters: tuple[Parameter, ...]
    run_parameters: tuple[RunParameter, ...]
    condition_units: Mapping[str, str]
    effects: tuple[EffectCard, ...]
    settings: tuple[str, ...]
    outputs: tuple[str, ...]
    errors: Mapping[str, str]
    workers: Workers
    step_s: float | None = None
    is_held: bool = True
    communication_step_s: float | None = None
    substeps: int = 1

    @property
    def input_units(self) -> Mapping[str, str]:
        """The inputs it needs and their units."""
        return self.inputs if self.step_s is not None else {"t_s": "s", **self.inputs}

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict every channel of every run. See `Model.predict`."""
        return self.predict_points(runs, [(parameters, effects)])[0]

    def predict_points(
        self, runs: Sequence[Run], points: Sequence[tuple[Values, Mapping[str, Values]]]
    ) -> list[list[dict[str, Array]]]:
        """Predict at several points at once; NaN from where the unit fails. See `Machine.predict_points`."""
        results = self._simulate(runs, points)
        names = [one.name for one in self.channels]
        return [[self._table(result, names) for result in row] for row in results]

    def trajectories(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Return signals and inputs of each run over its samples."""
        (results,) = self._simulate(runs, [(parameters, effects)])
        return [
            {**self._table(result, list(self.states)), **{name: run.inputs[name] for name in self.inputs}}
            for run, result in zip(runs, results, strict=True)
        ]

    def failure(self, run: Run) -> str:
        """Return what fails in a run at nominal parameters; empty for nothing."""
        return self._simulate([run], [({}, {})])[0][0].failure

    def with_active(self, parameters: tuple[Parameter, ...], active: Sequence[str]) -> "UnitModel":
        """Return the same model with some effects as a part of it."""
        inactive = tuple(card for card in self.effects if card.name not in active)
        return replace(self, parameters=parameters, effects=inactive)

    def refined(self, runs: Sequence[Run]) -> "UnitModel":
        """Return the same model with communication steps that are small enough for `runs`.

        They are halved until the prediction moves by less than 10 % of the sensor noise, at the nominal
        parameters and with each effect at its natural size. A step that the file gives is kept.

        Raises:
            ConfigError: 32 steps per sample are not enough.
        """
        if self.communication_step_s is not None:
            return self._at_given_step(runs)
        points: list[tuple[Values, Mapping[str, Values]]] = [({}, {})]
        points += [
            ({}, {card.name: {(one := card.parameters[0]).name: one.natural}}) for card in self.effects
        ]
        coarse = self.predict_points(runs, points)
        substeps = 1
        while substeps <= MOST_SUBSTEPS:
            finer = replace(self, substeps=2 * substeps)
            fine = finer.predict_points(runs, points)
            if self._are_close(coarse, fine):
                return replace(self, substeps=substeps)
            substeps, coarse = 2 * substeps, fine
        raise ConfigError(
            f"model {self.name}: {MOST_SUBSTEPS} communication steps per sample are not enough: give "
            "communication_step_s in its file to use one that you trust"
        )

    def _at_given_step(self, runs: Sequence[Run]) -> "UnitModel":
        given = self.communication_step_s or 1.0
        for run in runs:
            step_s = even_step_s(run, self.step_s)
            if abs(step_s / given - round(step_s / given)) > 1e-6 or step_s < 0.5 * given:
                raise ConfigError(
                    f"model {self.name}: communication_step_s = {given:g} does not divide the {step_s:g} s "
                    f"between the samples of run {run.name}"
                )
        return self

    def _substeps_in(self, step_s: float) -> int:
        """Return the communication steps in a sample."""
        if self.communication_step_s is None:
            return self.substeps
        return max(round(step_s / self.communication_step_s), 1)

    def _are_close(
        self, coarse: Sequence[Sequence[Mapping[str, Array]]], fine: Sequence[Sequence[Mapping[str, Array]]]
    ) -> bool:
        """Return True where no prediction moves; where the unit accepts no finer step, none can."""
        for channel in self.channels:
            for before, after in zip(coarse, fine, strict=True):
                one = np.concatenate([table[channel.name] for table in before])
                other = np.concatenate([table[channel.name] for table in after])
                scale = channel.noise_sd or 0.02 * float(np.nanstd(other))
                both = np.isfinite(one) & np.isfinite(other)
                if np.isfinite(other).sum() > np.isfinite(one).sum():
                    return False
                moved = float(np.sqrt(np.mean((other - one)[both] ** 2))) if both.any() else 0.0
                if moved > SOLVED_SHARE * scale:
                    return False
        return True

    def _table(self, result: Result, names: Sequence[str]) -> dict[str, Array]:
        return {name: result.outputs[self.outputs.index(name)] for name in names}

    def _simulate(
        self, runs: Sequence[Run], points: Sequence[tuple[Values, Mapping[str, Values]]]
    ) -> list[list[Result]]:
        """Return the simulation of each run at each point; equal ones are made once."""
        jobs: dict[tuple[int, tuple[float, ...]], Job] = {}
        wanted = []
        series = [self._series(run) for run in runs]
        for parameters, effects in points:
            shared = self._shared(parameters, effects)
            for index, run in enumerate(runs):
                key = (index, self._settings_of(run, parameters, shared))
                wanted.append(key)
                if key not in jobs:
                    jobs[key] = replace(series[index], settings=key[1])
        by_job = dict(zip(jobs, self.workers.simulate(list(jobs.values())), strict=True))
        results = [by_job[key] for key in wanted]
        return [results[first : first + len(runs)] for first in range(0, len(results), len(runs) or 1)]

    def _series(self, run: Run) -> Job:
        inputs = [run.inputs[name] for name in self.inputs]
        step_s = even_step_s(run, self.step_s)
        return Job(
            settings=(),
            inputs=np.array(inputs) if inputs else np.zeros((0, run.count)),
            count=run.count,
            step_s=step_s,
            substeps=self._substeps_in(step_s),
            is_held=self.is_held,
        )

    def _shared(self, parameters: Values, effects: Mapping[str, Values]) -> dict[str, float]:
        """Return the settings of all runs."""
        values = {one.name: one.nominal for one in self.parameters} | dict(parameters)
        for card in self.effects:
            given = effects.get(card.name, {})
            for one in card.parameters:
                values[joined_name(card.name, one.name)] = given.get(one.name, one.nominal)
        return values

    def _deviating(
        self, run: Run, parameters: Values, shared: Mapping[str, float]
    ) -> Iterator[tuple[str, float]]:
        """Yield the parameters that deviate in a run from their value in all runs."""
        strengths = [(card.name, card.parameters[0]) for card in self.effects]
        for effect, item in [*(("", one) for one in self.parameters), *strengths]:
            moved = parameters.get(item.deviation_in(run, effect).text)
            if moved is not None:
                name = ParameterKey(name=item.name, effect=effect).text
                yield name, min(max(shared[name] + moved, item.lower), item.upper)

    def _settings_of(self, run: Run, parameters: Values, shared: Mapping[str, float]) -> tuple[float, ...]:
        own = {
            one.name: parameters.get(one.key_in(run).text, one.nominal_in(run)) for one in self.run_parameters
        }
        values = {**shared, **own, **run.conditions, **dict(self._deviating(run, parameters, shared))}
        for error, parameter in self.errors.items():
            values[parameter] += values[error]
        return tuple(float(values[name]) for name in self.settings)
