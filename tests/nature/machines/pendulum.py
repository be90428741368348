"""A pendulum, let go or driven by a torque at its pivot; its angle is measured.

J d2a/dt2 = -G sin a - b da/dt + k M
"""

import math

import numpy as np
from numba import njit

from tests.nature.machines.case import Channel, Effect, InputSignal, Parameter, State, Term
from tests.nature.machines.family import Array, Disturbance, Family, Plan, Signals, Values
from tests.nature.machines.friction import FREE, STUCK, contact_guard, contact_mode, dry_force
from tests.nature.machines.integrator import GUARD, SLOPE, START, SWITCH
from tests.nature.machines.signals import chirp, multi_sine, steps

CONSTANTS = (
    "inertia_kg_m2", "gravity_nm", "viscous_nm_s", "drive_gain",
    "coulomb_nm", "stiction_share", "stribeck_rad_s", "drag_nm_s2", "stiffness_nm_rad3",
    "cubic_damping_nm_s3", "second_harmonic_nm", "angle_damping_nm_s", "bumper_nm_rad", "bumper_rad",
    "lag_s", "delay_s", "offset_rad",
)  # fmt: skip
(
    INERTIA, GRAVITY, VISCOUS, GAIN, COULOMB, STICTION, STRIBECK, DRAG, STIFFNESS,
    CUBIC, HARMONIC, ANGLE_DAMPING, BUMPER, BUMPER_ANGLE, LAG,
) = range(15)  # fmt: skip


@njit("float64(float64[::1], float64[::1], float64, float64[::1])", cache=True)
def _push(state: Array, held: Array, force: float, constants: Array) -> float:
    """Return the torque at the pivot without dry friction."""
    angle, rate = state[0], state[1]
    drive = state[2] if constants[LAG] > 0.0 else held[0]
    push = constants[GAIN] * drive + force - constants[GRAVITY] * math.sin(angle) - constants[VISCOUS] * rate
    push -= constants[DRAG] * rate * abs(rate) + constants[STIFFNESS] * angle**3
    push -= constants[CUBIC] * rate**3 + constants[HARMONIC] * math.sin(2.0 * angle)
    push -= constants[ANGLE_DAMPING] * angle**2 * rate
    over = math.copysign(max(abs(angle) - constants[BUMPER_ANGLE], 0.0), angle)
    return float(push - constants[BUMPER] * over)


@njit(SLOPE, cache=True)
def _slope(state: Array, held: Array, force: float, constants: Array, mode: int, out: Array) -> None:
    dry = constants[COULOMB]
    out[0] = 0.0
    out[1] = 0.0
    out[2] = 0.0
    if constants[LAG] > 0.0:
        out[2] = (held[0] - state[2]) / constants[LAG]
    if mode != STUCK:
        friction = dry_force(mode, state[1], dry, dry, constants[STICTION] * dry, constants[STRIBECK])
        out[0] = state[1]
        out[1] = (_push(state, held, force, constants) + friction) / constants[INERTIA]


@njit(GUARD, cache=True)
def _guard(state: Array, held: Array, force: float, constants: Array, mode: int) -> float:
    if mode == FREE:
        return 1.0
    hold = constants[COULOMB] * (1.0 + constants[STICTION])
    return contact_guard(mode, state[1], _push(state, held, force, constants), hold, hold)


@njit(SWITCH, cache=True)
def _switch(state: Array, held: Array, force: float, constants: Array, mode: int) -> int:
    if mode not in (START, STUCK):
        state[1] = 0.0
    hold = constants[COULOMB] * (1.0 + constants[STICTION])
    return contact_mode(state[1], _push(state, held, force, constants), hold, hold)


def _begin(start: Values, constants: Values, actuated: Signals) -> tuple[float, ...]:
    return (start["angle_rad"], start["rate_rad_s"], float(actuated["torque_nm"][0]))


def _actuate(inputs: Signals, constants: Values) -> tuple[dict[str, Array], tuple[float, ...]]:
    return {"torque_nm": inputs["torque_nm"].copy()}, (constants["delay_s"],)


def _observe(states: Signals, constants: Values) -> dict[str, Array]:
    return {"measured_angle_rad": states["angle_rad"] + constants["offset_rad"]}


def _plan(rng: np.random.Generator, samples: int, index: int) -> Plan:
    kind = ("release", "chirp", "release", "steps", "multi_sine")[index % 5]
    if kind == "release":
        start = float(rng.choice((-1.0, 1.0)) * rng.uniform(0.3, 1.4))
        torque = np.zeros(samples)
    else:
        start = float(rng.uniform(-0.3, 0.3))
        shape = {
            "chirp": lambda: chirp(rng, samples, (0.008, 0.035)),
            "steps": lambda: steps(rng, samples, (25, 70)),
            "multi_sine": lambda: multi_sine(rng, samples, (0.006, 0.04)),
        }[kind]()
        torque = float(rng.uniform(0.05, 0.2)) * shape
    return Plan(
        name=f"{kind}_{index}",
        conditions={"start_angle_rad": start, "start_rate_rad_s": 0.0},
        inputs={"torque_nm": torque},
    )


PARAMETERS = (
    # Nominal value, spread, scatter from run to run, meaning.
    Parameter("inertia_kg_m2", 0.02, 0.04, 0.0, "J about the pivot"),
    Parameter("gravity_nm", 0.75, 0.03, 0.0003, "G = mass x gravity x distance of the centre of mass"),
    Parameter("viscous_nm_s", 0.015, 0.2, 0.005, "b, bearing"),
    Parameter("drive_gain", 1.0, 0.03, 0.002, "k, torque per commanded torque"),
)  # fmt: skip
CATALOGUE = (
    # Group, formula, size without and largest; what else is drawn.
    Effect("coulomb_friction", "friction",
        "J d2a/dt2 gets -coulomb_nm sgn(da/dt); at rest it holds the pendulum against any torque up to "
        "coulomb_nm", {"coulomb_nm": (0.0, 0.1)}),
    Effect("stribeck_friction", "friction",
        "J d2a/dt2 gets -coulomb_nm (1 + stiction_share exp(-(da/dt / stribeck_rad_s)^2)) sgn(da/dt); at "
        "rest it holds the pendulum against any torque up to coulomb_nm (1 + stiction_share)",
        {"coulomb_nm": (0.0, 0.1)}, {"stiction_share": (0.4, 1.5), "stribeck_rad_s": (0.2, 1.0)}),
    Effect("quadratic_drag", "drag", "J d2a/dt2 gets -drag_nm_s2 (da/dt) |da/dt|",
        {"drag_nm_s2": (0.0, 0.03)}),
    Effect("cubic_stiffness", "stiffness", "J d2a/dt2 gets -stiffness_nm_rad3 a^3",
        {"stiffness_nm_rad3": (0.0, 0.1)}, signed=True),
    Effect("actuator_lag", "actuator", "M becomes m with dm/dt = (M - m)/lag_s; m begins at the first M",
        {"lag_s": (0.0, 0.4)}),
    Effect("input_delay", "actuator", "M(t) becomes M(t - delay_s); before the start M had its first value",
        {"delay_s": (0.0, 0.3)}),
    Effect("sensor_offset", "sensor", "the measured angle is a + offset_rad; the conditions give a",
        {"offset_rad": (0.0, 0.2)}, signed=True),
)  # fmt: skip
OUTSIDE = (
    # Equation, variables, shape, formula, coefficient, its largest value; what else is drawn.
    Term("cubic_damping", "rate_rad_s", ("rate_rad_s",), "cube",
        "J d2a/dt2 gets -cubic_damping_nm_s3 (da/dt)^3", "cubic_damping_nm_s3", 0.01),
    Term("second_harmonic", "rate_rad_s", ("angle_rad",), "sine",
        "J d2a/dt2 gets -second_harmonic_nm sin(2 a)", "second_harmonic_nm", 0.2),
    Term("angle_damping", "rate_rad_s", ("angle_rad", "rate_rad_s"), "product",
        "J d2a/dt2 gets -angle_damping_nm_s a^2 (da/dt)", "angle_damping_nm_s", 0.2),
    Term("soft_bumper", "rate_rad_s", ("angle_rad",), "threshold",
        "J d2a/dt2 gets -bumper_nm_rad sgn(a) max(|a| - bumper_rad, 0)", "bumper_nm_rad", 3.0,
        {"bumper_rad": (0.3, 0.6)}),
)  # fmt: skip

FAMILY = Family(
    name="pendulum",
    dt_s=0.02,
    parameters=PARAMETERS,
    states=(
        State(name="angle_rad", spread=0.01, scale=0.5),
        State(name="rate_rad_s", spread=0.01, scale=2.0),
    ),
    extra_states=(("lagged_torque_nm", 0.1),),
    channels=(Channel(name="measured_angle_rad", sigma=0.004, quantum=math.tau / 4096),),
    inputs=(InputSignal(name="torque_nm", low=-0.2, high=0.2),),
    catalogue=CATALOGUE,
    outside=OUTSIDE,
    disturbance=Disturbance(equation="rate_rad_s", unit="N m", largest_rms=0.2, correlation_s=0.3),
    constants=CONSTANTS,
    slope=_slope,
    guard=_guard,
    switch=_switch,
    begin=_begin,
    actuate=_actuate,
    observe=_observe,
    plan=_plan,
)
