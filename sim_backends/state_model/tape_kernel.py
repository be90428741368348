"""Compiled integration of recorded equations: blocks of trials and runs, by fourth-order Runge-Kutta."""

import math

import numpy as np
from numpy.typing import NDArray

from sim_backends.jit import compiled
from sim_backends.models.interface import Array
from sim_backends.state_model.tracing import Op

Rows = NDArray[np.uint32]

BLOCK = 64
"""Lanes whose registers fit the fastest memory of a processor."""
SATURATED = 20.0
"""Argument from which tanh is 1 to the last digit."""

(
    ADD, SUBTRACT, MULTIPLY, DIVIDE, NEGATIVE, ABSOLUTE, MINIMUM, MAXIMUM, WHERE, LESS, LESS_EQUAL, EQUAL,
    NOT_EQUAL, LOGICAL_AND, LOGICAL_OR, LOGICAL_NOT, SIGN, SQRT, EXP, EXPM1, LOG, LOG1P, SIN, COS, TAN, TANH,
    SINH, COSH, ARCSIN, ARCCOS, ARCTAN, ARCTAN2, HYPOT, POWER, FLOOR, CEIL, COPYSIGN, ISFINITE,
) = (int(one) for one in Op)  # fmt: skip


@compiled(error_model="numpy")
def _least(one: float, other: float) -> float:
    # As numpy: what is no number stays.
    return one if one <= other or one != one else other


@compiled(error_model="numpy")
def _chosen(condition: float, one: float, other: float) -> float:
    return one if condition != 0.0 else other


@compiled(error_model="numpy")
def _tanh(value: float) -> float:
    """Return tanh to 1e-14 by operations of vector units: exp(-x / 32) as a series, and six squares."""
    part = -min(abs(value), SATURATED) / 32.0
    high = 1.0 / 120.0 + part * (
        1.0 / 720.0 + part * (1.0 / 5040.0 + part * (1.0 / 40320.0 + part / 362880.0))
    )
    power = 1.0 + part * (1.0 + part * (1.0 / 2.0 + part * (1.0 / 6.0 + part * (1.0 / 24.0 + part * high))))
    power = power * power
    power = power * power
    power = power * power
    power = power * power
    power = power * power
    power = power * power
    size = (1.0 - power) / (1.0 + power)
    found = size if value >= 0.0 else -size
    return found if value == value else value


@compiled(error_model="numpy", is_parallel=True)
def compute(values: Array, tape: Rows, lanes: int) -> None:  # noqa: C901 (one branch for each operation)
    """Do the operations of a tape on registers x lanes."""
    for row in range(tape.shape[0]):
        code, to = tape[row, 0], tape[row, 1]
        a, b, c = tape[row, 2], tape[row, 3], tape[row, 4]
        if code == ADD:
            for lane in range(lanes):
                values[to, lane] = values[a, lane] + values[b, lane]
        elif code == SUBTRACT:
            for lane in range(lanes):
                values[to, lane] = values[a, lane] - values[b, lane]
        elif code == MULTIPLY:
            for lane in range(lanes):
                values[to, lane] = values[a, lane] * values[b, lane]
        elif code == DIVIDE:
            for lane in range(lanes):
                values[to, lane] = values[a, lane] / values[b, lane]
        elif code == NEGATIVE:
            for lane in range(lanes):
                values[to, lane] = -values[a, lane]
        elif code == ABSOLUTE:
            for lane in range(lanes):
                values[to, lane] = abs(values[a, lane])
        elif code == MINIMUM:
            for lane in range(lanes):
                values[to, lane] = _least(values[a, lane], values[b, lane])
        elif code == MAXIMUM:
            for lane in range(lanes):
                values[to, lane] = -_least(-values[a, lane], -values[b, lane])
        elif code == WHERE:
            for lane in range(lanes):
                values[to, lane] = _chosen(values[a, lane], values[b, lane], values[c, lane])
        elif code == LESS:
            for lane in range(lanes):
                values[to, lane] = 1.0 if values[a, lane] < values[b, lane] else 0.0
        elif code == LESS_EQUAL:
            for lane in range(lanes):
                values[to, lane] = 1.0 if values[a, lane] <= values[b, lane] else 0.0
        elif code == EQUAL:
            for lane in range(lanes):
                values[to, lane] = 1.0 if values[a, lane] == values[b, lane] else 0.0
        elif code == NOT_EQUAL:
            for lane in range(lanes):
                values[to, lane] = 1.0 if values[a, lane] != values[b, lane] else 0.0
        elif code == LOGICAL_AND:
            for lane in range(lanes):
                values[to, lane] = values[a, lane] * values[b, lane]
        elif code == LOGICAL_OR:
            for lane in range(lanes):
                values[to, lane] = -_least(-values[a, lane], -values[b, lane])
        elif code == LOGICAL_NOT:
            for lane in range(lanes):
                values[to, lane] = 1.0 - values[a, lane]
        elif code == SIGN:
            for lane in range(lanes):
                values[to, lane] = np.sign(values[a, lane])
        elif code == SQRT:
            for lane in range(lanes):
                values[to, lane] = np.sqrt(values[a, lane])
        elif code == EXP:
            for lane in range(lanes):
                values[to, lane] = np.exp(values[a, lane])
        elif code == EXPM1:
            for lane in range(lanes):
                values[to, lane] = np.expm1(values[a, lane])
        elif code == LOG:
            for lane in range(lanes):
                values[to, lane] = np.log(values[a, lane])
        elif code == LOG1P:
            for lane in range(lanes):
                values[to, lane] = np.log1p(values[a, lane])
        elif code == SIN:
            for lane in range(lanes):
                values[to, lane] = np.sin(values[a, lane])
        elif code == COS:
            for lane in range(lanes):
                values[to, lane] = np.cos(values[a, lane])
        elif code == TAN:
            for lane in range(lanes):
                values[to, lane] = np.tan(values[a, lane])
        elif code == TANH:
            for lane in range(lanes):
                values[to, lane] = _tanh(values[a, lane])
        elif code == SINH:
            for lane in range(lanes):
                values[to, lane] = np.sinh(values[a, lane])
        elif code == COSH:
            for lane in range(lanes):
                values[to, lane] = np.cosh(values[a, lane])
        elif code == ARCSIN:
            for lane in range(lanes):
                values[to, lane] = np.arcsin(values[a, lane])
        elif code == ARCCOS:
            for lane in range(lanes):
                values[to, lane] = np.arccos(values[a, lane])
        elif code == ARCTAN:
            for lane in range(lanes):
                values[to, lane] = np.arctan(values[a, lane])
        elif code == ARCTAN2:
            for lane in range(lanes):
                values[to, lane] = math.atan2(values[a, lane], values[b, lane])
        elif code == HYPOT:
            for lane in range(lanes):
                values[to, lane] = math.hypot(values[a, lane], values[b, lane])
        elif code == POWER:
            for lane in range(lanes):
                values[to, lane] = values[a, lane] ** values[b, lane]
        elif code == FLOOR:
            for lane in range(lanes):
                values[to, lane] = np.floor(values[a, lane])
        elif code == CEIL:
            for lane in range(lanes):
                values[to, lane] = np.ceil(values[a, lane])
        elif code == COPYSIGN:
            for lane in range(lanes):
                values[to, lane] = math.copysign(values[a, lane], values[b, lane])
        elif code == ISFINITE:
            for lane in range(lanes):
                values[to, lane] = 1.0 if math.isfinite(values[a, lane]) else 0.0


@compiled(error_model="numpy")
def _read(inputs: Array, series: Array, sources: NDArray[np.intp], number: int) -> None:
    """Read inputs and forces during an integration step."""
    for index in range(sources.shape[0]):
        for lane in range(sources.shape[1]):
            inputs[index, lane] = series[sources[index, lane], number]


@compiled(error_model="numpy")
def _move(moved: Array, state: Array, slopes: Array, part: int, width_s: Array, lanes: int) -> None:
    """Enter the states at which the rates of a part of the step are found."""
    if part == 0:
        moved[:, :lanes] = state[:, :lanes]
        return
    share = 1.0 if part == 3 else 0.5
    for index in range(state.shape[0]):
        for lane in range(lanes):
            moved[index, lane] = state[index, lane] + share * width_s[lane] * slopes[part - 1, index, lane]


@compiled(error_model="numpy")
def _finish(state: Array, slopes: Array, width_s: Array, lanes: int) -> None:
    """Move the states to the end of the step."""
    for index in range(state.shape[0]):
        for lane in range(lanes):
            middle = 2.0 * (slopes[1, index, lane] + slopes[2, index, lane])
            both = slopes[0, index, lane] + middle + slopes[3, index, lane]
            state[index, lane] += width_s[lane] / 6.0 * both


@compiled(error_model="numpy", is_parallel=True)
def integrate(
    constants: Array,
    once: Rows,
    step: Rows,
    stage: Rows,
    rates: Rows,
    registers: int,
    parameters: Array,
    series: Array,
    sources: NDArray[np.intp],
    stored: Array,
    substeps: int,
    widths_s: Array,
    widths: NDArray[np.intp],
    first_lane: int,
    last_lane: int,
) -> None:
    """Integrate the lanes from the first to before the last; see `Tape` for the equations.

    `parameters` are parameters x lanes; `series` are inputs and forces, rows x steps, and `sources` the row
    of each in each lane; `widths_s` are durations of integration steps, rows x samples, and `widths` the row
    of each lane. `stored` are states x lanes x samples, of which the first sample is given.
    """
    inputs_at = constants.size + parameters.shape[0]
    states_at = inputs_at + sources.shape[0]
    count, samples = stored.shape[0], stored.shape[2]
    values = np.empty((registers, BLOCK))
    slopes = np.empty((4, count, BLOCK))
    state = np.empty((count, BLOCK))
    width_s = np.empty(BLOCK)
    for begin in range(first_lane, last_lane, BLOCK):
        lanes = min(BLOCK, last_lane - begin)
        end = begin + lanes
        for index in range(constants.size):
            values[index, :lanes] = constants[index]
        values[constants.size : inputs_at, :lanes] = parameters[:, begin:end]
        state[:, :lanes] = stored[:, begin:end, 0]
        compute(values, once, lanes)
        for sample in range(1, samples):
            for lane in range(lanes):
                width_s[lane] = widths_s[widths[begin + lane], sample - 1]
            for number in range((sample - 1) * substeps, sample * substeps):
                _read(values[inputs_at:states_at], series, sources[:, begin:end], number)
                compute(values, step, lanes)
                for part in range(4):
                    _move(values[states_at : states_at + count], state, slopes, part, width_s, lanes)
                    compute(values, stage, lanes)
                    for index in range(count):
                        slopes[part, index, :lanes] = values[rates[index], :lanes]
                _finish(state, slopes, width_s, lanes)
            stored[:, begin:end, sample] = state[:, :lanes]
