"""Effects that may be missing in a gear motor behind a speed loop: one card each. SI units at the motor."""

import math

import numpy as np
from numba import njit

from sim_backends.models.interface import Array, EffectCard, Values, parameter

DATA_SHEET = "Dunkermotoren GR 42x25"
SECONDS_PER_HOUR = 3600.0
COPPER_PER_K = 0.0039
"""Rise of the resistance of copper with temperature."""


@njit(cache=True)
def dry_friction_nm(
    speed: float, direction: float, torque: float, excess: float, fall: float, forward: float
) -> float:
    """Return the friction torque that does not vanish at rest, a magnitude.

    Args:
        speed: Of the motor, rad/s.
        direction: +1 or -1, of the motion or of what pushes.
        torque: By `coulomb_friction`.
        excess: By `stribeck_friction`.
        fall: Speed at which the excess has fallen to 1/e, rad/s.
        forward: By `asymmetric_friction`.
    """
    dry = float(torque + excess * math.exp(-abs(speed) / fall))
    return dry + max(0.0, direction * float(forward))


def supply_share(values: Values, t_s: Array, others_current_a: Array, supply_v: float) -> Array:
    """Return the share of its nominal voltage that the supply gives, by `battery_sag`."""
    charge_ah = np.concatenate(([0.0], np.cumsum(others_current_a[:-1] * np.diff(t_s)))) / SECONDS_PER_HOUR
    share: Array = 1.0 - (values["per_amp"] * others_current_a + values["per_charge"] * charge_ah) / supply_v
    return np.maximum(share, 0.0)


@njit(cache=True)
def bridge_voltage_v(output: float, share: float, dropped: float) -> float:
    """Return the voltage at the motor: an output, times the share of the supply, less that of `dead_zone`."""
    return math.copysign(max(abs(output) * share - dropped, 0.0), output)


EFFECTS = (
    EffectCard(
        name="coulomb_friction",
        sentence="Dry friction in bearings, brushes and gear brakes the motor with a torque independent "
        "of its speed.",
        place="torque balance of the rotor",
        parameters=(parameter("torque", "N m", 0.0, 0.01, 0.0, 0.2, "friction torque at the motor"),),
        claims=(
            "brakes in both directions",
            "raises the current by the same amount at every speed",
            "holds the motor at rest against small drives",
        ),
        experiment="slow ramps of the set-point through zero in both directions",
        source=f"Coulomb's law; no-load current of {DATA_SHEET}",
    ),
    EffectCard(
        name="viscous_friction",
        sentence="Grease and windage brake the motor with a torque in proportion to its speed.",
        place="torque balance of the rotor",
        parameters=(
            parameter("per_speed", "N m s/rad", 0.0, 2e-5, 0.0, 1e-3, "friction torque per motor speed"),
        ),
        claims=("brakes in both directions", "current grows in proportion to speed", "zero at rest"),
        experiment="two steady speeds far apart",
        source="Newtonian lubricant",
    ),
    EffectCard(
        name="stribeck_friction",
        sentence="Before a lubricant film has formed friction is higher: it falls from "
        "breakaway as speed grows.",
        place="torque balance of the rotor",
        parameters=(
            parameter("excess", "N m", 0.0, 0.005, 0.0, 0.1, "breakaway torque above dry friction"),
            parameter("speed", "rad/s", 20.0, 10.0, 1.0, 60.0, "motor speed at which it has fallen to 1/e"),
        ),
        shape_grid={"speed": (10.0, 40.0)},
        claims=("brakes in both directions", "gone at high speed", "greatest just above rest"),
        experiment="steady speeds from just above rest",
        source="Stribeck curve, exponential form (Armstrong-Helouvry 1991)",
    ),
    EffectCard(
        name="asymmetric_friction",
        sentence="Brushes or gear brake more in one direction than in the other.",
        place="torque balance of the rotor",
        parameters=(
            parameter("excess", "N m", 0.0, 0.003, -0.1, 0.1, "more friction forwards; negative: backwards"),
        ),
        claims=("in one direction only", "does not depend on speed"),
        experiment="the same speeds in both directions",
        source="brush angle, helical gears",
    ),
    EffectCard(
        name="winding_heat",
        sentence="Current heats the winding, and warm copper resists more.",
        place="resistance of the winding",
        parameters=(
            parameter("per_watt", "K/W", 0.0, 6.0, 0.0, 60.0, "thermal resistance from winding to air"),
            parameter("time", "s", 120.0, 100.0, 5.0, 2000.0, "time constant of the winding"),
        ),
        shape_grid={"time": (30.0, 300.0)},
        claims=(
            "grows with the integral of the squared current, and stays after it",
            "each motor by its own load",
            "weak where a stiff loop holds the speed and the voltage is not measured",
        ),
        experiment="measure the voltage; idle, load, idle again",
        source="copper 0.39 %/K; first-order thermal network",
    ),
    EffectCard(
        name="battery_sag",
        sentence="The supply gives less voltage as more current is drawn from it, and as it empties.",
        place="supply",
        parameters=(
            parameter("per_amp", "ohm", 0.0, 0.2, 0.0, 5.0, "inner resistance of the supply"),
            parameter("per_charge", "V/(A h)", 0.0, 0.5, 0.0, 20.0, "voltage lost per charge drawn"),
        ),
        claims=("follows the current of all motors together", "common to all motors"),
        experiment="load one motor and look at another",
        source="lead battery as voltage source with inner resistance",
    ),
    EffectCard(
        name="loop_delay",
        sentence="A set-point acts later than its turn in the cycle: bus and board take time.",
        place="clock of the set-point",
        parameters=(parameter("time", "s", 0.0, 0.05, 0.0, 0.5, "from its turn in the cycle to its effect"),),
        claims=("shows only where the set-point changes", "the same for every size and sign of change"),
        experiment="steps of the set-point, far apart",
        source="serial bus of the board, cycle of the host",
    ),
    EffectCard(
        name="back_emf",
        sentence="The motor's constant, voltage per speed and torque per current, is not that "
        "of the data sheet.",
        place="circuit and torque of the motor",
        parameters=(parameter("change", "V s/rad", 0.0, 0.003, -0.015, 0.015, "added to the constant"),),
        claims=(
            "speed changes by one factor where the voltage is given",
            "friction currents change by its inverse",
        ),
        experiment="turn the motor from outside and measure its voltage",
        source=f"{DATA_SHEET}; magnets differ and age",
        releases="motor_constant_v_s_rad",
    ),
    EffectCard(
        name="winding_resistance",
        sentence="The winding with its leads and brushes has another resistance than in the data sheet.",
        place="circuit of the motor",
        parameters=(parameter("change", "ohm", 0.0, 0.6, -1.5, 3.0, "added to the resistance"),),
        claims=(
            "the same from the first second on",
            "speed under load and friction changes, idle speed does not",
        ),
        experiment="current of the held motor at a small voltage",
        source=f"{DATA_SHEET} 5.95 ohm; 5.34 ohm identified by the authors of the measured runs",
        releases="resistance_ohm",
    ),
    EffectCard(
        name="load_inertia",
        sentence="The motor accelerates more than its rotor: gear, wheel, and a share of the rover.",
        place="torque balance of the rotor",
        parameters=(parameter("change", "kg m2", 0.0, 1e-5, 0.0, 1e-2, "added to the inertia at the motor"),),
        claims=("shows only while the speed changes", "current peaks in proportion to acceleration"),
        experiment="steps of the set-point with the wheel free and with the rover on the ground",
        source="rigid bodies behind a gear",
        releases="inertia_kg_m2",
    ),
    EffectCard(
        name="loop_stiffness",
        sentence="The speed loop is tuned otherwise: it adds other volts per speed error.",
        place="speed loop",
        parameters=(parameter("change", "V s/rad", 0.0, 0.15, -0.3, 4.0, "added to the stiffness"),),
        claims=("the speed droops more or less under the same friction",),
        experiment="read the tuning from the board",
        source="proportional loop of the board",
        releases="stiffness_v_s_rad",
    ),
    EffectCard(
        name="dead_zone",
        sentence="The bridge drops some voltage in both directions, so that small outputs do nothing.",
        place="motor voltage",
        parameters=(parameter("voltage", "V", 0.0, 0.5, 0.0, 5.0, "lost by the bridge"),),
        claims=("like dry friction for the speed, but draws no current",),
        experiment="idle current at rest under a small output",
        source="saturation voltage of an H-bridge",
    ),
    EffectCard(
        name="current_offset",
        sentence="The current sensor shows some current where none flows.",
        place="current sensor",
        parameters=(parameter("offset", "A", 0.0, 0.03, -0.2, 0.2, "added to every reading"),),
        claims=("the same at rest and at every speed", "the speed does not change"),
        experiment="log at rest",
        source="offset of an amplifier",
    ),
)
