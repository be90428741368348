"""Integration of a machine: all runs and all trials of parameters at once, by fourth-order Runge-Kutta."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from sim_backends.models.interface import Array, Parameter, Run, RunParameter, Values
from sim_backends.state_model.equations import Equations
from sim_backends.state_model.held_input import delayed, lagged, lagged_samples, mean_over_steps, played
from sim_backends.state_model.port_effect import Action, Change, PortEffect
from sim_backends.state_model.recorded import RecordedLanes, are_equal
from sim_backends.state_model.sample_times import sample_times_s
from sim_backends.state_model.tape import make_tape
from sim_backends.state_model.tracing import Graph, Source, Traced, TracedStack

FINER = 4
"""Parts of the time between samples in which signals behind a delay or a lag are known: each straight."""
CHECKED = 5
"""Samples, spread over the runs, at which recorded equations are compared with those that were given."""


@dataclass(frozen=True, slots=True)
class Active:
    """An effect that is not at its null, at one of its ports.

    Attributes:
        effect: It.
        change: Of the signal at this port.
        values: Its parameters: points x 1.
        memory: Where its own states are; None without.
        is_first: The port where its own states change.
    """

    effect: PortEffect
    change: Change | None
    values: SimpleNamespace
    memory: int | slice | None
    is_first: bool


@dataclass(frozen=True, slots=True)
class Point:
    """Where to simulate: base parameters, effects, and a force at a port over time."""

    parameters: Values
    effects: Mapping[str, Values]
    force: tuple[str, Array] | None = None


class Simulation:
    """One integration of points x runs, each run with its own times and length.

    Raises:
        ConfigError: The times of a run do not increase.
    """

    def __init__(self, model: Equations, runs: Sequence[Run], points: Sequence[Point]) -> None:
        self._model = model
        self._runs = runs
        self._points = points
        is_late = any(one.action in (Action.DELAY, Action.LAG) for one in model.port_effects)
        # Also at points without the effect: otherwise the finer steps alone would look like a delay.
        self._parts = FINER if is_late else 1
        times = [_refined(sample_times_s(run, model.step_s), self._parts) for run in runs]
        self._sizes = [one.size for one in times]
        self._samples = max(self._sizes)
        self._times_s = _table(times, self._samples + 1)
        self._widths_s = np.diff(self._times_s)
        self._shape = (len(points), len(runs))
        self._memories = 0
        self._active = self._active_effects()
        self._parameters = self._parameter_values()
        self._inputs = {name: self._input(name) for name in model.inputs}
        self._forces = self._force_series()

    def tables(self) -> list[list[dict[str, Array]]]:
        """Return the channels of each run at each point."""
        with np.errstate(all="ignore"):
            states = self._integrate()
            channels = self._outputs(states)
        return [
            [
                {
                    name: np.where(np.isfinite(row := values[point, run, self._of(run)]), row, np.nan)
                    for name, values in channels.items()
                }
                for run in range(len(self._runs))
            ]
            for point in range(len(self._points))
        ]

    def trajectories(self) -> list[dict[str, Array]]:
        """Return states and inputs of each run over its samples, at the first point."""
        with np.errstate(all="ignore"):
            states = self._integrate()
        series = {name: self._input_at_samples(name)[0] for name in self._inputs}
        series |= {name: values[0] for name, values in zip(self._model.states, states, strict=False)}
        return [
            {name: values[run, self._of(run)] for name, values in series.items()}
            for run in range(len(self._runs))
        ]

    def _of(self, run: int) -> slice:
        """Return where the samples of a run are."""
        return slice(0, self._sizes[run], self._parts)

    def _samples_of(self, name: str, size: int) -> Array:
        """Return an input of all runs at the samples, continued to one length."""
        rows = [run.inputs[name] for run in self._runs]
        if self._parts > 1 and not self._model.is_held:
            rows = [_refined(one, self._parts) for one in rows]
        elif self._parts > 1:
            rows = [np.repeat(one, self._parts)[: 1 - self._parts] for one in rows]
        return np.stack([_padded(one, size) for one in rows])

    def _active_effects(self) -> dict[str, list[Active]]:
        """Return, by port, the effects that are not at their null at every point, and their parameters."""
        found: dict[str, list[Active]] = {}
        for effect, card in zip(self._model.port_effects, self._model.effects, strict=True):
            if not any(card.name in point.effects for point in self._points):
                continue
            tables = [point.effects.get(card.name, {}) for point in self._points]
            values = {
                one.name: self._with_deviations(self._column(tables, one), one, card.name)
                for one in card.parameters
            }
            strength = card.parameters[0]
            if np.any(values[strength.name] != strength.nominal):
                ordered = {f"v{index}": values[one.name] for index, one in enumerate(card.parameters)}
                numbers, memory = SimpleNamespace(**values, **ordered), self._new_memory(effect)
                for port, change in {effect.port: effect.change, **effect.elsewhere}.items():
                    one = Active(effect, change, numbers, memory, port == effect.port)
                    found.setdefault(port, []).append(one)
        return found

    def _new_memory(self, effect: PortEffect) -> int | slice | None:
        """Return where the own states of an effect are among all states; None without."""
        if effect.memory_rate is None:
            return None
        begin = len(self._model.states) + self._memories
        self._memories += effect.memories
        return begin if effect.memories == 1 else slice(begin, begin + effect.memories)

    def _column(self, tables: Sequence[Values], parameter: Parameter) -> Array:
        """Return the value of a parameter at each point: points x 1."""
        return np.array([[table.get(parameter.name, parameter.nominal)] for table in tables])

    def _parameter_values(self) -> dict[str, Array]:
        tables = [point.parameters for point in self._points]
        values = {
            item.name: self._with_deviations(self._column(tables, item), item)
            for item in self._model.parameters
        }
        for name, active in self._active.items():
            for one in active:
                if one.effect.action is Action.RELEASE:
                    values[name] = values[name] + one.values.v0
        for unknown in self._model.run_parameters:
            values[unknown.name] = self._run_parameter(unknown)
        for name in self._model.condition_units:
            values[name] = np.array([[run.conditions[name] for run in self._runs]])
        return values

    def _with_deviations(self, values: Array, parameter: Parameter, effect: str = "") -> Array:
        """Return a parameter at each point and, where runs deviate from it, in each run."""
        keys = [parameter.deviation_in(run, effect).text for run in self._runs]
        if not any(key in point.parameters for point in self._points for key in keys):
            return values
        moved = np.array([[point.parameters.get(key, 0.0) for key in keys] for point in self._points])
        inside: Array = np.clip(values + moved, parameter.lower, parameter.upper)
        return inside

    def _run_parameter(self, parameter: RunParameter) -> Array:
        values = np.empty(self._shape)
        for index, run in enumerate(self._runs):
            nominal = parameter.nominal_in(run)
            key = parameter.key_in(run).text
            values[:, index] = [point.parameters.get(key, nominal) for point in self._points]
        return values

    def _input(self, name: str) -> Array:
        """Return an input with its effects over each integration step: points x runs x steps.

        The steps go on after the last sample, where the last value holds, so that it can be read there.
        """
        active, model = self._active.get(name, []), self._model
        samples = self._samples_of(name, self._samples + 1)
        delay_s = _delay_s(active)
        series = mean_over_steps(samples, self._times_s, delay_s, model.substeps, is_held=model.is_held)
        widths_s = np.repeat(self._widths_s, model.substeps, axis=1) / model.substeps
        return _signal_effects(active, series, partial(lagged, widths_s=widths_s))

    def _input_at_samples(self, name: str) -> Array:
        """Return an input with its effects at the samples: points x runs x samples."""
        if self._model.is_held:
            return self._inputs[name][..., :: self._model.substeps]
        active = self._active.get(name, [])
        samples = self._samples_of(name, self._samples)
        series = delayed(samples[None], self._times_s[:, :-1], _delay_s(active))
        return _signal_effects(active, series, partial(lagged_samples, widths_s=self._widths_s))

    def _force_series(self) -> dict[str, Array]:
        """Return, by port, forces over each integration step: points x runs x steps, or one for all."""
        found: dict[str, Array] = {}
        known = self._model.known_forces
        for port in self._model.ports:
            rows = [known.get(run.name, {}).get(port.name, np.zeros(1)) for run in self._runs]
            if any(np.any(row) for row in rows):
                found[port.name] = np.stack([self._over_steps(row) for row in rows])[None]
        for index, point in enumerate(self._points):
            if point.force is not None:
                name, values = point.force
                series = found.get(name, np.zeros((1, 1, 1)))
                if series.shape[0] == 1:
                    series = np.repeat(series, len(self._points), axis=0)
                if series.shape[2] == 1:
                    series = np.repeat(series, self._over_steps(values).size, axis=2)
                series[index] += self._over_steps(values)
                found[name] = series
        return found

    def _over_steps(self, samples: Array) -> Array:
        """Return a force in the middle of each integration step."""
        substeps = self._model.substeps
        middle = (np.arange((self._samples - 1) * substeps) + 0.5) / (substeps * self._parts)
        return np.interp(middle, np.arange(samples.size), samples)

    def _integrate(self) -> Array:
        """Return the states, states x points x runs x samples; memories of effects come last."""
        count = len(self._model.states) + self._memories
        stored = np.zeros((count, *self._shape, self._samples))
        if not count:
            return stored
        first = SimpleNamespace(**{name: self._input_at_samples(name)[..., 0] for name in self._inputs})
        start = self._model.start(SimpleNamespace(**self._parameters), first)
        for index, name in enumerate(self._model.states):
            stored[index, ..., 0] = start[name]
        substeps, widths_s = self._model.substeps, self._widths_s / self._model.substeps
        recorded = self._recorded() if self._samples > 1 else None
        if recorded is not None:
            recorded.integrate(stored, substeps, widths_s)
            if self._is_true(recorded, stored):
                return stored
        state = stored[..., 0].copy()
        for sample in range(1, self._samples):
            for step in range((sample - 1) * substeps, sample * substeps):
                state = self._step(state, step, widths_s[:, sample - 1])
            stored[..., sample] = state
        return stored

    def _recorded(self) -> RecordedLanes | None:
        """Return the equations of all lanes without Python; None where they cannot be recorded."""
        record = _Recording()
        parameters = record.given(self._parameters, Source.PARAMETER)
        active = {
            port: [replace(one, values=record.values(one.values)) for one in some]
            for port, some in self._active.items()
        }
        inputs = record.given(self._inputs, Source.INPUT)
        forces = record.given(self._forces, Source.INPUT)
        count = len(self._model.states) + self._memories
        states = TracedStack([record.graph.given(Source.STATE) for _ in range(count)])
        rates: list[object] = [0.0] * count
        try:
            self._enter_rates(
                states, rates, SimpleNamespace(**inputs), SimpleNamespace(**parameters), (forces, active)
            )
            tape = make_tape(record.graph, [*record.numbers, *states], rates)
        except Exception:  # noqa: BLE001 (equations may raise anything where a number has no value)
            return None
        steps = (self._samples - 1) * self._model.substeps
        series = [*self._inputs.values(), *self._forces.values()]
        return RecordedLanes(tape, self._shape, record.parameters, series, steps)

    def _is_true(self, recorded: RecordedLanes, stored: Array) -> bool:
        """Return True where the recorded rates are those of the equations.

        They are compared at the ends of the runs, between, and where each state is largest.
        """
        last = (self._samples - 1) * self._model.substeps - 1
        size = np.nan_to_num(np.abs(stored)).reshape(stored.shape[0], -1, self._samples).max(axis=1)
        places = {*np.linspace(0, self._samples - 1, CHECKED).astype(int).tolist()}
        places |= set(size.argmax(axis=1).tolist())
        return all(
            are_equal(recorded.rates(states, step), self._rate(states, step))
            for place in sorted(places)
            for states, step in ((stored[..., place], min(place * self._model.substeps, last)),)
        )

    def _step(self, state: Array, step: int, width_s: Array) -> Array:
        first = self._rate(state, step)
        second = self._rate(state + 0.5 * width_s * first, step)
        third = self._rate(state + 0.5 * width_s * second, step)
        fourth = self._rate(state + width_s * third, step)
        after: Array = state + width_s / 6.0 * (first + 2.0 * (second + third) + fourth)
        return after

    def _rate(self, state: Array, step: int) -> Array:
        inputs = SimpleNamespace(**{name: series[..., step] for name, series in self._inputs.items()})
        forces = {name: series[..., step] for name, series in self._forces.items()}
        rates = np.zeros(state.shape)
        self._enter_rates(state, rates, inputs, SimpleNamespace(**self._parameters), (forces, self._active))
        return rates

    def _enter_rates(
        self,
        state: Any,
        rates: Any,
        inputs: SimpleNamespace,
        parameters: SimpleNamespace,
        at_ports: tuple[Mapping[str, Any], Mapping[str, Sequence[Active]]],
    ) -> None:
        """Enter the rate of each state, of numbers or of recorded ones, given forces and effects at ports."""
        names = self._model.states
        machine = SimpleNamespace(**vars(parameters), **vars(inputs), **dict(zip(names, state, strict=False)))
        forces, active = at_ports

        def port(name: str, value: Array) -> Array:
            self._model.require_port(name)
            for one in active.get(name, ()):
                value = _changed(one, value, machine, state, rates)
            return value + forces[name] if name in forces else value

        found = self._model.derivative(machine, inputs, parameters, port)
        for index, name in enumerate(names):
            rates[index] = found[name]

    def _outputs(self, states: Array) -> dict[str, Array]:
        model = self._model
        parameters = SimpleNamespace(**{name: values[..., None] for name, values in self._parameters.items()})
        inputs = SimpleNamespace(**{name: self._input_at_samples(name) for name in model.inputs})
        machine = SimpleNamespace(
            **vars(parameters), **vars(inputs), **dict(zip(model.states, states, strict=False))
        )

        def port(name: str, value: Array) -> Array:
            self._model.require_port(name)
            for one in self._active.get(name, ()):
                if one.change is not None:
                    value = one.change(value, machine, _with_time(one.values), _own(one, states))
            return value + self._sampled_force(name) if name in self._forces else value

        found = model.output(machine, inputs, parameters, port)
        return {
            channel.name: self._read(channel.name, np.asarray(found[channel.name]), states)
            for channel in model.channels
        }

    def _sampled_force(self, name: str) -> Array:
        """Return a force at the samples, from its values in the middle of each integration step."""
        series = self._forces[name]
        before = np.concatenate((series[..., :1], series), axis=2)[..., :: self._model.substeps]
        after = np.concatenate((series, series[..., -1:]), axis=2)[..., :: self._model.substeps]
        middle: Array = 0.5 * (before + after)
        return middle

    def _read(self, name: str, values: Array, states: Array) -> Array:
        """Return a channel as its sensor reports it."""
        active = self._active.get(name, [])
        shape = (*self._shape, self._samples)
        values = np.broadcast_to(values, shape)
        if any(one.effect.action is Action.DELAY for one in active):
            values = delayed(values, self._times_s[:, :-1], _delay_s(active))
        lag = partial(lagged_samples, widths_s=self._widths_s)
        return np.broadcast_to(_signal_effects(active, values, lag, states), shape)


def is_recordable(model: Equations) -> bool:
    """Return True where equations without effects can be recorded, so that they run without Python."""
    record = _Recording()

    def given(names: Iterable[str], source: Source) -> dict[str, Any]:
        return {name: record.graph.given(source) for name in names}

    unknowns = [one.name for one in model.parameters] + [one.name for one in model.run_parameters]
    parameters = given([*unknowns, *model.condition_units], Source.PARAMETER)
    inputs, states = given(model.inputs, Source.INPUT), given(model.states, Source.STATE)
    machine = SimpleNamespace(**parameters, **inputs, **states)
    try:
        found: Mapping[str, object] = model.derivative(
            machine, SimpleNamespace(**inputs), SimpleNamespace(**parameters), lambda _, value: value
        )
        for name in model.states:
            record.graph.node(found[name])
    except Exception:  # noqa: BLE001 (equations may raise anything where a number has no value)
        return False
    return True


class _Recording:
    """Recorded numbers instead of parameters, inputs and forces."""

    def __init__(self) -> None:
        self.graph = Graph()
        self.numbers: list[Traced] = []
        self.parameters: list[Array] = []
        self._known: dict[int, Traced] = {}

    def given(self, values: Mapping[str, Array], source: Source) -> dict[str, Traced]:
        """Return a recorded number for each of the values."""
        found = {name: self.graph.given(source) for name in values}
        self.numbers += found.values()
        if source is Source.PARAMETER:
            self.parameters += values.values()
        return found

    def values(self, values: SimpleNamespace) -> SimpleNamespace:
        """Return recorded numbers for the parameters of an effect; a number under two names is one."""
        new = {str(id(one)): one for one in vars(values).values() if id(one) not in self._known}
        self._known |= {int(key): number for key, number in self.given(new, Source.PARAMETER).items()}
        return SimpleNamespace(**{name: self._known[id(one)] for name, one in vars(values).items()})


def _changed(one: Active, value: Array, machine: SimpleNamespace, state: Any, rates: Any) -> Array:
    """Return a signal inside the equations with an effect; enter the rates of the effect's own states."""
    effect, own = one.effect, _own(one, state)
    if effect.memory_rate is not None and own is not None and one.is_first:
        rates[one.memory] = effect.memory_rate(value, machine, one.values, own)
    return value if one.change is None else one.change(value, machine, one.values, own)


def _delay_s(active: Sequence[Active]) -> Array:
    """Return the sum of the delays at a signal, one per point; one for all without."""
    found = np.zeros(1)
    for one in active:
        if one.effect.action is Action.DELAY:
            found = found + np.maximum(one.values.v0[:, 0], 0.0)
    return found


def _own(one: Active, states: Any) -> Array | None:
    if one.memory is None:
        return None
    own: Array = states[one.memory]
    return own


def _signal_effects(
    active: Sequence[Active], series: Array, lag: Callable[..., Array], states: Array | None = None
) -> Array:
    """Return a series, points x runs x steps or samples, changed by effects other than delays."""
    for one in active:
        first = one.values.v0[:, 0]
        if one.effect.action is Action.LAG:
            series = lag(series, time_constant_s=first)
        elif one.effect.action is Action.PLAY:
            series = played(series, first)
        elif one.change is not None:
            own = None if states is None else _own(one, states)
            series = one.change(series, SimpleNamespace(), _with_time(one.values), own)
    return series


def _with_time(values: SimpleNamespace) -> SimpleNamespace:
    return SimpleNamespace(**{name: value[..., None] for name, value in vars(values).items()})


def _table(times: Sequence[Array], size: int) -> Array:
    """Return the times of runs, continued to one length: runs x times, one row where they agree."""
    longest = max(times, key=len)
    agree = all(np.array_equal(one, longest[: one.size]) for one in times)
    return np.stack([_continued(one, size) for one in ([longest] if agree else times)])


def _continued(times_s: Array, size: int) -> Array:
    step_s = times_s[-1] - times_s[-2] if times_s.size > 1 else 1.0
    return np.append(times_s, times_s[-1] + step_s * np.arange(1, size - times_s.size + 1))


def _refined(values: Array, parts: int) -> Array:
    """Return a series with straight lines in so many parts between its values."""
    fine = np.arange((values.size - 1) * parts + 1) / parts
    return values if parts == 1 else np.interp(fine, np.arange(values.size), values)


def _padded(values: Array, size: int) -> Array:
    series: Array = np.concatenate((values, np.full(size - values.size, values[-1])))
    return series
