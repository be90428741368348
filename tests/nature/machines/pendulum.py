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


FAMILY = Family(
    name="pendulum",
    dt_s=0.02,
    parameters=(
        Parameter(name="inertia_kg_m2", nominal=0.02, spread=0.04, scatter=0.0, meaning="J about the pivot"),
        Parameter(
            name="gravity_nm",
            nominal=0.75,
            spread=0.03,
            scatter=0.0003,
            meaning="G = mass x gravity x distance of the centre of mass",
        ),
        Parameter(name="viscous_nm_s", nominal=0.015, spread=0.2, scatter=0.005, meaning="b, bearing"),
        Parameter(
            name="drive_gain",
            nominal=1.0,
            spread=0.03,
            scatter=0.002,
            meaning="k, torque per commanded torque",
        ),
    ),
    states=(
        State(name="angle_rad", spread=0.01, scale=0.5),
        State(name="rate_rad_s", spread=0.01, scale=2.0),
    ),
    extra_states=(("lagged_torque_nm", 0.1),),
    channels=(Channel(name="measured_angle_rad", sigma=0.004, quantum=math.tau / 4096),),
    inputs=(InputSignal(name="torque_nm", low=-0.2, high=0.2),),
    catalogue=(
        Effect(
            name="coulomb_friction",
            group="friction",
            formula="J d2a/dt2 gets -coulomb_nm sgn(da/dt); at rest it holds the pendulum "
            "against any torque up to coulomb_nm",
            size={"coulomb_nm": (0.0, 0.1)},
            drawn={},
        ),
        Effect(
            name="stribeck_friction",
            group="friction",
            formula="J d2a/dt2 gets -coulomb_nm (1 + stiction_share exp(-(da/dt / "
            "stribeck_rad_s)^2)) sgn(da/dt); "
            "at rest it holds the pendulum against any torque up to coulomb_nm (1 + stiction_share)",
            size={"coulomb_nm": (0.0, 0.1)},
            drawn={"stiction_share": (0.4, 1.5), "stribeck_rad_s": (0.2, 1.0)},
        ),
        Effect(
            name="quadratic_drag",
            group="drag",
            formula="J d2a/dt2 gets -drag_nm_s2 (da/dt) |da/dt|",
            size={"drag_nm_s2": (0.0, 0.03)},
            drawn={},
        ),
        Effect(
            name="cubic_stiffness",
            group="stiffness",
            formula="J d2a/dt2 gets -stiffness_nm_rad3 a^3",
            size={"stiffness_nm_rad3": (0.0, 0.1)},
            drawn={},
            signed=True,
        ),
        Effect(
            name="actuator_lag",
            group="actuator",
            formula="M becomes m with dm/dt = (M - m)/lag_s; m begins at the first M",
            size={"lag_s": (0.0, 0.4)},
            drawn={},
        ),
        Effect(
            name="input_delay",
            group="actuator",
            formula="M(t) becomes M(t - delay_s); before the start M had its first value",
            size={"delay_s": (0.0, 0.3)},
            drawn={},
        ),
        Effect(
            name="sensor_offset",
            group="sensor",
            formula="the measured angle is a + offset_rad; the conditions give a",
            size={"offset_rad": (0.0, 0.2)},
            drawn={},
            signed=True,
        ),
    ),
    outside=(
        Term(
            name="cubic_damping",
            equation="rate_rad_s",
            variables=("rate_rad_s",),
            shape="cube",
            sign=-1,
            formula="J d2a/dt2 gets -cubic_damping_nm_s3 (da/dt)^3",
            coefficient="cubic_damping_nm_s3",
            largest=0.01,
            drawn={},
        ),
        Term(
            name="second_harmonic",
            equation="rate_rad_s",
            variables=("angle_rad",),
            shape="sine",
            sign=-1,
            formula="J d2a/dt2 gets -second_harmonic_nm sin(2 a)",
            coefficient="second_harmonic_nm",
            largest=0.2,
            drawn={},
        ),
        Term(
            name="angle_damping",
            equation="rate_rad_s",
            variables=("angle_rad", "rate_rad_s"),
            shape="product",
            sign=-1,
            formula="J d2a/dt2 gets -angle_damping_nm_s a^2 (da/dt)",
            coefficient="angle_damping_nm_s",
            largest=0.2,
            drawn={},
        ),
        Term(
            name="soft_bumper",
            equation="rate_rad_s",
            variables=("angle_rad",),
            shape="threshold",
            sign=-1,
            formula="J d2a/dt2 gets -bumper_nm_rad sgn(a) max(|a| - bumper_rad, 0)",
            coefficient="bumper_nm_rad",
            largest=3.0,
            drawn={"bumper_rad": (0.3, 0.6)},
        ),
    ),
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
