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


FAMILY = Family(
    name="circuit",
    dt_s=2e-4,
    parameters=(
        Parameter(name="inductance_h", nominal=0.1, spread=0.04, scatter=0.0005, meaning="L, coil"),
        Parameter(name="resistance_ohm", nominal=30.0, spread=0.05, scatter=0.004, meaning="R, in all"),
        Parameter(name="capacitance_f", nominal=1e-5, spread=0.04, scatter=0.0005, meaning="C, capacitor"),
        Parameter(
            name="amplifier_gain", nominal=1.0, spread=0.02, scatter=0.001, meaning="k, voltage per command"
        ),
    ),
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
    catalogue=(
        Effect(
            name="contact_drop",
            group="contact",
            formula="L di/dt gets -drop_v sgn(i) (a pair of diodes in series, dry friction of the current); "
            "at i = 0 it holds the current at zero while |k U - v| <= drop_v",
            size={"drop_v": (0.0, 3.0)},
            drawn={},
        ),
        Effect(
            name="dead_zone",
            group="crossover",
            formula="U becomes sgn(U) max(|U| - dead_zone_v, 0)",
            size={"dead_zone_v": (0.0, 3.0)},
            drawn={},
        ),
        Effect(
            name="saturation",
            group="limit",
            formula="U becomes max(-limit_v, min(U, limit_v))",
            size={"limit_v": (10.0, 2.0)},
            drawn={},
        ),
        Effect(
            name="supply_sag",
            group="sag",
            formula="U becomes U (1 - sag_per_v |U|)",
            size={"sag_per_v": (0.0, 0.04)},
            drawn={},
        ),
        Effect(
            name="input_delay",
            group="late",
            formula="U(t) becomes U(t - delay_s); before the start U had its first value",
            size={"delay_s": (0.0, 6e-4)},
            drawn={},
        ),
        Effect(
            name="actuator_lag",
            group="late",
            formula="U becomes y with dy/dt = (U - y)/lag_s; y begins at the first U",
            size={"lag_s": (0.0, 1e-3)},
            drawn={},
        ),
        Effect(
            name="sensor_offset",
            group="sensor_1",
            formula="measured_current_a is i + offset_a; the conditions give i",
            size={"offset_a": (0.0, 0.04)},
            drawn={},
            signed=True,
        ),
    ),
    outside=(
        Term(
            name="hot_resistor",
            equation="current_a",
            variables=("current_a",),
            shape="cube",
            sign=-1,
            formula="L di/dt gets -cubic_ohm_a2 i^3",
            coefficient="cubic_ohm_a2",
            largest=3e3,
            drawn={},
        ),
        Term(
            name="varactor",
            equation="current_a",
            variables=("capacitor_v",),
            shape="cube",
            sign=-1,
            formula="L di/dt gets -varactor_per_v2 v^3",
            coefficient="varactor_per_v2",
            largest=3e-3,
            drawn={},
        ),
        Term(
            name="core_loss",
            equation="current_a",
            variables=("current_a",),
            shape="signed_square",
            sign=-1,
            formula="L di/dt gets -core_ohm_a i |i|",
            coefficient="core_ohm_a",
            largest=300.0,
            drawn={},
        ),
        Term(
            name="clamp",
            equation="capacitor_v",
            variables=("capacitor_v",),
            shape="threshold",
            sign=-1,
            formula="C dv/dt gets -clamp_a_v sgn(v) max(|v| - clamp_start_v, 0)",
            coefficient="clamp_a_v",
            largest=0.05,
            drawn={"clamp_start_v": (3.0, 6.0)},
        ),
    ),
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
