"""The equations of motion, compiled: motors, speed loops, contacts and body.

Each step is linearly implicit. A force that opposes a speed (traction, resistance) is written as coefficient
times the new speed, the coefficient taken at the old state. Such a step is exact at rest and in steady state,
can only dissipate, and stays stable where a stiff contact would need steps of microseconds. Eliminating the
wheels leaves three equations for the body.

All compiled functions are in this file: numba's cache does not detect changes in another.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backends.arrays import Array
from sim_backends.jit import compiled
from sim_backends.plants.rigid_body import momentum_over_step, solve
from sim_backends.plants.robotino.ground import Ground

BRIDGE_COUNTS = 255.0
CREEP_M_S = 0.001
"""Below this speed resistance and traction decrease to zero instead of changing sign abruptly."""

SLIP_FLOOR_M_S = 0.02
"""Slip decreases to 0 where rim and ground are both slower: 1 - v / (r omega) is undefined at rest."""

_compiled = compiled()


class Rover(NamedTuple):
    """Constants; motor quantities are referred to the wheel.

    Attributes:
        steps_per_control: Steps in a period of the speed loop.
        direction, radial: Rolling direction and axle of each wheel, rows (x, y, lever arm of yaw).
        load_n: Load on each wheel.
        deeper: By how much its load presses each wheel deeper into soft ground than the mean load.
        mass: Inertia matrix about the rover's centre.
        current_step: Share of the difference to its final value by which the current changes in one step.
        tick_rad: Encoder tick at the wheel.
    """

    step_s: float
    steps_per_control: int
    direction: Array
    radial: Array
    load_n: Array
    deeper: Array
    mass: Array
    radius_m: float
    wheel_inertia_kg_m2: float
    resistance_ohm: float
    current_step: float
    torque_nm_per_a: float
    back_emf_v_s: float
    friction_nm: float
    breakaway_nm: float
    viscous_nm_s: float
    gear_efficiency: float
    tick_rad: float
    gain: float
    battery_v: float
    battery_resistance_ohm: float
    idle_current_a: float


class State(NamedTuple):
    """State variables; arrays are updated in place.

    Attributes:
        pose: x, y, yaw in the world.
        twist: Velocity x, y and yaw rate in the body frame.
        set_ticks: Setpoint of each wheel, ticks per period of the speed loop.
        counted: Ticks of each wheel at the last call of the speed loop.
        supply: Battery voltage.
        step: Number of steps done.
    """

    pose: Array
    twist: Array
    angle_rad: Array
    speed_rad_s: Array
    current_a: Array
    voltage_v: Array
    set_ticks: Array
    counted: Array
    supply: Array
    step: NDArray[np.int64]


class Step(NamedTuple):
    """Memory for the numbers of one step: reserving it in each step would take half of the time.

    Attributes:
        grip: Traction per sliding speed at each wheel, N s/m.
        along, across: Resistance per speed along the wheel and along its axle, N s/m.
        sign: Sign of the motion that friction opposes; 0 for a wheel that stays at rest.
        free, follow: The new wheel speed is free + follow * speed of the contact along the wheel.
        matrix, right: Equations for the new twist.
    """

    grip: Array
    along: Array
    across: Array
    sign: Array
    free: Array
    follow: Array
    matrix: Array
    right: Array


@_compiled
def advance(state: State, rover: Rover, ground: Ground, steps: int) -> None:
    """Integrate a number of steps."""
    step = Step(
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty((3, 3)),
        np.empty(3),
    )
    for _ in range(steps):
        if state.step[0] % rover.steps_per_control == 0:
            _control_speed(state, rover)
        _contact_coefficients(state, rover, ground, step.grip, step.along, step.across)
        _step_body(state, rover, step)
        state.step[0] += 1


class Observed(NamedTuple):
    """What can be seen of the rover at an instant, as plain numbers; tuples hold one per wheel."""

    pose: tuple[float, float, float]
    twist: tuple[float, float, float]
    position_rad: tuple[float, float, float]
    speed_rad_s: tuple[float, float, float]
    current_a: tuple[float, float, float]
    slip: tuple[float, float, float]
    supply_v: float


@_compiled
def observe(state: State, rover: Rover, encoder_zeros: Array, since_s: float) -> Observed:
    """Return the state `since_s` after the last step, extrapolated at constant speed."""
    x, y, yaw = state.pose
    forward, left, turn = state.twist
    cos_yaw = math.cos(yaw)
    sin_yaw = math.sin(yaw)
    return Observed(
        (
            x + since_s * (cos_yaw * forward - sin_yaw * left),
            y + since_s * (sin_yaw * forward + cos_yaw * left),
            yaw + since_s * turn,
        ),
        (forward, left, turn),
        (
            _position(state, encoder_zeros, 0, since_s),
            _position(state, encoder_zeros, 1, since_s),
            _position(state, encoder_zeros, 2, since_s),
        ),
        (state.speed_rad_s[0], state.speed_rad_s[1], state.speed_rad_s[2]),
        (state.current_a[0], state.current_a[1], state.current_a[2]),
        (_slip(state, rover, 0), _slip(state, rover, 1), _slip(state, rover, 2)),
        state.supply[0],
    )


@_compiled
def _position(state: State, encoder_zeros: Array, wheel: int, since_s: float) -> float:
    position: float = state.angle_rad[wheel] - encoder_zeros[wheel] + since_s * state.speed_rad_s[wheel]
    return position


@_compiled
def _slip(state: State, rover: Rover, wheel: int) -> float:
    return slip_ratio(rover.radius_m * state.speed_rad_s[wheel], _dot(rover.direction, wheel, state.twist))


@_compiled
def slip_ratio(rim_m_s: float, ground_m_s: float) -> float:
    """Return 1 - v / (r omega) of a driving wheel, between 0 and 1; negative to -1 of a braking one.

    The divisor is the faster of the two speeds, at least `SLIP_FLOOR_M_S`.
    """
    forward = rim_m_s if abs(rim_m_s) >= abs(ground_m_s) else ground_m_s
    difference = rim_m_s - ground_m_s
    slip = math.copysign(difference, difference * forward)
    return min(max(slip / max(abs(forward), SLIP_FLOOR_M_S), -1.0), 1.0)


@_compiled
def _control_speed(state: State, rover: Rover) -> None:
    """Set each bridge from the ticks counted since the last call, and the battery voltage from the load."""
    power_w = 0.0
    for wheel in range(3):
        power_w += state.voltage_v[wheel] * state.current_a[wheel]
    supply_v = rover.battery_v - rover.battery_resistance_ohm * (
        rover.idle_current_a + max(power_w, 0.0) / rover.battery_v
    )
    state.supply[0] = supply_v
    for wheel in range(3):
        ticks = math.floor(state.angle_rad[wheel] / rover.tick_rad)
        measured = ticks - state.counted[wheel]
        state.counted[wheel] = ticks
        set_point = state.set_ticks[wheel]
        counts = set_point + rover.gain * (set_point - measured)
        counts = min(max(counts, -BRIDGE_COUNTS), BRIDGE_COUNTS)
        state.voltage_v[wheel] = supply_v * counts / BRIDGE_COUNTS


@_compiled
def _contact_coefficients(
    state: State, rover: Rover, ground: Ground, grip: Array, along: Array, across: Array
) -> None:
    """Compute traction per sliding speed and resistance per speed, N s/m, at each wheel's contact.

    Traction over load follows s' / sqrt(1 + s'^2) with s' = stiffness * slip / friction. The slip is the
    sliding speed over the speed at which the contact passes over the ground, sideways motion included: the
    rate at which unstrained fibres enter the contact.
    """
    cos_yaw = math.cos(state.pose[2])
    sin_yaw = math.sin(state.pose[2])
    for wheel in range(3):
        row, roughness = _ground_under(state, rover, ground, wheel, cos_yaw, sin_yaw)
        friction = ground.rows[row, 0]
        stiffness = ground.rows[row, 1]
        load = rover.load_n[wheel]
        deeper = rover.deeper[wheel]
        rolling = _dot(rover.direction, wheel, state.twist)
        sideways = _dot(rover.radial, wheel, state.twist)
        rim = rover.radius_m * state.speed_rad_s[wheel]
        passing = math.sqrt(rim * rim + sideways * sideways + CREEP_M_S * CREEP_M_S)
        strain = stiffness * (rim - rolling) / (friction * passing)
        grip[wheel] = load * stiffness / (passing * math.sqrt(1.0 + strain * strain))
        speed = math.sqrt(rolling * rolling + sideways * sideways + CREEP_M_S * CREEP_M_S)
        along[wheel] = load * roughness * (ground.rows[row, 2] + ground.rows[row, 4] * deeper) / speed
        across[wheel] = load * roughness * (ground.rows[row, 3] + ground.rows[row, 5] * deeper) / speed


@_compiled
def _ground_under(
    state: State, rover: Rover, ground: Ground, wheel: int, cos_yaw: float, sin_yaw: float
) -> tuple[int, float]:
    """Return the row of the table of grounds and the roughness at a wheel's contact point."""
    arm = rover.direction[wheel, 2]  # the wheel's distance; its axle points away from the centre
    x = rover.radial[wheel, 0] * arm
    y = rover.radial[wheel, 1] * arm
    contact_x = state.pose[0] + cos_yaw * x - sin_yaw * y
    contact_y = state.pose[1] + sin_yaw * x + cos_yaw * y
    column = math.floor((contact_x - ground.x_min_m) * ground.cells_per_m)
    line = math.floor((contact_y - ground.y_min_m) * ground.cells_per_m)
    if 0 <= column < ground.row.shape[0] and 0 <= line < ground.row.shape[1]:
        return int(ground.row[column, line]), float(ground.roughness[column, line])
    return 0, 1.0


@_compiled
def _step_body(state: State, rover: Rover, step: Step) -> None:
    """Integrate motors, wheels and body over one step."""
    step_s, radius_m = rover.step_s, rover.radius_m
    matrix, right = step.matrix, step.right
    for i in range(3):
        for j in range(3):
            matrix[i, j] = rover.mass[i, j] / step_s
    momentum_over_step(state.twist, rover.mass, step_s, right)
    for wheel in range(3):
        grip = step.grip[wheel]
        torque_nm = _motor_torque(state, rover, wheel)
        sign = _friction_sign(state, rover, wheel, torque_nm, grip)
        free = follow = 0.0
        if sign != 0.0:
            held = rover.wheel_inertia_kg_m2 + step_s * radius_m * radius_m * grip
            pushed = step_s * (torque_nm - sign * rover.friction_nm)
            free = (rover.wheel_inertia_kg_m2 * state.speed_rad_s[wheel] + pushed) / held
            follow = step_s * radius_m * grip / held
        step.sign[wheel], step.free[wheel], step.follow[wheel] = sign, free, follow
        drag = grip * (1.0 - radius_m * follow) + step.along[wheel]
        for i in range(3):
            ahead = rover.direction[wheel, i]
            aside = rover.radial[wheel, i]
            right[i] += ahead * grip * radius_m * free
            for j in range(3):
                matrix[i, j] += (
                    ahead * rover.direction[wheel, j] * drag
                    + aside * rover.radial[wheel, j] * step.across[wheel]
                )
    solve(matrix, right, state.twist)
    for wheel in range(3):
        speed = step.free[wheel] + step.follow[wheel] * _dot(rover.direction, wheel, state.twist)
        if speed * step.sign[wheel] < 0.0:
            speed = 0.0  # friction stops a wheel but does not reverse it
        state.speed_rad_s[wheel] = speed
        state.angle_rad[wheel] += step_s * speed
    _integrate_pose(state, step_s)


@_compiled
def _integrate_pose(state: State, step_s: float) -> None:
    """Integrate the pose, along the heading in the middle of the step."""
    middle_yaw = state.pose[2] + 0.5 * step_s * state.twist[2]
    cos_yaw = math.cos(middle_yaw)
    sin_yaw = math.sin(middle_yaw)
    state.pose[0] += step_s * (cos_yaw * state.twist[0] - sin_yaw * state.twist[1])
    state.pose[1] += step_s * (sin_yaw * state.twist[0] + cos_yaw * state.twist[1])
    state.pose[2] += step_s * state.twist[2]


@_compiled
def _motor_torque(state: State, rover: Rover, wheel: int) -> float:
    """Integrate the current and return the torque at the gear's output, without Coulomb friction."""
    speed = state.speed_rad_s[wheel]
    final_a = (state.voltage_v[wheel] - rover.back_emf_v_s * speed) / rover.resistance_ohm
    state.current_a[wheel] += rover.current_step * (final_a - state.current_a[wheel])
    torque_nm: float = rover.torque_nm_per_a * state.current_a[wheel] - rover.viscous_nm_s * speed
    if torque_nm * speed >= 0.0:
        return torque_nm * rover.gear_efficiency
    return torque_nm / rover.gear_efficiency


@_compiled
def _friction_sign(state: State, rover: Rover, wheel: int, torque_nm: float, grip: float) -> float:
    """Return the sign of motion that Coulomb friction opposes; 0 where the wheel stays at rest."""
    speed = state.speed_rad_s[wheel]
    if speed == 0.0:
        pull = torque_nm + rover.radius_m * grip * _dot(rover.direction, wheel, state.twist)
        if abs(pull) <= rover.breakaway_nm:
            return 0.0
        return math.copysign(1.0, pull)
    return math.copysign(1.0, speed)


@_compiled
def _dot(rows: Array, row: int, vector: Array) -> float:
    product: float = rows[row, 0] * vector[0] + rows[row, 1] * vector[1] + rows[row, 2] * vector[2]
    return product
