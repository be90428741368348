"""Long records cut into runs, and the beginning of records left out of the comparison."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from drivers.errors import ConfigError
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Machine, Model, Run
from sim_backends.state_model.model import StateModel
from sim_backends.state_model.port_effect import Action
from sim_backends.state_model.sample_times import mean_step_s, sample_times_s


def cut_runs(model: Model, runs: Sequence[Run], length_s: float) -> list[Run]:
    """Return records cut into runs of equal length, named `NAME part 1`, ...

    A remainder of at least half of the length is a run of its own; a shorter one stays with the run before
    it. Parts without a compared value are left out. Times in an input `t_s` begin at 0 in every part.
    A delay or a lag remembers the signal before a part: each part but the first begins earlier by the
    longest ones of the model together, at most by its own length, and is not compared there. Shorter
    records stay as they are. Missing values of the record are counted with its first part.

    Raises:
        ConfigError: The model is no machine, cannot begin in the middle of a record, or a part is too short.
    """
    if not isinstance(model, StateModel):
        raise ConfigError("--cut: only a StateModel can begin in the middle of a record; leave out --cut")
    fixed = [name for name, is_free in _free_starts(model).items() if not is_free]
    if fixed:
        raise ConfigError(
            f"--cut: state {fixed[0]} of model {model.name} begins with the same value in every run, "
            "which is wrong in the middle of a record: add a RunParameter for it and use it in start()"
        )
    memory_s = sum(
        card.parameters[0].upper
        for effect, card in zip(model.port_effects, model.effects, strict=True)
        if effect.action in (Action.DELAY, Action.LAG)
    )
    return [part for run in runs for part in parts_of(model, run, length_s, min(memory_s, length_s))]


def without_warm_up(model: Model, runs: Sequence[Run], duration_s: float) -> list[Run]:
    """Return records whose beginning is simulated, but not compared; starts are still read from it.

    Raises:
        ConfigError: The model is no machine, or too little of a record is left.
    """
    if not isinstance(model, Machine):
        raise ConfigError(
            "--warm-up: only records of a StateModel or a unit can be shortened; leave out --warm-up"
        )
    return [_without_beginning(run, _count(model, run, duration_s)) for run in runs]


def _count(model: Machine, run: Run, duration_s: float) -> int:
    return round(duration_s / mean_step_s(run, model.step_s))


def parts_of(model: StateModel, run: Run, length_s: float, memory_s: float = 0.0) -> list[Run]:
    """Return the parts of a run, which begin earlier by what is remembered; see `cut_runs`."""
    size, length = run.count, _count(model, run, length_s)
    if length < DATA.runs.least_samples:
        least_s = DATA.runs.least_samples * mean_step_s(run, model.step_s)
        raise ConfigError(
            f"--cut {length_s:g}: run {run.name} has {length} samples in {length_s:g} s; at least "
            f"{DATA.runs.least_samples} are needed: cut to {least_s:g} s or more"
        )
    count = max(1, math.floor(size / length + 0.5))
    if count == 1:
        return [run]
    edges = [number * length for number in range(count)] + [size]
    memory = _count(model, run, memory_s)
    firsts = [max(edge - memory, 0) for edge in edges[:-1]]
    parts = [
        _uncompared(
            _part(model, run, number, firsts[number], edges[number + 1]), edges[number] - firsts[number]
        )
        for number in range(count)
    ]
    return [part for part in parts if sum(part.overlap) < part.count]


def _part(model: StateModel, run: Run, number: int, first: int, last: int) -> Run:
    inputs = {name: values[first:last] for name, values in run.inputs.items()}
    if "t_s" in inputs:
        times_s = sample_times_s(run, model.step_s)[first:last]
        inputs["t_s"] = times_s - times_s[0]
    size, before, after = last - first, run.overlap[0] - first, run.overlap[1] - (run.count - last)
    return replace(
        run,
        name=f"{run.name} part {number + 1}",
        inputs=inputs,
        measured={name: values[first:last] for name, values in run.measured.items()},
        overlap=(min(max(before, 0), size), min(max(after, 0), size)),
        missing=run.missing if number == 0 else {},
        first=run.first if number == 0 else {},
    )


def _without_beginning(run: Run, count: int) -> Run:
    left = run.count - count
    if left < DATA.runs.least_samples:
        raise ConfigError(
            f"--warm-up: {max(left, 0)} samples of run {run.name} are left; at least "
            f"{DATA.runs.least_samples} are needed: shorten the warm-up"
        )
    return _uncompared(run, count)


def _uncompared(run: Run, count: int) -> Run:
    """Return a run whose first values are not compared; a start may still be read from them."""
    if count == 0:
        return run
    measured, first = {}, dict(run.first)
    for name, values in run.measured.items():
        known = values[:count][np.isfinite(values[:count])]
        if known.size:
            first.setdefault(name, float(known[0]))
        measured[name] = np.where(np.arange(values.size) < count, np.nan, values)
    before, after = run.overlap
    return replace(run, measured=measured, first=first, overlap=(max(before, count), after))


def begins_anywhere(model: StateModel) -> bool:
    """Return True where every state may begin with another value in every run."""
    return all(_free_starts(model).values())


def _free_starts(model: StateModel) -> Mapping[str, bool]:
    """Return for each state whether an unknown of the run or an input changes its first value."""
    inputs = dict.fromkeys(model.inputs, 0.0)
    parameters = {one.name: one.nominal for one in model.parameters}
    parameters |= dict.fromkeys(model.condition_units, 0.0)
    parameters |= {
        one.name: float(np.clip(one.nominal, one.lower, one.upper)) for one in model.run_parameters
    }
    moved = [
        (parameters | {one.name: parameters[one.name] + sign * one.prior_sd}, inputs)
        for one in model.run_parameters
        for sign in (1.0, -1.0)
    ]
    moved += [(parameters, inputs | {name: 1.0}) for name in model.inputs]
    before = _start(model, parameters, inputs)
    after = [_start(model, *one) for one in moved]
    return {name: any(one[name] != before[name] for one in after) for name in model.states}


def _start(
    model: StateModel, parameters: Mapping[str, float], inputs: Mapping[str, float]
) -> dict[str, float]:
    columns = SimpleNamespace(**{name: np.full((1, 1), value) for name, value in parameters.items()})
    first = SimpleNamespace(**{name: np.full((1, 1), value) for name, value in inputs.items()})
    with np.errstate(all="ignore"):
        found = model.start(columns, first)
    return {name: float(np.asarray(found[name], dtype=np.float64).reshape(-1)[0]) for name in model.states}
