"""Integration of a machine with modes: adaptive steps of order 5, and each change of mode located in time."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, types
from numpy.typing import NDArray

Array = NDArray[np.float64]
Compiled = Callable[..., Any]

START = -99
"""Mode before the first one is chosen."""
TOLERANCE = 1e-10
EVENT_SHARE = 1e-9
"""Precision of the time of a change of mode, as a share of the sample time."""
MOST_SWITCHES = 2000

_VECTOR = types.float64[::1]
SLOPE = types.void(_VECTOR, _VECTOR, types.float64, _VECTOR, types.int64, _VECTOR)
"""(state, input, disturbance, constants, mode, slope of the state to fill in)."""
GUARD = types.float64(_VECTOR, _VECTOR, types.float64, _VECTOR, types.int64)
"""Return a number that is negative once the mode does not hold any more."""
SWITCH = types.int64(_VECTOR, _VECTOR, types.float64, _VECTOR, types.int64)
"""Return the mode that follows; may change the state (impact)."""

# Dormand and Prince 5(4).
_NODES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
_STAGES = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_ERROR = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


@njit(
    types.float64(
        types.FunctionType(SLOPE), _VECTOR, _VECTOR, types.float64, types.float64, _VECTOR, types.int64,
        types.float64, _VECTOR, types.float64, types.float64[:, ::1], _VECTOR,
    ),
    cache=True,
)  # fmt: skip
def _step(
    slope: Compiled, state: Array, held: Array, force: float, force_rate: float, constants: Array, mode: int,
    h: float, scale: Array, tolerance: float, stages: Array, after: Array,
) -> float:  # fmt: skip
    """Fill in the state after `h`; return the error as a share of what is allowed."""
    for stage in range(7):
        for i in range(state.size):
            total = 0.0
            for j in range(stage):
                total += _STAGES[stage, j] * stages[j, i]
            after[i] = state[i] + h * total
        slope(after, held, force + force_rate * h * _NODES[stage], constants, mode, stages[stage])
    worst = 0.0
    for i in range(state.size):
        error = 0.0
        for stage in range(7):
            error += _ERROR[stage] * stages[stage, i]
        allowed = tolerance * (scale[i] + max(abs(state[i]), abs(after[i])))
        worst = max(worst, abs(h * error) / allowed)
    return worst


@njit(
    types.int64(
        types.FunctionType(SLOPE), types.FunctionType(GUARD), types.FunctionType(SWITCH), _VECTOR, _VECTOR,
        types.float64, types.float64, _VECTOR, types.int64, types.float64, types.float64, _VECTOR,
        types.float64, types.float64[:, ::1], _VECTOR,
    ),
    cache=True,
)  # fmt: skip
def _advance(
    slope: Compiled, guard: Compiled, switch: Compiled, state: Array, held: Array, force: float,
    force_rate: float, constants: Array, mode: int, duration: float, shortest: float, scale: Array,
    tolerance: float, stages: Array, after: Array,
) -> int:  # fmt: skip
    """Advance the state by `duration` with held inputs; return the mode then."""
    now = 0.0
    h = duration
    switches = 0
    while duration - now > shortest:
        while guard(state, held, force + force_rate * now, constants, mode) < 0.0:
            mode = switch(state, held, force + force_rate * now, constants, mode)
            switches += 1
            if switches > MOST_SWITCHES:
                raise ValueError("the mode of the machine changes without end")
        h = min(h, duration - now)
        here = force + force_rate * now
        error = _step(
            slope, state, held, here, force_rate, constants, mode, h, scale, tolerance, stages, after
        )
        if error > 1.0 and h > shortest:
            h *= max(0.2, 0.9 * error**-0.2)
            continue
        used = h
        if guard(after, held, here + force_rate * h, constants, mode) < 0.0:
            early, used = 0.0, h
            while used - early > shortest:
                middle = 0.5 * (early + used)
                _step(
                    slope,
                    state,
                    held,
                    here,
                    force_rate,
                    constants,
                    mode,
                    middle,
                    scale,
                    tolerance,
                    stages,
                    after,
                )
                if guard(after, held, here + force_rate * middle, constants, mode) < 0.0:
                    used = middle
                else:
                    early = middle
            _step(
                slope, state, held, here, force_rate, constants, mode, used, scale, tolerance, stages, after
            )
            h = duration - now
        else:
            h *= min(4.0, 0.9 * max(error, 1e-6) ** -0.2)
        state[:] = after
        now += used
    return mode


@njit(
    types.float64[:, ::1](
        types.FunctionType(SLOPE), types.FunctionType(GUARD), types.FunctionType(SWITCH), _VECTOR,
        types.float64[:, ::1], _VECTOR, _VECTOR, _VECTOR, types.float64, _VECTOR, types.float64,
    ),
    cache=True,
)  # fmt: skip
def simulate(
    slope: Compiled, guard: Compiled, switch: Compiled, start: Array, inputs: Array, disturbance: Array,
    delays_s: Array, constants: Array, dt_s: float, scale: Array, tolerance: float,
) -> Array:  # fmt: skip
    """Return the state at each sample, and its mode in the last column.

    Args:
        slope: See `SLOPE`.
        guard: See `GUARD`.
        switch: See `SWITCH`.
        start: State at the first sample.
        inputs: Inputs by samples; each value is held until the next sample.
        disturbance: At each sample; linear in between.
        delays_s: By which each input comes late; before that it has its first value.
        constants: Of the machine.
        dt_s: Sample time.
        scale: Typical size of each state.
        tolerance: Error allowed in a step, as a share of `scale` and state together.
    """
    count, samples = inputs.shape
    state = start.copy()
    after = np.zeros(state.size)
    stages = np.zeros((7, state.size))
    held = inputs[:, 0].copy()
    seen = np.zeros((samples, state.size + 1))
    mode = switch(state, held, disturbance[0], constants, START)
    whole = np.floor(delays_s / dt_s)
    part = delays_s - whole * dt_s
    for index in range(samples):
        seen[index, : state.size] = state
        seen[index, state.size] = mode
        if index == samples - 1:
            break
        rate = (disturbance[index + 1] - disturbance[index]) / dt_s
        now = 0.0
        while now < dt_s - EVENT_SHARE * dt_s:
            until = dt_s
            for i in range(count):
                late = now < part[i] - EVENT_SHARE * dt_s
                held[i] = inputs[i, max(0, index - int(whole[i]) - (1 if late else 0))]
                if late:
                    until = min(until, part[i])
            mode = _advance(
                slope, guard, switch, state, held, disturbance[index] + rate * now, rate, constants, mode,
                until - now, EVENT_SHARE * dt_s, scale, tolerance, stages, after,
            )  # fmt: skip
            now = until
    return seen


@njit(GUARD, cache=True)
def one_mode_guard(state: Array, held: Array, force: float, constants: Array, mode: int) -> float:
    """Return 1: a machine without modes never leaves its only one."""
    return 1.0


@njit(SWITCH, cache=True)
def one_mode_switch(state: Array, held: Array, force: float, constants: Array, mode: int) -> int:
    """Return 0, the only mode."""
    return 0
