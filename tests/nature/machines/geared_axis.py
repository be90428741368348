"""A geared axis: voltage on a direct-current motor, gear, load; motor speed and load angle are measured.

    J dw/dt = K/R (U - K w) - b w        dq/dt = w        load angle = q / N

All quantities are referred to the motor shaft. With backlash the load is a body of its own, which the gear
pushes on one side or the other, or not at all; the impact is plastic.
"""

import math

import numpy as np
from numba import njit

from tests.nature.machines.case import Channel, Effect, InputSignal, Parameter, State, Term
from tests.nature.machines.family import Array, Disturbance, Family, Plan, Signals, Values
from tests.nature.machines.friction import FREE, STUCK, contact_guard, contact_mode, dry_force
from tests.nature.machines.integrator import GUARD, SLOPE, START, SWITCH
from tests.nature.machines.signals import chirp, multi_sine, steps, triangle, with_dead_zone, with_sag

CONSTANTS = (
    "torque_constant_v_s", "resistance_ohm", "inertia_kg_m2", "viscous_nm_s", "gear_ratio",
    "coulomb_nm", "asymmetry", "bristle_nm", "bristle_rad", "backlash_rad", "load_share",
    "cogging_nm", "cogging_per_turn", "cogging_phase_rad",
    "cubic_damping_nm_s3", "unbalance_nm", "field_weakening_nm_s_v", "fan_nm_s", "fan_start_rad_s",
    "dead_zone_v", "sag_per_v", "delay_s",
)  # fmt: skip
(
    TORQUE, RESISTANCE, INERTIA, VISCOUS, RATIO,
    COULOMB, ASYMMETRY, BRISTLE, BRISTLE_ANGLE, BACKLASH, LOAD_SHARE,
    COGGING, COGGING_PER_TURN, COGGING_PHASE,
    CUBIC, UNBALANCE, WEAKENING, FAN, FAN_START,
) = range(19)  # fmt: skip

RIGID, AHEAD, BEHIND, APART = 0, 10, 20, 30
"""How the gear meets the load, added to the mode of the friction: motor pushes, motor brakes, no contact."""
CONTACT_RAD_S2 = 1e-6
GAP_RAD = 1e-9


@njit("float64(float64[::1], float64[::1], float64, float64[::1])", cache=True)
def _push(state: Array, held: Array, force: float, constants: Array) -> float:
    """Return the torque on the motor shaft without dry friction."""
    speed, angle = state[0], state[1]
    current = (held[0] - constants[TORQUE] * speed) / constants[RESISTANCE]
    push = constants[TORQUE] * current - constants[VISCOUS] * speed + force
    push -= constants[COGGING] * math.sin(constants[COGGING_PER_TURN] * angle + constants[COGGING_PHASE])
    push -= constants[CUBIC] * speed**3
    push -= constants[UNBALANCE] * math.sin(angle / constants[RATIO])
    push -= constants[WEAKENING] * held[0] * abs(speed)
    over = max(abs(speed) - constants[FAN_START], 0.0)
    push -= constants[FAN] * math.copysign(over, speed)
    if constants[BRISTLE] > 0.0:
        push -= constants[BRISTLE] * state[4]
    return float(push)


@njit("float64(float64[::1], float64[::1], float64, float64[::1], int64)", cache=True)
def _acceleration(state: Array, held: Array, force: float, constants: Array, mode: int) -> float:
    """Return the acceleration of the motor shaft."""
    contact = (mode + 5) // 10 * 10
    friction = mode - contact
    if friction == STUCK:
        return 0.0
    forward = constants[COULOMB] * (1.0 + constants[ASYMMETRY])
    backward = constants[COULOMB] * (1.0 - constants[ASYMMETRY])
    torque = _push(state, held, force, constants) + dry_force(friction, state[0], forward, backward, 0.0, 1.0)
    inertia = constants[INERTIA]
    if contact == APART:
        inertia *= 1.0 - constants[LOAD_SHARE]
    return float(torque / inertia)


@njit(SLOPE, cache=True)
def _slope(state: Array, held: Array, force: float, constants: Array, mode: int, out: Array) -> None:
    out[0] = _acceleration(state, held, force, constants, mode)
    out[1] = state[0]
    out[2] = 0.0 if (mode + 5) // 10 * 10 == APART else out[0]
    out[3] = state[2]
    out[4] = 0.0
    if constants[BRISTLE] > 0.0:
        out[4] = (state[0] - abs(state[0]) * state[4]) / constants[BRISTLE_ANGLE]


@njit("float64(float64[::1], float64[::1], float64, float64[::1], int64)", cache=True)
def _friction_guard(state: Array, held: Array, force: float, constants: Array, mode: int) -> float:
    friction = mode - (mode + 5) // 10 * 10
    forward = constants[COULOMB] * (1.0 + constants[ASYMMETRY])
    backward = constants[COULOMB] * (1.0 - constants[ASYMMETRY])
    return contact_guard(friction, state[0], _push(state, held, force, constants), forward, backward)


@njit("float64(float64[::1], float64[::1], float64, float64[::1], int64)", cache=True)
def _gear_guard(state: Array, held: Array, force: float, constants: Array, mode: int) -> float:
    contact = (mode + 5) // 10 * 10
    if contact == RIGID:
        return 1.0
    if contact == APART:
        half = 0.5 * constants[BACKLASH] * constants[RATIO]
        return float(half + GAP_RAD - abs(state[1] - state[3]))
    acceleration = _acceleration(state, held, force, constants, mode)
    return CONTACT_RAD_S2 + (acceleration if contact == AHEAD else -acceleration)


@njit(GUARD, cache=True)
def _guard(state: Array, held: Array, force: float, constants: Array, mode: int) -> float:
    return min(
        _friction_guard(state, held, force, constants, mode), _gear_guard(state, held, force, constants, mode)
    )


@njit("int64(float64[::1], float64[::1], float64, float64[::1])", cache=True)
def _friction_mode(state: Array, held: Array, force: float, constants: Array) -> int:
    forward = constants[COULOMB] * (1.0 + constants[ASYMMETRY])
    backward = constants[COULOMB] * (1.0 - constants[ASYMMETRY])
    return contact_mode(state[0], _push(state, held, force, constants), forward, backward)


@njit(SWITCH, cache=True)
def _switch(state: Array, held: Array, force: float, constants: Array, mode: int) -> int:
    if mode == START:
        contact = AHEAD if constants[BACKLASH] > 0.0 else RIGID
        return contact + _friction_mode(state, held, force, constants)
    contact = (mode + 5) // 10 * 10
    friction = mode - contact
    if _friction_guard(state, held, force, constants, mode) < 0.0:
        if friction != STUCK:
            state[0] = 0.0
            if contact != APART:
                state[2] = 0.0
        return contact + _friction_mode(state, held, force, constants)
    if contact != APART:
        return APART + friction
    half = 0.5 * constants[BACKLASH] * constants[RATIO]
    side = 1.0 if state[1] > state[3] else -1.0
    share = constants[LOAD_SHARE]
    together = (1.0 - share) * state[0] + share * state[2]
    state[0] = together
    state[2] = together
    state[3] = state[1] - side * half
    if friction != FREE:
        friction = _friction_mode(state, held, force, constants)
    return (AHEAD if side > 0.0 else BEHIND) + friction


def _begin(start: Values, constants: Values, actuated: Signals) -> tuple[float, ...]:
    half = 0.5 * constants["backlash_rad"]
    angle = start["motor_angle_rad"]
    speed = start["motor_speed_rad_s"]
    return (speed, angle, speed, angle - half * constants["gear_ratio"], 0.0)


def _actuate(inputs: Signals, constants: Values) -> tuple[dict[str, Array], tuple[float, ...]]:
    voltage = with_dead_zone(inputs["voltage_v"], constants["dead_zone_v"])
    return {"voltage_v": with_sag(voltage, constants["sag_per_v"])}, (constants["delay_s"],)


def _observe(states: Signals, constants: Values) -> dict[str, Array]:
    return {
        "speed_rad_s": states["motor_speed_rad_s"].copy(),
        "load_angle_rad": states["load_angle_at_motor_rad"] / constants["gear_ratio"],
    }


def _plan(rng: np.random.Generator, samples: int, index: int) -> Plan:
    kind = ("steps", "chirp", "triangle", "multi_sine")[index % 4]
    shape = {
        "steps": lambda: steps(rng, samples, (10, 40)),
        "chirp": lambda: chirp(rng, samples, (0.005, 0.08)),
        "triangle": lambda: triangle(rng, samples, (60, 140)),
        "multi_sine": lambda: multi_sine(rng, samples, (0.006, 0.1)),
    }[kind]()
    voltage = float(rng.uniform(2.0, 12.0)) * shape
    return Plan(
        name=f"{kind}_{index}",
        conditions={"start_motor_speed_rad_s": 0.0, "start_motor_angle_rad": 0.0},
        inputs={"voltage_v": voltage},
    )


PARAMETERS = (
    # Nominal value, spread, scatter from run to run, meaning.
    Parameter("torque_constant_v_s", 0.05, 0.03, 0.002, "K, back-EMF and torque constant (N m/A)"),
    Parameter("resistance_ohm", 1.0, 0.05, 0.004, "R, winding"),
    Parameter("inertia_kg_m2", 1e-4, 0.05, 0.0, "J, motor and load at the motor shaft"),
    Parameter("viscous_nm_s", 2e-4, 0.2, 0.02, "b, bearing at the motor shaft"),
    Parameter("gear_ratio", 20.0, 0.0, 0.0, "N, motor turns per load turn"),
)  # fmt: skip
CATALOGUE = (
    # Group, formula, size without and largest; what else is drawn.
    Effect("coulomb_friction", "friction",
        "J dw/dt gets -coulomb_nm sgn(w); at w = 0 it holds the shaft against any torque up to "
        "coulomb_nm", {"coulomb_nm": (0.0, 0.1)}),
    Effect("asymmetric_friction", "friction",
        "J dw/dt gets -coulomb_nm (1 + asymmetry) if w > 0 and +coulomb_nm (1 - asymmetry) if w < 0; at "
        "w = 0 it holds the shaft against any torque up to the same values", {"coulomb_nm": (0.0, 0.1)},
        {"asymmetry": (0.3, 0.8)}),
    Effect("presliding_friction", "friction",
        "J dw/dt gets -bristle_nm z with dz/dt = (w - |w| z)/bristle_rad, z = 0 at the start (Dahl); "
        "bristle_rad is an angle of the motor shaft", {"bristle_nm": (0.0, 0.1)},
        {"bristle_rad": (0.5, 3.0)}),
    Effect("backlash", "gear",
        "motor and load are two bodies with (1 - load_share) J and load_share J at the motor shaft; the "
        "load turns freely while |q - N load angle| < N backlash_rad/2 (b acts on the motor); contact is "
        "rigid, impact plastic; the motor touches its forward side at the start, so that the load angle "
        "begins at q/N - backlash_rad/2", {"backlash_rad": (0.0, 0.6)}, {"load_share": (0.3, 0.6)}),
    Effect("dead_zone", "voltage", "U becomes sgn(U) max(|U| - dead_zone_v, 0)", {"dead_zone_v": (0.0, 3.0)}),
    Effect("supply_sag", "voltage", "U becomes U (1 - sag_per_v |U|)", {"sag_per_v": (0.0, 0.03)}),
    Effect("input_delay", "delay", "U(t) becomes U(t - delay_s); before the start U had its first value",
        {"delay_s": (0.0, 0.06)}),
    Effect("cogging", "cogging", "J dw/dt gets -cogging_nm sin(cogging_per_turn q + cogging_phase_rad)",
        {"cogging_nm": (0.0, 0.06)}, {"cogging_per_turn": (4.0, 4.0), "cogging_phase_rad": (0.0, 6.28)}),
)  # fmt: skip
OUTSIDE = (
    # Equation, variables, shape, formula, coefficient, its largest value; what else is drawn.
    Term("cubic_damping", "motor_speed_rad_s", ("motor_speed_rad_s",), "cube",
        "J dw/dt gets -cubic_damping_nm_s3 w^3", "cubic_damping_nm_s3", 3e-7),
    Term("unbalance", "motor_speed_rad_s", ("load_angle_rad",), "sine", "J dw/dt gets -unbalance_nm sin(q/N)",
        "unbalance_nm", 0.3),
    Term("field_weakening", "motor_speed_rad_s", ("voltage_v", "motor_speed_rad_s"), "product",
        "J dw/dt gets -field_weakening_nm_s_v U |w|", "field_weakening_nm_s_v", 2e-4),
    Term("fan_above_a_speed", "motor_speed_rad_s", ("motor_speed_rad_s",), "threshold",
        "J dw/dt gets -fan_nm_s sgn(w) max(|w| - fan_start_rad_s, 0)", "fan_nm_s", 2e-2,
        {"fan_start_rad_s": (30.0, 60.0)}),
)  # fmt: skip

FAMILY = Family(
    name="geared_axis",
    dt_s=0.01,
    parameters=PARAMETERS,
    states=(
        State(name="motor_speed_rad_s", spread=0.0, scale=10.0),
        State(name="motor_angle_rad", spread=0.1, scale=10.0),
    ),
    extra_states=(("load_speed_at_motor_rad_s", 10.0), ("load_angle_at_motor_rad", 10.0), ("bristle", 1.0)),
    channels=(
        Channel(name="speed_rad_s", sigma=0.5, quantum=0.1),
        Channel(name="load_angle_rad", sigma=0.01, quantum=math.tau / 1000),
    ),
    inputs=(InputSignal(name="voltage_v", low=-12.0, high=12.0),),
    catalogue=CATALOGUE,
    outside=OUTSIDE,
    disturbance=Disturbance(equation="motor_speed_rad_s", unit="N m", largest_rms=0.3, correlation_s=0.2),
    constants=CONSTANTS,
    slope=_slope,
    guard=_guard,
    switch=_switch,
    begin=_begin,
    actuate=_actuate,
    observe=_observe,
    plan=_plan,
)
