"""The runs that could be made next: shapes, amplitudes, start states and durations that are allowed."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_hil.gap.machines.next_run.allowed import Allowed, InputRange, Range
from rover_hil.gap.machines.next_run.shapes import (
    amplitudes_of,
    fits,
    has_period,
    periods_of,
    shaped,
)
from sim_backends.models.interface import Array, Machine, Run
from sim_backends.state_model.model import uniform_step_s

TIME = "t_s"
SCALES = (1.0, 0.25, 0.5, 0.75, 1.5, 2.0, 3.0, -1.0, -0.5)
"""Factors on the inputs of a measured run."""
LEAST_SAMPLES = 30
MOST_PLANNED = 200
MOST_SAMPLES = 4000
"""Of a planned run."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedRun:
    """A run that could be made.

    Attributes:
        words: What to do, in words.
        run: Conditions and inputs; of the measured values only the lengths have a meaning, and the first
            where a run parameter starts from it.
        starts: Expected values of the run parameters.
        like: The measured run that it repeats or takes the rest from.
        shape: Shape of the inputs.
        is_repeat: It repeats a measured run without a change.
        step_s: Time between samples.
    """

    words: str
    run: Run
    starts: Mapping[str, float]
    like: str
    shape: str
    is_repeat: bool
    step_s: float

    @property
    def times_s(self) -> Array:
        """Times of its samples."""
        samples: Array = self.step_s * np.arange(_samples(self.run), dtype=np.float64)
        return samples


@dataclass(frozen=True, slots=True)
class _Inputs:
    """Inputs over time, in words."""

    words: str
    series: Mapping[str, Array]
    shape: str
    is_repeat: bool


def planned_runs(
    machine: Machine,
    runs: Sequence[Run],
    starts: Mapping[str, Mapping[str, float]],
    allowed: Allowed,
) -> list[PlannedRun]:
    """Return the runs that could be made next, repetitions of measured ones first.

    Args:
        machine: The model.
        runs: Measured.
        starts: Fitted run parameters by run.
        allowed: What may be done.
    """
    repeated = [run for run in runs if allowed.may_repeat(run)]
    found = [
        one
        for run in repeated
        for inputs in _repeats(machine, run, runs, allowed)
        for one in _varied(machine, run, inputs, starts.get(run.name, {}), allowed)
    ]
    carriers = _carriers(machine, runs, allowed)
    for carrier in carriers:
        for inputs in _shapes(machine, carrier, allowed):
            found += _varied(machine, carrier, inputs, starts.get(carrier.name, {}), allowed)
    found.sort(key=lambda one: not one.is_repeat)
    if len(found) <= MOST_PLANNED:
        return found
    plain = [one for one in found if one.is_repeat][: MOST_PLANNED // 2]
    others = [one for one in found if not one.is_repeat]
    rng = np.random.default_rng(0)
    chosen = np.sort(rng.permutation(len(others))[: MOST_PLANNED - len(plain)])
    return [*plain, *(others[index] for index in chosen)]


def step_of(machine: Machine, run: Run) -> float:
    """Return the time between samples of a run, s."""
    return machine.step_s if machine.step_s is not None else uniform_step_s(run)


def _samples(run: Run) -> int:
    series = [*run.inputs.values(), *run.measured.values()]
    return int(series[0].size)


def _limits(runs: Sequence[Run], allowed: Allowed, names: Sequence[str]) -> dict[str, InputRange]:
    """Return the limits of the inputs that may be changed: declared, or the range of all measured runs."""
    if allowed.inputs:
        return {name: allowed.inputs[name] for name in names if name in allowed.inputs}
    return {
        name: InputRange(
            low=min(float(run.inputs[name].min()) for run in runs),
            high=max(float(run.inputs[name].max()) for run in runs),
            shapes=("repeat",),
        )
        for name in names
    }


def _repeats(machine: Machine, run: Run, runs: Sequence[Run], allowed: Allowed) -> Iterator[_Inputs]:
    limits = _limits(runs, allowed, list(machine.inputs))
    changed = [name for name, one in limits.items() if "repeat" in one.shapes and np.any(run.inputs[name])]
    times_s = step_of(machine, run) * np.arange(_samples(run), dtype=np.float64)
    for scale in SCALES if changed else SCALES[:1]:
        inputs = {name: (scale if name in changed else 1.0) * run.inputs[name] for name in machine.inputs}
        if not all(fits(one, inputs[name], times_s) for name, one in limits.items()):
            continue
        words = f"repeat {run.name}"
        if scale != 1.0:
            words += f" with {' and '.join(changed)} times {scale:g}"
        yield _Inputs(words, inputs, "repeat", scale == 1.0)


def _carriers(machine: Machine, runs: Sequence[Run], allowed: Allowed) -> list[Run]:
    """Return the measured run that gives the inputs which are not chosen: that of median length."""
    if not any(set(one.shapes) - {"repeat"} for one in allowed.inputs.values()):
        return []
    ranked = sorted(runs, key=lambda run: step_of(machine, run) * _samples(run))
    return [ranked[len(ranked) // 2]]


def _shapes(machine: Machine, carrier: Run, allowed: Allowed) -> Iterator[_Inputs]:
    step_s = step_of(machine, carrier)
    durations = _durations(allowed, step_s * _samples(carrier))
    for duration_s in durations:
        samples = _count(duration_s, step_s)
        times_s = step_s * np.arange(samples, dtype=np.float64)
        options = {
            name: list(_options(name, machine.inputs[name], limits, times_s, step_s))
            for name, limits in allowed.inputs.items()
        }
        others = {name: _lengthened(carrier.inputs[name], samples) for name in machine.inputs}
        for name, own in options.items():
            rest = [one for one in machine.inputs if one != name]
            for words, values, shape in own:
                same = f", {' and '.join(rest)} as in {carrier.name}" if rest else ""
                text = f"{words} for {duration_s:.3g} s{same}"
                yield _Inputs(text, {**others, name: values}, shape, False)
        yield from _together(options, others, duration_s)


def _together(
    options: Mapping[str, Sequence[tuple[str, Array, str]]], others: Mapping[str, Array], duration_s: float
) -> Iterator[_Inputs]:
    """Return inputs that move together, each with its own shape of the same number in the list."""
    if len(options) < 2:
        return
    for parts in zip(*options.values(), strict=False):
        words = ", ".join(text for text, _, _ in parts)
        series = {name: values for name, (_, values, _) in zip(options, parts, strict=True)}
        yield _Inputs(f"{words} for {duration_s:.3g} s", {**others, **series}, parts[0][2], False)


def _options(
    name: str, unit: str, limits: InputRange, times_s: Array, step_s: float
) -> Iterator[tuple[str, Array, str]]:
    duration_s = float(times_s[-1]) + step_s
    for shape in limits.shapes:
        if shape == "repeat":
            continue
        periods = periods_of(limits, duration_s, step_s) if has_period(shape) else (0.0,)
        signs = (1.0, -1.0) if shape == "step" else (1.0,)
        for amplitude, period_s, sign in itertools.product(amplitudes_of(limits), periods, signs):
            values = shaped(shape, limits, sign * amplitude, period_s, times_s)
            if values is None:
                continue
            yield _shape_words(name, unit, shape, values, period_s), values, shape


def _shape_words(name: str, unit: str, shape: str, values: Array, period_s: float) -> str:
    if shape in ("step", "ramp"):
        return f"{shape} of {name} from {values[0]:.3g} to {values[-1]:.3g}{_unit(unit)}"
    words = (
        f"{shape.replace('_', '-')} of {name} between {values.min():.3g} and {values.max():.3g}{_unit(unit)}"
    )
    period = "period" if shape in ("sine", "square") else "down to a period of"
    return f"{words}, {period} {period_s:.3g} s"


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _durations(allowed: Allowed, measured_s: float) -> tuple[float, ...]:
    return tuple(dict.fromkeys(sorted(allowed.duration_s))) or (measured_s,)


def _count(duration_s: float, step_s: float) -> int:
    return min(max(round(duration_s / step_s), LEAST_SAMPLES), MOST_SAMPLES)


def _lengthened(values: Array, samples: int) -> Array:
    """Return a series cut, or with its last value held."""
    if values.size >= samples:
        return values[:samples]
    found: Array = np.concatenate((values, np.full(samples - values.size, values[-1])))
    return found


def _varied(
    machine: Machine, like: Run, inputs: _Inputs, fitted: Mapping[str, float], allowed: Allowed
) -> Iterator[PlannedRun]:
    """Return a run with each allowed duration, start and set of conditions."""
    step_s = step_of(machine, like)
    for one in _of_durations(inputs, allowed, step_s, _samples(like)):
        for conditions in _levels(allowed.conditions):
            for starts in _levels(allowed.starts):
                units = {**machine.condition_units, **{p.name: p.unit for p in machine.run_parameters}}
                chosen = {**conditions, **starts}
                places = [f"{name} {value:.3g}{_unit(units[name])}" for name, value in chosen.items()]
                yield PlannedRun(
                    words=", ".join([one[0], *places]),
                    run=_run(
                        machine, like, one[1], {**like.conditions, **conditions}, {**fitted, **starts}, one[2]
                    ),
                    starts=_starts(machine, like, fitted, starts),
                    like=like.name,
                    shape=inputs.shape,
                    is_repeat=inputs.is_repeat and not chosen and one[2] == _samples(like),
                    step_s=step_s,
                )


def _of_durations(
    inputs: _Inputs, allowed: Allowed, step_s: float, measured: int
) -> Iterator[tuple[str, Mapping[str, Array], int]]:
    """Return words, inputs and number of samples of each allowed duration."""
    sizes = [values.size for values in inputs.series.values()]
    size = sizes[0] if sizes else measured
    if inputs.shape != "repeat" or not allowed.duration_s:
        yield inputs.words, inputs.series, size
        return
    low, high = min(allowed.duration_s), max(allowed.duration_s)
    if low <= step_s * size <= high:
        yield inputs.words, inputs.series, size
    elif not inputs.series or step_s * size > high:
        for duration_s in dict.fromkeys((low, high)):
            samples = _count(duration_s, step_s)
            series = {name: _lengthened(values, samples) for name, values in inputs.series.items()}
            yield f"{inputs.words} for {duration_s:.3g} s", series, samples


def _levels(ranges: Mapping[str, Range]) -> list[dict[str, float]]:
    """Return the corners and the middle of ranges; nothing to choose is one choice."""
    if not ranges:
        return [{}]
    ends = [dict.fromkeys((one.low, one.high)) for one in ranges.values()]
    corners = [dict(zip(ranges, values, strict=True)) for values in itertools.product(*ends)]
    middle = {name: 0.5 * (one.low + one.high) for name, one in ranges.items()}
    return corners if middle in corners else [*corners, middle]


def _starts(
    machine: Machine, like: Run, fitted: Mapping[str, float], chosen: Mapping[str, float]
) -> dict[str, float]:
    return {
        one.name: chosen.get(one.name, fitted.get(one.name, one.nominal_in(like)))
        for one in machine.run_parameters
    }


def _run(
    machine: Machine,
    like: Run,
    inputs: Mapping[str, Array],
    conditions: Mapping[str, float],
    starts: Mapping[str, float],
    samples: int,
) -> Run:
    series = dict(inputs)
    if machine.step_s is None:
        series[TIME] = step_of(machine, like) * np.arange(samples, dtype=np.float64)
    first = {one.channel: starts.get(one.name) for one in machine.run_parameters if one.channel}
    measured = {}
    for channel in machine.channels:
        if channel.name not in like.measured:
            continue
        has_value = np.isfinite(np.resize(like.measured[channel.name], samples))
        begin = first.get(channel.name)
        measured[channel.name] = np.where(has_value, 0.0 if begin is None else begin, np.nan)
    return replace(
        like, conditions=dict(conditions), inputs=series, measured=measured, overlap=(0, 0), missing={}
    )


def with_names(planned: Sequence[PlannedRun]) -> list[PlannedRun]:
    """Return runs with different names, by which their unknowns are told apart."""
    width = len(str(math.ceil(len(planned))))
    return [
        replace(one, run=replace(one.run, name=f"next {index:0{width}d}"))
        for index, one in enumerate(planned)
    ]
