"""Two coupled tanks, filled by a pump, drained by an outlet; both levels are measured.

A1 dh1/dt = p u - a s(h1 - h2)        A2 dh2/dt = a s(h1 - h2) - o s(h2)
"""

import math

import numpy as np
from numba import njit

from tests.nature.machines.case import Channel, Effect, InputSignal, Parameter, State, Term
from tests.nature.machines.family import Array, Disturbance, Family, Plan, Signals, Values
from tests.nature.machines.integrator import SLOPE, one_mode_guard, one_mode_switch
from tests.nature.machines.signals import chirp, multi_sine, steps, triangle, with_dead_zone, with_limit

CONSTANTS = (
    "area_1_m2", "area_2_m2", "pump_m3_s_v", "pipe_m2", "outlet_m2",
    "rim_m", "lag_s", "leak_m2", "head_m2_s_v", "bypass_m2_s", "bypass_level_m", "seepage_m_s",
    "dead_zone_v", "limit_v", "delay_s", "offset_m", "gain_error",
)  # fmt: skip
(
    AREA_1, AREA_2, PUMP, PIPE, OUTLET, RIM, LAG, LEAK, HEAD, BYPASS, BYPASS_LEVEL, SEEPAGE,
) = range(12)  # fmt: skip

GRAVITY_M_S2 = 9.81
LAMINAR_M = 0.0005
"""Head below which the flow through an orifice becomes laminar."""
SPILL_S = 0.05
"""Time in which what stands above the rim flows off."""


@njit("float64(float64)", cache=True)
def _speed(head: float) -> float:
    """Return the speed of the flow through an orifice; far above `LAMINAR_M` it is the root of 2 g head."""
    return float(math.sqrt(2.0 * GRAVITY_M_S2) * head / math.sqrt(abs(head) + LAMINAR_M))


@njit(SLOPE, cache=True)
def _slope(state: Array, held: Array, force: float, constants: Array, mode: int, out: Array) -> None:
    first, second = state[0], state[1]
    out[2] = 0.0
    pump = held[0]
    if constants[LAG] > 0.0:
        pump = state[2]
        out[2] = (held[0] - state[2]) / constants[LAG]
    through = constants[PIPE] * _speed(first - second)
    inflow = constants[PUMP] * pump + force - through
    inflow -= constants[LEAK] * _speed(first) + constants[HEAD] * pump * first
    inflow -= constants[AREA_1] / SPILL_S * max(first - constants[RIM], 0.0)
    outflow = constants[OUTLET] * _speed(second) + constants[SEEPAGE] * second**2
    outflow += constants[BYPASS] * max(second - constants[BYPASS_LEVEL], 0.0)
    out[0] = inflow / constants[AREA_1]
    out[1] = (through - outflow) / constants[AREA_2]
    if first <= 0.0 and out[0] < 0.0:
        out[0] = 0.0


def _begin(start: Values, constants: Values, actuated: Signals) -> tuple[float, ...]:
    return (max(start["level_1_m"], 0.0), max(start["level_2_m"], 0.0), float(actuated["pump_v"][0]))


def _actuate(inputs: Signals, constants: Values) -> tuple[dict[str, Array], tuple[float, ...]]:
    pump = with_limit(with_dead_zone(inputs["pump_v"], constants["dead_zone_v"]), constants["limit_v"])
    return {"pump_v": pump}, (constants["delay_s"],)


def _observe(states: Signals, constants: Values) -> dict[str, Array]:
    return {
        "measured_level_1_m": states["level_1_m"] + constants["offset_m"],
        "measured_level_2_m": states["level_2_m"] * (1.0 + constants["gain_error"]),
    }


def _plan(rng: np.random.Generator, samples: int, index: int) -> Plan:
    kind = ("steps", "chirp", "drain", "triangle", "multi_sine")[index % 5]
    low, high = (0.15, 0.25) if kind == "drain" else (0.05, 0.12)
    second = float(rng.uniform(low, high))
    first = second + float(rng.uniform(0.02, 0.06))
    pump = np.zeros(samples)
    if kind != "drain":
        shape = {
            "steps": lambda: steps(rng, samples, (15, 50)),
            "chirp": lambda: chirp(rng, samples, (0.004, 0.03)),
            "triangle": lambda: triangle(rng, samples, (50, 120)),
            "multi_sine": lambda: multi_sine(rng, samples, (0.004, 0.04)),
        }[kind]()
        middle = float(rng.uniform(3.0, 6.0))
        pump = middle + float(rng.uniform(0.5, 1.0)) * min(middle, 10.0 - middle) * shape
    return Plan(
        name=f"{kind}_{index}",
        conditions={"start_level_1_m": first, "start_level_2_m": second},
        inputs={"pump_v": pump},
    )


PARAMETERS = (
    # Nominal value, spread, scatter from run to run, meaning.
    Parameter("area_1_m2", 0.0154, 0.02, 0.0, "A1, first tank"),
    Parameter("area_2_m2", 0.0154, 0.02, 0.0, "A2, second tank"),
    Parameter("pump_m3_s_v", 6e-6, 0.04, 0.001, "p, flow per pump voltage"),
    Parameter("pipe_m2", 5e-5, 0.05, 0.003, "a, pipe between the tanks"),
    Parameter("outlet_m2", 3e-5, 0.05, 0.001, "o, outlet of tank 2"),
)  # fmt: skip
CATALOGUE = (
    # Group, formula, size without and largest; what else is drawn.
    Effect("overflow", "overflow",
        "tank 1 cannot hold more than rim_m: what comes above it runs off "
        f"(A1 dh1/dt gets -A1/({SPILL_S:g} s) max(h1 - rim_m, 0))", {"rim_m": (0.6, 0.08)}),
    Effect("dead_zone", "pump", "u becomes max(u - dead_zone_v, 0)", {"dead_zone_v": (0.0, 4.0)}),
    Effect("saturation", "limit", "u becomes min(u, limit_v)", {"limit_v": (10.0, 2.0)}),
    Effect("input_delay", "late", "u(t) becomes u(t - delay_s); before the start u had its first value",
        {"delay_s": (0.0, 60.0)}),
    Effect("actuator_lag", "late", "u becomes y with dy/dt = (u - y)/lag_s; y begins at the first u",
        {"lag_s": (0.0, 80.0)}),
    Effect("sensor_offset", "sensor_1", "measured_level_1_m is h1 + offset_m; the conditions give h1",
        {"offset_m": (0.0, 0.05)}, signed=True),
    Effect("gain_error", "sensor_2", "measured_level_2_m is h2 (1 + gain_error); the conditions give h2",
        {"gain_error": (0.0, 0.3)}, signed=True),
)  # fmt: skip
OUTSIDE = (
    # Equation, variables, shape, formula, coefficient, its largest value; what else is drawn.
    Term("leak", "level_1_m", ("level_1_m",), "square_root", "A1 dh1/dt gets -leak_m2 s(h1)", "leak_m2",
        3e-5),
    Term("pump_head", "level_1_m", ("pump_v", "level_1_m"), "product", "A1 dh1/dt gets -head_m2_s_v u h1",
        "head_m2_s_v", 2e-5),
    Term("bypass", "level_2_m", ("level_2_m",), "threshold",
        "A2 dh2/dt gets -bypass_m2_s max(h2 - bypass_level_m, 0)", "bypass_m2_s", 2e-2,
        {"bypass_level_m": (0.05, 0.09)}),
    Term("seepage", "level_2_m", ("level_2_m",), "square", "A2 dh2/dt gets -seepage_m_s h2^2", "seepage_m_s",
        5e-3),
)  # fmt: skip

FAMILY = Family(
    name="tanks",
    dt_s=2.0,
    parameters=PARAMETERS,
    states=(
        State(name="level_1_m", spread=0.002, scale=0.1),
        State(name="level_2_m", spread=0.002, scale=0.1),
    ),
    extra_states=(("lagged_pump_v", 1.0),),
    channels=(
        Channel(name="measured_level_1_m", sigma=0.0007, quantum=0.0002),
        Channel(name="measured_level_2_m", sigma=0.0007, quantum=0.0002),
    ),
    inputs=(InputSignal(name="pump_v", low=0.0, high=10.0),),
    catalogue=CATALOGUE,
    outside=OUTSIDE,
    disturbance=Disturbance(equation="level_1_m", unit="m^3/s", largest_rms=4e-5, correlation_s=60.0),
    constants=CONSTANTS,
    slope=_slope,
    guard=one_mode_guard,
    switch=one_mode_switch,
    begin=_begin,
    actuate=_actuate,
    observe=_observe,
    plan=_plan,
)
