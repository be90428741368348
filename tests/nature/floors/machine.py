"""What is the same rover on every floor: rigid body, motors, the board's speed loop and the battery.

The contact laws are not here: each nature has its own, in its own file. All compiled functions take and
return SI units.

Sources: rigid body by Newton and Euler about the centre of mass; Coulomb friction of the gear by the implicit
time step of Moreau (1999), "Numerical aspects of the sweeping process", which can only brake; board loop as
described for the Robotino's EA09 board by Festo (count of encoder ticks per period, proportional-integral,
8-bit duty).
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "BOARD_RATE_HZ",
    "GRAVITY_M_S2",
    "NANOSECONDS",
    "OMNI_ANGLE_RAD",
    "Floats",
    "Machine",
    "add_body_force",
    "board_voltage",
    "centre_motion",
    "draw_machine",
    "gear_loss",
    "motor_current",
    "move_body",
    "static_load",
    "supply_voltage",
    "wheel_speed",
]

Floats = NDArray[np.float64]

GRAVITY_M_S2: Final = 9.81
NANOSECONDS: Final = 1_000_000_000
BOARD_RATE_HZ: Final = 900
OMNI_ANGLE_RAD: Final = (math.pi / 3.0, math.pi, 5.0 * math.pi / 3.0)

_DUTY_LEVELS: Final = 255.0
"""Duty is an 8-bit number: so the smallest change of voltage is about 0.1 V."""


class Machine(NamedTuple):
    """True constants of one rover, a little off the data sheets.

    Attributes:
        yaw_inertia_kg_m2: About the centre of mass.
        com_x_m: Centre of mass ahead of the rover's centre.
        com_y_m: Centre of mass to the left of the rover's centre.
        com_height_m: Centre of mass above the ground.
        radius_m: Mean rolling radius.
        arm_m: From the rover's centre to a wheel; for two wheels half the track.
        back_emf_v_s: Per rad/s of the motor.
        rotor_inertia_kg_m2: At the motor, of rotor, gear and wheel together.
        friction_nm: Coulomb friction at the motor, of brushes and gear without load.
        gear_efficiency: Of a gear that carries a load.
        tick_rad: Encoder step, in radians of the wheel.
        gain_p_v_s: Volts per rad/s of the wheel.
        gain_i_v: Volts per rad of the wheel.
        current_limit_a: The board's output stage gives no more.
        delay_s: From a setpoint sent to its effect.
    """

    mass_kg: float
    yaw_inertia_kg_m2: float
    com_x_m: float
    com_y_m: float
    com_height_m: float
    radius_m: float
    arm_m: float
    resistance_ohm: float
    inductance_h: float
    torque_nm_a: float
    back_emf_v_s: float
    rotor_inertia_kg_m2: float
    friction_nm: float
    gear_ratio: float
    gear_efficiency: float
    battery_v: float
    battery_ohm: float
    tick_rad: float
    gain_p_v_s: float
    gain_i_v: float
    current_limit_a: float
    delay_s: float


def draw_machine(
    rng: np.random.Generator,
    *,
    radius_m: float = 0.040,
    arm_m: float = 0.125,
    com_x_m: float = 0.0,
    current_limit_a: float = 3.5,
) -> Machine:
    """Draw one rover: nominal constants, each off by what tolerances, wear and payload make plausible."""

    def near(nominal: float, relative: float) -> float:
        return nominal * (1.0 + relative * float(rng.uniform(-1.0, 1.0)))

    mass_kg = float(rng.uniform(12.0, 13.0))
    offset_x_m = com_x_m + float(rng.uniform(-0.006, 0.006))
    offset_y_m = float(rng.uniform(-0.006, 0.006))
    inertia = float(rng.uniform(0.20, 0.25)) - mass_kg * (offset_x_m**2 + offset_y_m**2)
    return Machine(
        mass_kg=mass_kg,
        yaw_inertia_kg_m2=inertia,
        com_x_m=offset_x_m,
        com_y_m=offset_y_m,
        com_height_m=float(rng.uniform(0.08, 0.13)),
        radius_m=near(radius_m, 0.01),
        arm_m=near(arm_m, 0.01),
        resistance_ohm=near(5.3, 0.06),
        inductance_h=near(5e-3, 0.2),
        torque_nm_a=near(0.051, 0.05),
        back_emf_v_s=near(0.050, 0.03),
        rotor_inertia_kg_m2=near(1.04e-5, 0.1),
        friction_nm=near(8e-3, 0.2),
        gear_ratio=16.0,
        gear_efficiency=float(rng.uniform(0.76, 0.84)),
        battery_v=float(rng.uniform(24.4, 26.0)),
        battery_ohm=float(rng.uniform(0.08, 0.2)),
        tick_rad=2.0 * math.pi / (2000.0 * 16.0),
        gain_p_v_s=near(2.0, 0.1),
        gain_i_v=near(40.0, 0.1),
        current_limit_a=current_limit_a,
        delay_s=float(rng.uniform(0.08, 0.10)),
    )


@njit(cache=True)
def board_voltage(
    machine: Machine,
    wheel: int,
    angle_rad: float,
    target_rad_s: float,
    supply_v: float,
    ticks: Floats,
    integral_rad: Floats,
) -> float:
    """Run one period of a motor's speed loop and return the voltage it puts on the motor.

    The board sees whole encoder ticks only, so its speed is coarse by 0.18 rad/s of the wheel.
    """
    count = math.floor(angle_rad / machine.tick_rad)
    measured_rad_s = (count - ticks[wheel]) * machine.tick_rad * BOARD_RATE_HZ
    ticks[wheel] = count
    error_rad_s = target_rad_s - measured_rad_s
    total_rad = integral_rad[wheel] + error_rad_s / BOARD_RATE_HZ
    voltage_v = machine.gain_p_v_s * error_rad_s + machine.gain_i_v * total_rad
    duty = voltage_v / supply_v
    if abs(duty) < 1.0:
        # The sum stands still while the output is at its end: otherwise it would wind up.
        integral_rad[wheel] = total_rad
    duty = min(1.0, max(-1.0, duty))
    return float(round(duty * _DUTY_LEVELS) / _DUTY_LEVELS * supply_v)


@njit(cache=True)
def motor_current(
    machine: Machine, current_a: float, voltage_v: float, speed_rad_s: float, step_s: float
) -> float:
    """Return the current after a step of the winding's equation, implicit and thus stable, then limited."""
    back_v = machine.back_emf_v_s * machine.gear_ratio * speed_rad_s
    gain = step_s / machine.inductance_h
    current_a = (current_a + gain * (voltage_v - back_v)) / (1.0 + gain * machine.resistance_ohm)
    return min(machine.current_limit_a, max(-machine.current_limit_a, current_a))


@njit(cache=True)
def gear_loss(machine: Machine, speed_rad_s: float, load_nm: float) -> float:
    """Return the friction that a loaded gear adds, at the wheel.

    A gear of efficiency e needs load / e to drive and gives back load * e when driven: the same as friction
    of load * (1 / e - 1) or load * (1 - e). As friction it can never drive.
    """
    if load_nm * speed_rad_s >= 0.0:
        return abs(load_nm) * (1.0 / machine.gear_efficiency - 1.0)
    return abs(load_nm) * (1.0 - machine.gear_efficiency)


@njit(cache=True)
def wheel_speed(
    machine: Machine, speed_rad_s: float, current_a: float, load_nm: float, friction_nm: float, step_s: float
) -> float:
    """Return the wheel's speed after a step; friction stops it but never turns it round.

    Args:
        load_nm: Torque of the ground against positive rotation.
        friction_nm: Largest torque of friction, at the wheel.
    """
    inertia = machine.rotor_inertia_kg_m2 * machine.gear_ratio**2
    drive_nm = machine.torque_nm_a * machine.gear_ratio * current_a
    free_rad_s = speed_rad_s + step_s * (drive_nm - load_nm) / inertia
    stop_rad_s = step_s * friction_nm / inertia
    if abs(free_rad_s) <= stop_rad_s:
        return 0.0
    return free_rad_s - math.copysign(stop_rad_s, free_rad_s)


@njit(cache=True)
def supply_voltage(machine: Machine, voltage_v: Floats, current_a: Floats, supply_v: float) -> float:
    """Return the battery's voltage under the power of all motors; it is not charged by braking."""
    power_w = 0.0
    for wheel in range(voltage_v.size):
        power_w += voltage_v[wheel] * current_a[wheel]
    return machine.battery_v - machine.battery_ohm * max(0.0, power_w) / supply_v


@njit(cache=True)
def centre_motion(machine: Machine, body: Floats) -> tuple[float, float, float, float, float]:
    """Return the rover's centre x, y (world) and its velocity in the body frame and yaw rate.

    Args:
        body: x, y, yaw of the centre of mass and their rates, in the world frame.
    """
    cosine, sine = math.cos(body[2]), math.sin(body[2])
    x_m = body[0] - cosine * machine.com_x_m + sine * machine.com_y_m
    y_m = body[1] - sine * machine.com_x_m - cosine * machine.com_y_m
    ahead_m_s = cosine * body[3] + sine * body[4] + body[5] * machine.com_y_m
    left_m_s = -sine * body[3] + cosine * body[4] - body[5] * machine.com_x_m
    return x_m, y_m, ahead_m_s, left_m_s, body[5]


@njit(cache=True)
def add_body_force(
    machine: Machine, wrench: Floats, at_x_m: float, at_y_m: float, force_x_n: float, force_y_n: float
) -> None:
    """Add a force in the body frame, acting at a point from the centre, to force and yaw moment."""
    wrench[0] += force_x_n
    wrench[1] += force_y_n
    wrench[2] += (at_x_m - machine.com_x_m) * force_y_n - (at_y_m - machine.com_y_m) * force_x_n


@njit(cache=True)
def move_body(machine: Machine, body: Floats, wrench: Floats, step_s: float) -> None:
    """Advance the rigid body by one step: first the velocities, then the place with the new velocities."""
    cosine, sine = math.cos(body[2]), math.sin(body[2])
    body[3] += step_s * (cosine * wrench[0] - sine * wrench[1]) / machine.mass_kg
    body[4] += step_s * (sine * wrench[0] + cosine * wrench[1]) / machine.mass_kg
    body[5] += step_s * wrench[2] / machine.yaw_inertia_kg_m2
    body[0] += step_s * body[3]
    body[1] += step_s * body[4]
    body[2] += step_s * body[5]


@njit(cache=True)
def static_load(
    machine: Machine, at_x_m: float, at_y_m: float, moment_x_m: float, moment_y_m: float
) -> float:
    """Return the load on one of three wheels spaced by 120 degrees.

    Sum of loads = weight and sum of load times place = weight times `moment`; with three wheels on a circle
    sum(p p') = 1.5 arm^2, which gives the closed form.

    Args:
        moment_x_m: Where the weight acts, ahead of the centre.
        moment_y_m: Where the weight acts, left of the centre.
    """
    weight_n = machine.mass_kg * GRAVITY_M_S2
    lever = (at_x_m * moment_x_m + at_y_m * moment_y_m) * 2.0 / machine.arm_m**2
    return max(0.0, weight_n / 3.0 * (1.0 + lever))
