"""A coil, a resistor and a capacitor in series on an amplifier; current and capacitor voltage are measured.

L di/dt = k U - R i - v        C dv/dt = i
"""

import math

import numpy as np
from numba import njit

from tests.nature.machines.case import Channel, Effect, InputSignal, Parameter, State, Term
from tests.nature.machines.family import Array, Disturbance, Family, Plan, Signals, Values
from tests.nature.machines.friction import FREE, STUCK, contact_guard, contact_mode, dry_force
from tests.nature.machines.integrator import GUARD, SLOPE, START, SWITCH
from tests.nature.machines.signals import (
    chirp,
    multi_sine,
    steps,
    triangle,
    with_dead_zone,
    with_limit,
    with_sag,
)  # fmt: skip

CONSTANTS = (
    "inductance_h", "resistance_ohm", "capacitance_f", "amplifier_gain",
    "drop_v", "lag_s", "cubic_ohm_a2", "varactor_per_v2", "core_ohm_a", "clamp_a_v", "clamp_start_v",
    "dead_zone_v", "limit_v", "sag_per_v", "delay_s", "offset_a",
)  # fmt: skip
(
    INDUCTANCE, RESISTANCE, CAPACITANCE, GAIN, DROP, LAG, CUBIC, VARACTOR, CORE, CLAMP, CLAMP_START,
) = range(11)  # fmt: skip


@njit("float64(float64[::1], float64[::1], float64, float64[::1])", cache=True)
def _push(state: Array, held: Array, force: float, constants: Array) -> float:
    """Return the voltage over coil and contact."""
    current, charged = state[0], state[1]
    drive = state[2] if constants[LAG] > 0.0 else held[0]
    push = constants[GAIN] * drive + force - constants[RESISTANCE] * current - charged
    push -= constants[CUBIC] * current**3 + constants[CORE] * current * abs(current)
    return float(push - constants[VARACTOR] * charged**3)


@njit(SLOPE, cache=True)
def _slope(state: Array, held: Array, force: float, constants: Array, mode: int, out: Array) -> None:
    drop = constants[DROP]
    out[0] = 0.0
    if mode != STUCK:
        contact = dry_force(mode, state[0], drop, drop, 0.0, 1.0)
        out[0] = (_push(state, held, force, constants) + contact) / constants[INDUCTANCE]
    over = math.copysign(max(abs(state[1]) - constants[CLAMP_START], 0.0), state[1])
    out[1] = (state[0] - constants[CLAMP] * over) / constants[CAPACITANCE]
    out[2] = 0.0
    if constants[LAG] > 0.0:
        out[2] = (held[0] - state[2]) / constants[LAG]


@njit(GUARD, cache=True)
def _guard(state: Array, held: Array, force: float, constants: Array, mode: int) -> float:
    if mode == FREE:
        return 1.0
    drop = constants[DROP]
    return float(contact_guard(mode, state[0], _push(state, held, force, constants), drop, drop))


@njit(SWITCH, cache=True)
def _switch(state: Array, held: Array, force: float, constants: Array, mode: int) -> int:
    if mode not in (START, STUCK):
        state[0] = 0.0
    drop = constants[DROP]
    return int(contact_mode(state[0], _push(state, held, force, constants), drop, drop))


def _begin(start: Values, constants: Values, actuated: Signals) -> tuple[float, ...]:
    return (start["current_a"], start["capacitor_v"], float(actuated["voltage_v"][0]))


def _actuate(inputs: Signals, constants: Values) -> tuple[dict[str, Array], tuple[float, ...]]:
    voltage = with_limit(with_dead_zone(inputs["voltage_v"], constants["dead_zone_v"]), constants["limit_v"])
    return {"voltage_v": with_sag(voltage, constants["sag_per_v"])}, (constants["delay_s"],)


def _observe(states: Signals, constants: Values) -> dict[str, Array]:
    return {
        "measured_current_a": states["current_a"] + constants["offset_a"],
        "measured_capacitor_v": states["capacitor_v"].copy(),
    }


def _plan(rng: np.random.Generator, samples: int, index: int) -> Plan:
    kind = ("steps", "chirp", "release", "triangle", "multi_sine")[index % 5]
    charged = 0.0
    voltage = np.zeros(samples)
    if kind == "release":
        charged = float(rng.choice((-1.0, 1.0)) * rng.uniform(5.0, 15.0))
    else:
        shape = {
            "steps": lambda: steps(rng, samples, (15, 50)),
            "chirp": lambda: chirp(rng, samples, (0.005, 0.07)),
            "triangle": lambda: triangle(rng, samples, (30, 80)),
            "multi_sine": lambda: multi_sine(rng, samples, (0.005, 0.08)),
        }[kind]()
        voltage = float(rng.uniform(3.0, 10.0)) * shape
    return Plan(
        name=f"{kind}_{index}",
        conditions={"start_current_a": 0.0, "start_capacitor_v": charged},
        inputs={"voltage_v": voltage},
    )


PARAMETERS = (
    # Nominal value, spread, scatter from run to run, meaning.
    Parameter("inductance_h", 0.1, 0.04, 0.0005, "L, coil"),
    Parameter("resistance_ohm", 30.0, 0.05, 0.004, "R, in all"),
    Parameter("capacitance_f", 1e-5, 0.04, 0.0005, "C, capacitor"),
    Parameter("amplifier_gain", 1.0, 0.02, 0.001, "k, voltage per command"),
)  # fmt: skip
CATALOGUE = (
    # Group, formula, size without and largest; what else is drawn.
    Effect("contact_drop", "contact",
        "L di/dt gets -drop_v sgn(i) (a pair of diodes in series, dry friction of the current); at i = 0 "
        "it holds the current at zero while |k U - v| <= drop_v", {"drop_v": (0.0, 3.0)}),
    Effect("dead_zone", "crossover", "U becomes sgn(U) max(|U| - dead_zone_v, 0)",
        {"dead_zone_v": (0.0, 3.0)}),
    Effect("saturation", "limit", "U becomes max(-limit_v, min(U, limit_v))", {"limit_v": (10.0, 2.0)}),
    Effect("supply_sag", "sag", "U becomes U (1 - sag_per_v |U|)", {"sag_per_v": (0.0, 0.04)}),
    Effect("input_delay", "late", "U(t) becomes U(t - delay_s); before the start U had its first value",
        {"delay_s": (0.0, 6e-4)}),
    Effect("actuator_lag", "late", "U becomes y with dy/dt = (U - y)/lag_s; y begins at the first U",
        {"lag_s": (0.0, 1e-3)}),
    Effect("sensor_offset", "sensor_1", "measured_current_a is i + offset_a; the conditions give i",
        {"offset_a": (0.0, 0.04)}, signed=True),
)  # fmt: skip
OUTSIDE = (
    # Equation, variables, shape, formula, coefficient, its largest value; what else is drawn.
    Term("hot_resistor", "current_a", ("current_a",), "cube", "L di/dt gets -cubic_ohm_a2 i^3",
        "cubic_ohm_a2", 3e3),
    Term("varactor", "current_a", ("capacitor_v",), "cube", "L di/dt gets -varactor_per_v2 v^3",
        "varactor_per_v2", 3e-3),
    Term("core_loss", "current_a", ("current_a",), "signed_square", "L di/dt gets -core_ohm_a i |i|",
        "core_ohm_a", 300.0),
    Term("clamp", "capacitor_v", ("capacitor_v",), "threshold",
        "C dv/dt gets -clamp_a_v sgn(v) max(|v| - clamp_start_v, 0)", "clamp_a_v", 0.05,
        {"clamp_start_v": (3.0, 6.0)}),
)  # fmt: skip

FAMILY = Family(
    name="circuit",
    dt_s=2e-4,
    parameters=PARAMETERS,
    states=(
        State(name="current_a", spread=0.0, scale=0.1),
        State(name="capacitor_v", spread=0.05, scale=5.0),
    ),
    extra_states=(("lagged_v", 1.0),),
    channels=(
        Channel(name="measured_current_a", sigma=0.001, quantum=0.0005),
        Channel(name="measured_capacitor_v", sigma=0.05, quantum=0.02),
    ),
    inputs=(InputSignal(name="voltage_v", low=-10.0, high=10.0),),
    catalogue=CATALOGUE,
    outside=OUTSIDE,
    disturbance=Disturbance(equation="current_a", unit="V", largest_rms=5.0, correlation_s=0.003),
    constants=CONSTANTS,
    slope=_slope,
    guard=_guard,
    switch=_switch,
    begin=_begin,
    actuate=_actuate,
    observe=_observe,
    plan=_plan,
)
