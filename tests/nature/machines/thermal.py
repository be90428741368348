"""A heated body with a shell in a room; the temperatures of both are measured.

C1 dT1/dt = k P - G (T1 - T2)        C2 dT2/dt = G (T1 - T2) - H (T2 - Ta)
"""

import math

import numpy as np
from numba import njit

from tests.nature.machines.case import Channel, Effect, InputSignal, Parameter, State, Term
from tests.nature.machines.family import Array, Disturbance, Family, Plan, Signals, Values
from tests.nature.machines.integrator import SLOPE, one_mode_guard, one_mode_switch
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
    "capacity_1_j_k", "capacity_2_j_k", "conductance_w_k", "loss_w_k", "heater_gain",
    "sensor_lag_s", "radiation_w_k4", "convection_w_k2", "fade_per_k", "fan_w_k", "fan_start_c",
    "dead_zone_w", "limit_w", "sag_per_w", "delay_s", "offset_k",
)  # fmt: skip
(
    CAPACITY_1, CAPACITY_2, CONDUCTANCE, LOSS, GAIN, SENSOR_LAG, RADIATION, CONVECTION, FADE, FAN, FAN_START,
) = range(11)  # fmt: skip

ZERO_C_K = 273.15


@njit(SLOPE, cache=True)
def _slope(state: Array, held: Array, force: float, constants: Array, mode: int, out: Array) -> None:
    body, shell = state[0], state[1]
    heat, room = held[0], held[1]
    over = shell - room
    between = constants[CONDUCTANCE] * (body - shell)
    into = constants[GAIN] * heat + force - between
    into -= constants[FADE] * heat * (body - room)
    lost = constants[LOSS] * over + constants[CONVECTION] * over * abs(over)
    lost += constants[RADIATION] * ((shell + ZERO_C_K) ** 4 - (room + ZERO_C_K) ** 4)
    lost += constants[FAN] * max(shell - constants[FAN_START], 0.0)
    out[0] = into / constants[CAPACITY_1]
    out[1] = (between - lost) / constants[CAPACITY_2]
    out[2] = 0.0
    if constants[SENSOR_LAG] > 0.0:
        out[2] = (body - state[2]) / constants[SENSOR_LAG]


def _begin(start: Values, constants: Values, actuated: Signals) -> tuple[float, ...]:
    return (start["temperature_1_c"], start["temperature_2_c"], start["temperature_1_c"])


def _actuate(inputs: Signals, constants: Values) -> tuple[dict[str, Array], tuple[float, ...]]:
    heat = with_limit(with_dead_zone(inputs["heater_w"], constants["dead_zone_w"]), constants["limit_w"])
    actuated = {"heater_w": with_sag(heat, constants["sag_per_w"]), "room_c": inputs["room_c"].copy()}
    return actuated, (constants["delay_s"], 0.0)


def _observe(states: Signals, constants: Values) -> dict[str, Array]:
    lagged = constants["sensor_lag_s"] > 0.0
    return {
        "measured_1_c": states["lagged_1_c" if lagged else "temperature_1_c"].copy(),
        "measured_2_c": states["temperature_2_c"] + constants["offset_k"],
    }


def _plan(rng: np.random.Generator, samples: int, index: int) -> Plan:
    kind = ("steps", "chirp", "cool_down", "triangle", "multi_sine")[index % 5]
    room = float(rng.uniform(17.0, 25.0))
    heat = np.zeros(samples)
    start = room
    if kind == "cool_down":
        start = room + float(rng.uniform(25.0, 45.0))
    else:
        shape = {
            "steps": lambda: steps(rng, samples, (15, 50)),
            "chirp": lambda: chirp(rng, samples, (0.004, 0.04)),
            "triangle": lambda: triangle(rng, samples, (50, 120)),
            "multi_sine": lambda: multi_sine(rng, samples, (0.004, 0.05)),
        }[kind]()
        middle = float(rng.uniform(20.0, 40.0))
        heat = middle + float(rng.uniform(0.5, 1.0)) * min(middle, 60.0 - middle) * shape
    drift = 1.5 * np.sin(math.tau * (np.arange(samples) / float(rng.uniform(150.0, 400.0)) + rng.uniform()))
    return Plan(
        name=f"{kind}_{index}",
        conditions={"start_temperature_1_c": start, "start_temperature_2_c": start},
        inputs={"heater_w": heat, "room_c": room + drift},
    )


PARAMETERS = (
    # Nominal value, spread, scatter from run to run, meaning.
    Parameter("capacity_1_j_k", 40.0, 0.04, 0.0, "C1, body"),
    Parameter("capacity_2_j_k", 150.0, 0.04, 0.0, "C2, shell"),
    Parameter("conductance_w_k", 1.0, 0.06, 0.001, "G, from body to shell"),
    Parameter("loss_w_k", 0.8, 0.06, 0.001, "H, from shell to room"),
    Parameter("heater_gain", 1.0, 0.02, 0.001, "k, heat per commanded heat"),
)  # fmt: skip
CATALOGUE = (
    # Group, formula, size without and largest; what else is drawn.
    Effect("dead_zone", "heater", "P becomes max(P - dead_zone_w, 0)", {"dead_zone_w": (0.0, 20.0)}),
    Effect("saturation", "limit", "P becomes min(P, limit_w)", {"limit_w": (60.0, 15.0)}),
    Effect("supply_sag", "sag", "P becomes P (1 - sag_per_w P)", {"sag_per_w": (0.0, 0.008)}),
    Effect("input_delay", "delay", "P(t) becomes P(t - delay_s); before the start P had its first value",
        {"delay_s": (0.0, 80.0)}),
    Effect("sensor_lag", "sensor_1", "measured_1_c is y with dy/dt = (T1 - y)/sensor_lag_s; y begins at T1",
        {"sensor_lag_s": (0.0, 120.0)}),
    Effect("sensor_offset", "sensor_2", "measured_2_c is T2 + offset_k; the conditions give T2",
        {"offset_k": (0.0, 5.0)}, signed=True),
)  # fmt: skip
OUTSIDE = (
    # Equation, variables, shape, formula, coefficient, its largest value; what else is drawn.
    Term("radiation", "temperature_2_c", ("temperature_2_c", "room_c"), "fourth_power",
        "C2 dT2/dt gets -radiation_w_k4 ((T2 + 273.15)^4 - (Ta + 273.15)^4)", "radiation_w_k4", 1e-8),
    Term("free_convection", "temperature_2_c", ("temperature_2_c", "room_c"), "signed_square",
        "C2 dT2/dt gets -convection_w_k2 (T2 - Ta) |T2 - Ta|", "convection_w_k2", 0.03),
    Term("fading_heater", "temperature_1_c", ("heater_w", "temperature_1_c", "room_c"), "product",
        "C1 dT1/dt gets -fade_per_k P (T1 - Ta)", "fade_per_k", 0.01),
    Term("fan_above_a_temperature", "temperature_2_c", ("temperature_2_c",), "threshold",
        "C2 dT2/dt gets -fan_w_k max(T2 - fan_start_c, 0)", "fan_w_k", 3.0, {"fan_start_c": (35.0, 45.0)}),
)  # fmt: skip

FAMILY = Family(
    name="thermal",
    dt_s=4.0,
    parameters=PARAMETERS,
    states=(
        State(name="temperature_1_c", spread=0.3, scale=20.0),
        State(name="temperature_2_c", spread=0.3, scale=20.0),
    ),
    extra_states=(("lagged_1_c", 20.0),),
    channels=(
        Channel(name="measured_1_c", sigma=0.1, quantum=0.05),
        Channel(name="measured_2_c", sigma=0.1, quantum=0.05),
    ),
    inputs=(
        InputSignal(name="heater_w", low=0.0, high=60.0),
        InputSignal(name="room_c", low=15.5, high=26.5),
    ),
    catalogue=CATALOGUE,
    outside=OUTSIDE,
    disturbance=Disturbance(equation="temperature_1_c", unit="W", largest_rms=30.0, correlation_s=60.0),
    constants=CONSTANTS,
    slope=_slope,
    guard=one_mode_guard,
    switch=one_mode_switch,
    begin=_begin,
    actuate=_actuate,
    observe=_observe,
    plan=_plan,
)
