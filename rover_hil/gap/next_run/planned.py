"""The runs that could be made next: shapes, amplitudes, start states and durations that are allowed."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.errors import ConfigError
from rover_hil.gap.next_run.allowed import Allowed, InputRange, Range
from rover_hil.gap.next_run.shapes import amplitudes_of, fits, has_period, periods_of, shaped
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array, Machine, Run
from sim_backends.state_model.sample_times import mean_step_s

TIME = "t_s"
ROUNDING = 1e-6
"""Share of a sample by which a duration may miss a whole number of samples."""


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
        samples: Array = self.step_s * np.arange(self.run.count, dtype=np.float64)
        return samples


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kind:
    """Inputs over time, in words, of as many samples; starts and conditions are still to be chosen."""

    like: Run
    words: str
    series: Mapping[str, Array]
    shape: str
    samples: int
    is_repeat: bool = False


def planned_runs(
    machine: Machine,
    runs: Sequence[Run],
    starts: Mapping[str, Mapping[str, float]],
    allowed: Allowed,
    *,
    most: int,
    seed: int = 0,
) -> list[PlannedRun]:
    """Return the runs that could be made next, repetitions of measured ones first.

    Of more than `most`, as many as possible of each shape and of repetitions are drawn. `starts` are the
    fitted run parameters by run.
    """
    groups: dict[tuple[bool, str], list[_Kind]] = {}
    for kind in _kinds(machine, runs, allowed):
        groups.setdefault((not kind.is_repeat, kind.shape), []).append(kind)
    conditions, begins = _Levels(allowed.conditions), _Levels(allowed.starts)
    levels = conditions.count * begins.count
    shares = _shares({name: len(kinds) * levels for name, kinds in groups.items()}, most)
    rng = np.random.default_rng(seed)
    found = []
    for name, kinds in sorted(groups.items(), key=lambda item: item[0][0]):
        for index in _drawn(len(kinds) * levels, shares[name], rng):
            place, level = divmod(index, levels)
            kind = kinds[place]
            condition, begin = divmod(level, begins.count)
            chosen = conditions.at(condition), begins.at(begin)
            found.append(_planned(machine, kind, *chosen, starts.get(kind.like.name, {})))
    return found


def require_durations(machine: Machine, runs: Sequence[Run], allowed: Allowed) -> None:
    """Check that some run can have an allowed duration.

    Raises:
        ConfigError: None can.
    """
    if not allowed.duration_s or any(_has_duration(step_of(machine, run), run, allowed) for run in runs):
        return
    step_s = step_of(machine, runs[0])
    least, most = MACHINES.planned.least_samples, MACHINES.planned.most_samples
    raise ConfigError(
        f"allowed runs: no run with duration_s {min(allowed.duration_s):g} to {max(allowed.duration_s):g} is "
        f"possible; a run has {least} to {most} samples, {least * step_s:g} to {most * step_s:g} s: "
        "change duration_s"
    )


def _has_duration(step_s: float, run: Run, allowed: Allowed) -> bool:
    least, most = _limits_in_samples(allowed, step_s)
    return least <= run.count <= most or bool(_counts(allowed, step_s, 0))


def _kinds(machine: Machine, runs: Sequence[Run], allowed: Allowed) -> Iterator[_Kind]:
    for run in runs:
        if allowed.may_repeat(run):
            for kind in _repeats(machine, run, runs, allowed):
                yield from _of_durations(kind, allowed, step_of(machine, run))
    for carrier in _carriers(machine, runs, allowed):
        yield from _shapes(machine, carrier, allowed)


def _shares(sizes: Mapping[tuple[bool, str], int], most: int) -> dict[tuple[bool, str], int]:
    """Return how many to take of each group: equally many, and what small groups leave for the others."""
    found: dict[tuple[bool, str], int] = {}
    for name, size in sorted(sizes.items(), key=lambda item: item[1]):
        found[name] = min(size, (most - sum(found.values())) // (len(sizes) - len(found)))
    return found


def _drawn(total: int, count: int, rng: np.random.Generator) -> list[int]:
    """Return different numbers below a total, which may have any size."""
    if count >= total:
        return list(range(total))
    chosen: set[int] = set()
    while len(chosen) < count:
        chosen.add(int.from_bytes(rng.bytes(total.bit_length() // 8 + 8)) % total)
    return sorted(chosen)


def step_of(machine: Machine, run: Run) -> float:
    """Return the time between samples of a run, s."""
    return mean_step_s(run, machine.step_s)


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


def _repeats(machine: Machine, run: Run, runs: Sequence[Run], allowed: Allowed) -> Iterator[_Kind]:
    limits = _limits(runs, allowed, list(machine.inputs))
    changed = [name for name, one in limits.items() if "repeat" in one.shapes and np.any(run.inputs[name])]
    times_s = step_of(machine, run) * np.arange(run.count, dtype=np.float64)
    for scale in MACHINES.planned.scales if changed else MACHINES.planned.scales[:1]:
        inputs = {name: (scale if name in changed else 1.0) * run.inputs[name] for name in machine.inputs}
        if not all(fits(one, inputs[name], times_s) for name, one in limits.items()):
            continue
        words = f"repeat run {run.name}"
        if scale != 1.0:
            words += f" with {' and '.join(changed)} times {scale:g}"
        yield _Kind(
            like=run,
            words=words,
            series=inputs,
            shape="repeat",
            samples=run.count,
            is_repeat=scale == 1.0,
        )


def _carriers(machine: Machine, runs: Sequence[Run], allowed: Allowed) -> list[Run]:
    """Return the measured run that gives the inputs which are not chosen: that of median length."""
    if not any(set(one.shapes) - {"repeat"} for one in allowed.inputs.values()):
        return []
    ranked = sorted(runs, key=lambda run: step_of(machine, run) * run.count)
    return [ranked[len(ranked) // 2]]


def _shapes(machine: Machine, carrier: Run, allowed: Allowed) -> Iterator[_Kind]:
    step_s = step_of(machine, carrier)
    for samples in _counts(allowed, step_s, carrier.count):
        times_s = step_s * np.arange(samples, dtype=np.float64)
        options = {
            name: list(_options(name, machine.inputs[name], limits, times_s, step_s))
            for name, limits in allowed.inputs.items()
        }
        others = {name: _lengthened(carrier.inputs[name], samples) for name in machine.inputs}
        plain = _Kind(like=carrier, words="", series=others, shape="", samples=samples)
        duration = f"for {samples * step_s:g} s"
        for name, own in options.items():
            rest = [one for one in machine.inputs if one != name]
            same = f", {' and '.join(rest)} as in {carrier.name}" if rest else ""
            for words, values, shape in own:
                series = {**others, name: values}
                yield replace(plain, words=f"{words} {duration}{same}", series=series, shape=shape)
        # Inputs that move together, each with its own shape of the same number in the list.
        for parts in zip(*options.values(), strict=False) if len(options) > 1 else ():
            words = ", ".join(text for text, _, _ in parts)
            moved = {name: values for name, (_, values, _) in zip(options, parts, strict=True)}
            series = {**others, **moved}
            yield replace(plain, words=f"{words} {duration}", series=series, shape=parts[0][2])


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


def _limits_in_samples(allowed: Allowed, step_s: float) -> tuple[int, int]:
    """Return the least and the greatest number of samples of the allowed durations.

    The longest is never exceeded; a single duration is rounded down to a sample.
    """
    most = math.floor(max(allowed.duration_s) / step_s + ROUNDING)
    if min(allowed.duration_s) == max(allowed.duration_s):
        return most, most
    return math.ceil(min(allowed.duration_s) / step_s - ROUNDING), most


def _counts(allowed: Allowed, step_s: float, measured: int) -> tuple[int, ...]:
    """Return the numbers of samples to plan: the shortest and the longest, or as measured; none may fit."""
    if not allowed.duration_s:
        return (min(measured, MACHINES.planned.most_samples),)
    least, most = _limits_in_samples(allowed, step_s)
    low, high = max(least, MACHINES.planned.least_samples), min(most, MACHINES.planned.most_samples)
    return tuple(dict.fromkeys((low, high))) if low <= high else ()


def _lengthened(values: Array, samples: int) -> Array:
    """Return a series cut, or with its last value held."""
    if values.size >= samples:
        return values[:samples]
    found: Array = np.concatenate((values, np.full(samples - values.size, values[-1])))
    return found


def _planned(
    machine: Machine,
    kind: _Kind,
    conditions: Mapping[str, float],
    starts: Mapping[str, float],
    fitted: Mapping[str, float],
) -> PlannedRun:
    """Return a run with chosen conditions and starts."""
    like = kind.like
    units = {**machine.condition_units, **{one.name: one.unit for one in machine.run_parameters}}
    chosen = {**conditions, **starts}
    places = [f"{name} {value:.3g}{_unit(units[name])}" for name, value in chosen.items()]
    return PlannedRun(
        words=", ".join([kind.words, *places]),
        run=_run(machine, kind, conditions, {**fitted, **starts}),
        starts={
            one.name: starts.get(one.name, fitted.get(one.name, one.nominal_in(like)))
            for one in machine.run_parameters
        },
        like=like.name,
        shape=kind.shape,
        is_repeat=kind.is_repeat,
        step_s=step_of(machine, like),
    )


def _of_durations(kind: _Kind, allowed: Allowed, step_s: float) -> Iterator[_Kind]:
    """Return the inputs of a measured run with each allowed duration."""
    size = kind.samples
    least, most = _limits_in_samples(allowed, step_s) if allowed.duration_s else (size, size)
    if least <= size <= most:
        is_repeat = kind.is_repeat and not allowed.conditions and not allowed.starts
        yield replace(kind, is_repeat=is_repeat)
    elif not kind.series or size > most:
        for samples in _counts(allowed, step_s, size):
            series = {name: _lengthened(values, samples) for name, values in kind.series.items()}
            words = f"{kind.words} for {samples * step_s:g} s"
            yield replace(kind, words=words, series=series, samples=samples, is_repeat=False)


class _Levels:
    """The corners and the middle of ranges, by number; nothing to choose is one choice."""

    def __init__(self, ranges: Mapping[str, Range]) -> None:
        self._ranges = ranges
        self._ends = {name: tuple(dict.fromkeys((one.low, one.high))) for name, one in ranges.items()}
        self._corners = math.prod(len(ends) for ends in self._ends.values())
        self.count = self._corners + (self._corners > 1)

    def at(self, index: int) -> dict[str, float]:
        """Return the values of one choice; the last is the middle."""
        if index == self._corners:
            return {name: 0.5 * (one.low + one.high) for name, one in self._ranges.items()}
        found = {}
        for name, ends in self._ends.items():
            index, place = divmod(index, len(ends))
            found[name] = ends[place]
        return found


def _run(machine: Machine, kind: _Kind, conditions: Mapping[str, float], starts: Mapping[str, float]) -> Run:
    like, series = kind.like, dict(kind.series)
    if machine.step_s is None:
        series[TIME] = step_of(machine, like) * np.arange(kind.samples, dtype=np.float64)
    first = {one.channel: starts.get(one.name) for one in machine.run_parameters if one.channel}
    measured = {}
    for channel in machine.channels:
        if channel.name in like.measured:
            has_value = np.isfinite(np.resize(like.measured[channel.name], kind.samples))
            begin = first.get(channel.name)
            measured[channel.name] = np.where(has_value, 0.0 if begin is None else begin, np.nan)
    chosen = {**like.conditions, **conditions}
    return replace(like, conditions=chosen, inputs=series, measured=measured, overlap=(0, 0), missing={})


def with_names(planned: Sequence[PlannedRun]) -> list[PlannedRun]:
    """Return runs with different names, by which their unknowns are distinguished."""
    width = len(str(len(planned)))
    return [
        replace(one, run=replace(one.run, name=f"next {index:0{width}d}"))
        for index, one in enumerate(planned)
    ]
