"""A machine tried out before its runs are compared: every mistake in its equations becomes one sentence."""

import math
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, SimpleNamespace

import numpy as np

from drivers.clock import Clock, SystemClock, seconds
from drivers.errors import ConfigError, RoverHilError
from rover_hil.gap.parameters import MACHINES
from sim_backends.fmu.model import UnitModel
from sim_backends.models.interface import Array, Channel, Machine, Run
from sim_backends.state_model.model import StateModel

POINTS, RUNS, SAMPLES = 2, 3, 5
"""Numbers of the trial, all different, so that axes cannot be mistaken."""
MINUTE_S = 60.0
"""Seconds of a minute."""


def try_model(model: Machine, runs: Sequence[Run], clock: Clock | None = None) -> list[str]:
    """Check the equations of a machine, where they are known, and simulate its runs twice.

    Returns:
        Sentences about long computations.

    Raises:
        ConfigError: An equation raises, returns the wrong names, shapes or NaN, is not deterministic, or uses
            ports that are not declared, or leaves a declared one out.
    """
    if isinstance(model, StateModel):
        _try_equations(model, runs)
    clock = clock or SystemClock()
    with _located(model):
        first = model.predict(runs, {}, {})
        start_ns = clock.now_ns()
        second = model.predict(runs, {}, {})
        duration_s = seconds(clock.now_ns() - start_ns)
        alone = model.predict(runs[:1], {}, {})
    _require_numbers(model, runs, first)
    _require_equal(model, runs, first, second, "is not deterministic: two predictions differ")
    _require_equal(
        model,
        runs[:1],
        first[:1],
        alone,
        "mixes runs: a run alone is predicted differently than among others",
    )
    if isinstance(model, UnitModel):
        return [_duration_of_unit(model, len(runs), duration_s)]
    return _warnings(len(runs), duration_s)


def _duration_of_unit(model: UnitModel, count: int, duration_s: float) -> str:
    unknowns = len(model.parameters) + len(model.run_parameters)
    simulations = MACHINES.trial.simulations * (unknowns + 1) * (len(model.effects) + 1)
    return (
        f"one simulation of all {count} runs takes {duration_s:.2g} s; an analysis needs about "
        f"{simulations}: about {_in_words(simulations * duration_s)} in all"
    )


def _warnings(count: int, duration_s: float) -> list[str]:
    if duration_s <= MACHINES.trial.long_s:
        return []
    total_s = MACHINES.trial.integrations * duration_s
    return [
        f"one integration of all {count} runs takes {duration_s:.1f} s; an analysis needs about "
        f"{MACHINES.trial.integrations}: about {_in_words(total_s)} in all, more where the steps must be "
        "halved. Fewer samples, or numpy functions instead of loops, are faster"
    ]


def _in_words(duration_s: float) -> str:
    if duration_s >= 2.0 * MINUTE_S:
        return f"{duration_s / MINUTE_S:.0f} min"
    return f"{duration_s:.0f} s"


def _try_equations(model: StateModel, runs: Sequence[Run]) -> None:
    called: set[str] = set()
    some = [runs[index % len(runs)] for index in range(RUNS)]
    parameters = _parameters(model, some)
    # As the integration passes it on: one number per run, for all trials.
    first = SimpleNamespace(
        **{name: np.array([[run.inputs[name][0] for run in some]]) for name in model.inputs}
    )
    begun = _call(model.start, "start", parameters, first)
    states = _checked(model, "start", begun, model.states, (POINTS, RUNS))
    machine = SimpleNamespace(**vars(parameters), **vars(first), **states)
    rates = _call(
        model.derivative, "derivative", machine, first, parameters, _port(model, "derivative", called)
    )
    _checked(model, "derivative", rates, model.states, (POINTS, RUNS))
    series, constants = _over_time({**vars(first), **states}, SAMPLES), _over_time(vars(parameters), 1)
    inputs = SimpleNamespace(**{name: series[name] for name in model.inputs})
    machine = SimpleNamespace(**constants, **series)
    read = _call(
        model.output, "output", machine, inputs, SimpleNamespace(**constants), _port(model, "output", called)
    )
    names = [channel.name for channel in model.channels]
    _checked(model, "output", read, names, (POINTS, RUNS, SAMPLES))
    unused = [one.name for one in model.ports if one.name not in called]
    if unused:
        raise ConfigError(
            f"{_place(model.derivative)}port {unused[0]} of model {model.name} is declared, but "
            f'port("{unused[0]}", ...) is called neither in derivative nor in output: effects there would '
            "change nothing"
        )


def _parameters(model: StateModel, runs: Sequence[Run]) -> SimpleNamespace:
    values = {one.name: np.full((POINTS, 1), one.nominal) for one in model.parameters}
    for one in model.run_parameters:
        values[one.name] = np.array([[one.nominal_in(run) for run in runs]] * POINTS)
    values |= {name: np.array([[run.conditions[name] for run in runs]]) for name in model.condition_units}
    return SimpleNamespace(**values)


def _over_time(values: Mapping[str, Array], samples: int) -> dict[str, Array]:
    """Return the same with an axis of samples."""
    return {name: np.repeat(value[..., None], samples, axis=2) for name, value in values.items()}


def _port(model: StateModel, role: str, called: set[str]) -> Callable[[str, Array], Array]:
    declared = [one.name for one in model.ports]
    own = {**dict.fromkeys(model.inputs, "input"), **{one.name: "channel" for one in model.channels}}

    def port(name: str, value: Array) -> Array:
        if name in own and name not in declared:
            raise ConfigError(
                f'{_place(_function(model, role))}{role} calls port("{name}", ...), but {name} is an '
                f"{own[name]}, where effects act without a call: use the value itself".replace(
                    "an channel", "a channel"
                )
            )
        if name not in declared:
            raise ConfigError(
                f'{_place(_function(model, role))}{role} calls port("{name}", ...), which is not declared: '
                f'add Port(name="{name}", ...) to the ports of model {model.name}'
            )
        called.add(name)
        return value

    return port


def _function(model: StateModel, role: str) -> Callable[..., object]:
    function: Callable[..., object] = getattr(model, role)
    return function


def _call(function: Callable[..., object], role: str, *arguments: object) -> object:
    try:
        with np.errstate(all="ignore"):
            return function(*arguments)
    except RoverHilError:
        raise
    except Exception as error:
        raise ConfigError(
            f"{_place(function, error)}{role} raises {_words(error)}; its arguments are arrays of one number "
            "per trial and run: correct the model"
        ) from error


def _words(error: Exception) -> str:
    text = " ".join(str(error).split())
    if isinstance(error, AttributeError) and isinstance(error.obj, SimpleNamespace):
        text = f"there is no '{error.name}'; there are {', '.join(vars(error.obj))}"
    return f"{type(error).__name__}: {text}"


@contextmanager
def _located(model: Machine) -> Iterator[None]:
    """Name the equation that an exception comes from.

    Raises:
        ConfigError: Raised instead of such an exception.
    """
    try:
        yield
    except RoverHilError:
        raise
    except Exception as error:
        if not isinstance(model, StateModel):
            raise
        codes = {frame.f_code for frame, _ in traceback.walk_tb(error.__traceback__)}
        for role in ("derivative", "output", "start"):
            function = _function(model, role)
            if _code(function) in codes:
                raise ConfigError(
                    f"{_place(function, error)}{role} raises {_words(error)}; correct the model"
                ) from error
        raise


def _code(function: Callable[..., object]) -> CodeType | None:
    return getattr(function, "__code__", None)


def _place(function: Callable[..., object], error: Exception | None = None) -> str:
    """Return file and line of a function, or of the error in its file, as the beginning of a sentence."""
    code = _code(function)
    if code is None:
        return ""
    frames = traceback.extract_tb(error.__traceback__) if error is not None else []
    lines = [frame.lineno for frame in frames if frame.filename == code.co_filename]
    return f"{Path(code.co_filename)}, line {lines[-1] if lines else code.co_firstlineno}: "


def _checked(
    model: StateModel,
    role: str,
    found: object,
    names: Mapping[str, str] | Sequence[str],
    shape: tuple[int, ...],
) -> dict[str, Array]:
    """Return what an equation returned, in full shape.

    Raises:
        ConfigError: It is no table, lacks a name, or holds a wrong shape.
    """
    place, what = _place(_function(model, role)), "channel" if role == "output" else "state"
    if not isinstance(found, Mapping):
        raise ConfigError(
            f"{place}{role} returns {type(found).__name__}: return a dict with a value for each {what}, "
            f"{', '.join(names)}"
        )
    missing = [name for name in names if name not in found]
    if missing:
        raise ConfigError(
            f"{place}{role} returns nothing for {what} {missing[0]} of model {model.name}; it returns "
            f"{', '.join(str(name) for name in found) or 'an empty dict'}"
        )
    return {name: _in_shape(f"{place}{role}", what, name, found[name], shape) for name in names}


def _in_shape(who: str, what: str, name: str, value: object, shape: tuple[int, ...]) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{who} returns no numbers for {what} {name}: {type(value).__name__}") from error
    try:
        return np.array(np.broadcast_to(array, shape))
    except ValueError as error:
        raise ConfigError(
            f"{who} returns the wrong shape for {what} {name}: {array.shape} where the arguments have "
            f"{shape}; use numpy functions that act on each number"
        ) from error


def _require_numbers(model: Machine, runs: Sequence[Run], tables: Sequence[Mapping[str, Array]]) -> None:
    for run, table in zip(runs, tables, strict=True):
        for channel in model.channels:
            bad = np.flatnonzero(~np.isfinite(table[channel.name]))
            if bad.size:
                raise ConfigError(
                    f"{_place_of(model)}model {model.name} predicts no number for {channel.name} in "
                    f"run {run.name} from sample {bad[0] + 1} of {table[channel.name].size} on, at nominal "
                    f"parameters: {_reason(model, run)}"
                )


def _reason(model: Machine, run: Run) -> str:
    if isinstance(model, UnitModel):
        return model.failure(run)
    return "look for a division by zero, a root of a negative number, or a motion that grows without limit"


def _place_of(model: Machine) -> str:
    return _place(model.derivative) if isinstance(model, StateModel) else ""


def _require_equal(
    model: Machine,
    runs: Sequence[Run],
    first: Sequence[Mapping[str, Array]],
    second: Sequence[Mapping[str, Array]],
    what: str,
) -> None:
    for run, one, other in zip(runs, first, second, strict=True):
        for channel in model.channels:
            difference = float(np.max(np.abs(one[channel.name] - other[channel.name]), initial=0.0))
            if not difference <= _same(channel, one[channel.name]):
                raise ConfigError(
                    f"{_place_of(model)}model {model.name} {what} by {difference:.3g} "
                    f"{channel.unit} in {channel.name}, run {run.name}: {_remedy(model)}"
                )


def _remedy(model: Machine) -> str:
    if isinstance(model, UnitModel):
        return "reset = false in its file makes a new instance for each run"
    return "use no random numbers, no memory between calls, and no sums over the arguments"


def _same(channel: Channel, values: Array) -> float:
    scale = float(np.max(np.abs(values), initial=0.0))
    return max(min(MACHINES.trial.same_share * (channel.noise_sd or math.inf), 1e-6 * scale), 1e-12)
