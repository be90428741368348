"""A vehicle in the plane: drive force and steering; speed and yaw rate are measured.

m dv/dt = k F - c v        T dr/dt = v d/(W (1 + (v/vc)^2)) - r
"""

from collections.abc import Callable

import numpy as np
from numba import njit

from tests.nature.machines.case import Channel, Effect, InputSignal, Parameter, State, Term
from tests.nature.machines.family import Array, Disturbance, Family, Plan, Signals, Values
from tests.nature.machines.friction import FREE, STUCK, contact_guard, contact_mode, dry_force
from tests.nature.machines.integrator import GUARD, SLOPE, START, SWITCH
from tests.nature.machines.signals import chirp, multi_sine, steps, triangle, with_limit, with_play

CONSTANTS = (
    "mass_kg", "damping_n_s_m", "drive_gain", "wheelbase_m", "characteristic_m_s", "yaw_lag_s",
    "rolling_n", "drag_n_s2_m2",
    "cornering_n_s3_m", "cubic_n_s3_m3", "steering_loss_s2", "yaw_drag_s", "brake_n_s_m", "brake_start_m_s",
    "limit_n", "play_rad", "delay_s", "offset_rad_s", "gain_error",
)  # fmt: skip
(
    MASS, DAMPING, GAIN, WHEELBASE, CHARACTERISTIC, YAW_LAG, ROLLING, DRAG,
    CORNERING, CUBIC, STEERING_LOSS, YAW_DRAG, BRAKE, BRAKE_START,
) = range(14)  # fmt: skip


@njit("float64(float64[::1], float64[::1], float64, float64[::1])", cache=True)
def _push(state: Array, held: Array, force: float, constants: Array) -> float:
    """Return the force along the vehicle without rolling resistance."""
    speed, yaw = state[0], state[1]
    push = constants[GAIN] * held[0] + force - constants[DAMPING] * speed
    push -= constants[DRAG] * speed * abs(speed) + constants[CUBIC] * speed**3
    push -= constants[CORNERING] * speed * yaw**2
    return float(push - constants[BRAKE] * max(speed - constants[BRAKE_START], 0.0))


@njit(SLOPE, cache=True)
def _slope(state: Array, held: Array, force: float, constants: Array, mode: int, out: Array) -> None:
    speed, yaw, steering = state[0], state[1], held[1]
    rolling = constants[ROLLING]
    out[0] = 0.0
    if mode != STUCK:
        resistance = dry_force(mode, speed, rolling, rolling, 0.0, 1.0)
        out[0] = (_push(state, held, force, constants) + resistance) / constants[MASS]
    understeer = 1.0 + (speed / constants[CHARACTERISTIC]) ** 2
    turn = speed * steering / (constants[WHEELBASE] * understeer) - yaw
    turn -= constants[STEERING_LOSS] * speed * steering**3 + constants[YAW_DRAG] * yaw * abs(yaw)
    out[1] = turn / constants[YAW_LAG]


@njit(GUARD, cache=True)
def _guard(state: Array, held: Array, force: float, constants: Array, mode: int) -> float:
    if mode == FREE:
        return 1.0
    rolling = constants[ROLLING]
    return float(contact_guard(mode, state[0], _push(state, held, force, constants), rolling, rolling))


@njit(SWITCH, cache=True)
def _switch(state: Array, held: Array, force: float, constants: Array, mode: int) -> int:
    if mode not in (START, STUCK):
        state[0] = 0.0
    rolling = constants[ROLLING]
    return int(contact_mode(state[0], _push(state, held, force, constants), rolling, rolling))


def _begin(start: Values, constants: Values, actuated: Signals) -> tuple[float, ...]:
    return (start["speed_m_s"], start["yaw_rate_rad_s"])


def _actuate(inputs: Signals, constants: Values) -> tuple[dict[str, Array], tuple[float, ...]]:
    actuated = {
        "force_n": with_limit(inputs["force_n"], constants["limit_n"]),
        "steering_rad": with_play(inputs["steering_rad"], constants["play_rad"]),
    }
    return actuated, (0.0, constants["delay_s"])


def _observe(states: Signals, constants: Values) -> dict[str, Array]:
    return {
        "measured_speed_m_s": states["speed_m_s"] * (1.0 + constants["gain_error"]),
        "measured_yaw_rate_rad_s": states["yaw_rate_rad_s"] + constants["offset_rad_s"],
    }


def _plan(rng: np.random.Generator, samples: int, index: int) -> Plan:
    kind = ("steps", "chirp", "coast", "triangle", "from_rest")[index % 5]
    low, high = {"coast": (3.0, 20.0), "from_rest": (0.0, 0.0)}.get(kind, (6.0, 15.0))
    speed = float(rng.uniform(low, high))
    shapes: dict[str, Callable[[], Array]] = {
        "steps": lambda: steps(rng, samples, (20, 70)),
        "chirp": lambda: chirp(rng, samples, (0.004, 0.03)),
        "coast": lambda: np.zeros(samples),
        "triangle": lambda: triangle(rng, samples, (60, 140)),
        "from_rest": lambda: np.concatenate((np.zeros(20), np.abs(steps(rng, samples - 20, (30, 80))))),
    }
    steering = (
        lambda: multi_sine(rng, samples, (0.005, 0.04)),
        lambda: steps(rng, samples, (20, 60)),
        lambda: triangle(rng, samples, (50, 120)),
    )[int(rng.integers(3))]()
    return Plan(
        name=f"{kind}_{index}",
        conditions={"start_speed_m_s": speed, "start_yaw_rate_rad_s": 0.0},
        inputs={
            "force_n": float(rng.uniform(1000.0, 3000.0)) * shapes[kind](),
            "steering_rad": float(rng.uniform(0.03, 0.1)) * steering,
        },
    )


PARAMETERS = (
    # Nominal value, spread, scatter from run to run, meaning.
    Parameter("mass_kg", 1200.0, 0.04, 0.0005, "m"),
    Parameter("damping_n_s_m", 60.0, 0.15, 0.004, "c, drag per speed"),
    Parameter("drive_gain", 1.0, 0.02, 0.001, "k, force per commanded force"),
    Parameter("wheelbase_m", 2.6, 0.01, 0.0, "W"),
    Parameter("characteristic_m_s", 20.0, 0.08, 0.002, "vc, speed of largest yaw rate per steering angle"),
    Parameter("yaw_lag_s", 0.2, 0.15, 0.0, "T, lag of the yaw rate"),
)  # fmt: skip
CATALOGUE = (
    # Group, formula, size without and largest; what else is drawn.
    Effect("rolling_friction", "friction",
        "m dv/dt gets -rolling_n sgn(v); at v = 0 it holds the vehicle against "
        "any force up to rolling_n", {"rolling_n": (0.0, 1500.0)}),
    Effect("quadratic_drag", "drag", "m dv/dt gets -drag_n_s2_m2 v |v|", {"drag_n_s2_m2": (0.0, 10.0)}),
    Effect("saturation", "force", "F becomes max(-limit_n, min(F, limit_n))", {"limit_n": (3000.0, 500.0)}),
    Effect("input_delay", "delay", "d(t) becomes d(t - delay_s); before the start d had its first value",
        {"delay_s": (0.0, 0.8)}),
    Effect("steering_backlash", "steering",
        "d becomes y, which stays within play_rad/2 of d and moves only if it must; y begins at the "
        "first d", {"play_rad": (0.0, 0.1)}),
    Effect("sensor_offset", "sensor_2", "measured_yaw_rate_rad_s is r + offset_rad_s; the conditions give r",
        {"offset_rad_s": (0.0, 0.2)}, signed=True),
    Effect("gain_error", "sensor_1", "measured_speed_m_s is v (1 + gain_error); the conditions give v",
        {"gain_error": (0.0, 0.2)}, signed=True),
)  # fmt: skip
OUTSIDE = (
    # Equation, variables, shape, formula, coefficient, its largest value; what else is drawn.
    Term("cornering_drag", "speed_m_s", ("speed_m_s", "yaw_rate_rad_s"), "product",
        "m dv/dt gets -cornering_n_s3_m v r^2", "cornering_n_s3_m", 3e4),
    Term("cubic_drag", "speed_m_s", ("speed_m_s",), "cube", "m dv/dt gets -cubic_n_s3_m3 v^3",
        "cubic_n_s3_m3", 1.0),
    Term("steering_loss", "yaw_rate_rad_s", ("speed_m_s", "steering_rad"), "product",
        "T dr/dt gets -steering_loss_s2 v d^3", "steering_loss_s2", 60.0),
    Term("yaw_drag", "yaw_rate_rad_s", ("yaw_rate_rad_s",), "signed_square", "T dr/dt gets -yaw_drag_s r |r|",
        "yaw_drag_s", 20.0),
    Term("speed_brake", "speed_m_s", ("speed_m_s",), "threshold",
        "m dv/dt gets -brake_n_s_m max(v - brake_start_m_s, 0)", "brake_n_s_m", 2000.0,
        {"brake_start_m_s": (3.0, 7.0)}),
)  # fmt: skip

FAMILY = Family(
    name="vehicle",
    dt_s=0.05,
    parameters=PARAMETERS,
    states=(
        State(name="speed_m_s", spread=0.1, scale=5.0),
        State(name="yaw_rate_rad_s", spread=0.003, scale=0.1),
    ),
    extra_states=(),
    channels=(
        Channel(name="measured_speed_m_s", sigma=0.05, quantum=0.01),
        Channel(name="measured_yaw_rate_rad_s", sigma=0.003, quantum=0.001),
    ),
    inputs=(
        InputSignal(name="force_n", low=-3000.0, high=3000.0),
        InputSignal(name="steering_rad", low=-0.1, high=0.1),
    ),
    catalogue=CATALOGUE,
    outside=OUTSIDE,
    disturbance=Disturbance(equation="speed_m_s", unit="N", largest_rms=3000.0, correlation_s=1.0),
    constants=CONSTANTS,
    slope=_slope,
    guard=_guard,
    switch=_switch,
    begin=_begin,
    actuate=_actuate,
    observe=_observe,
    plan=_plan,
)
