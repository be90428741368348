"""The equations of motion of a rover on any set of wheels, compiled: motors, servos, contacts, body.

Newton and Euler in the body frame, with its origin as reference point. Each wheel's contact material slides
over the ground with u = v_contact - r omega d, d its rolling direction. The ground answers with the force
F = -(c_1 e_1 e_1' + c_2 e_2 e_2') u: for an ordinary wheel e_1 = d, e_2 = its axle and both coefficients are
those of traction; for a wheel with rollers e_1 lies along the roller's axle (traction) and e_2 across it (the
drag of the turning roller). The same force brakes the wheel with the torque r d.F.

Each step is linearly implicit in body velocity and wheel speeds, with the coefficients of the old state: such
a step cannot gain energy and is stable for stiff contacts. All compiled functions are in this file: numba's
cache does not detect changes in another.
"""

import math
from typing import NamedTuple

import numpy as np

from sim_backends.arrays import Array
from sim_backends.jit import compiled
from sim_backends.plants.rigid_body import momentum_over_step, solve
from sim_backends.plants.robotino.ground import Ground

CREEP_M_S = 0.001
"""Below this speed traction and resistance decrease to zero instead of changing sign abruptly."""
CREEP_RAD_S = 0.02

_compiled = compiled()


class Rover(NamedTuple):
    """Constants; the wheels come first, then the castors.

    Attributes:
        place: x, y of each contact.
        angle: Rolling direction of each wheel at steering angle 0.
        roller: Angle from the axle to the roller's axle; NaN without rollers.
        driven: 1 where a motor turns the wheel.
        low, high, rate: Limits and speed of the steering.
        load_n: Load on each contact.
        mean_load_n: Mean of the loads on wheels.
        mass: Inertia matrix about the origin.
        castor_drag: Resistance per load of each castor.
    """

    step_s: float
    place: Array
    angle: Array
    roller: Array
    driven: Array
    low: Array
    high: Array
    rate: Array
    radius_m: Array
    load_n: Array
    mean_load_n: float
    mass: Array
    wheel_inertia_kg_m2: float
    friction_nm: float
    stall_nm: Array
    no_load_rad_s: Array
    speed_gain: float
    integral_per_s: float
    castor_drag: Array


class State(NamedTuple):
    """State variables; arrays are updated in place.

    Attributes:
        pose: x, y, yaw in the world.
        twist: Velocity x, y and yaw rate in the body frame.
        duty: Bridge voltage over that of the supply, -1 to 1.
        integral: Integral part of the duty.
    """

    pose: Array
    twist: Array
    angle_rad: Array
    speed_rad_s: Array
    steer_rad: Array
    duty: Array
    integral: Array
    set_rad_s: Array
    set_steer_rad: Array


@_compiled
def advance(state: State, rover: Rover, ground: Ground, steps: int) -> None:
    """Integrate a number of steps."""
    count = len(rover.angle)
    direction = np.empty((count, 2))
    grip = np.empty((count, 3))
    resistance = np.empty(count)
    for _ in range(steps):
        _steer(state, rover)
        _contacts(state, rover, ground, direction, grip, resistance)
        _step_body(state, rover, direction, grip, resistance)


@_compiled
def _steer(state: State, rover: Rover) -> None:
    for wheel in range(len(rover.angle)):
        target = min(max(state.set_steer_rad[wheel], rover.low[wheel]), rover.high[wheel])
        most = rover.rate[wheel] * rover.step_s
        state.steer_rad[wheel] += min(max(target - state.steer_rad[wheel], -most), most)


@_compiled
def _contacts(
    state: State, rover: Rover, ground: Ground, direction: Array, grip: Array, resistance: Array
) -> None:
    """Compute rolling direction, the matrix of force per sliding speed (xx, xy, yy), and rolling resistance.

    Traction over load follows s' / sqrt(1 + s'^2) with s' = stiffness * slip / friction, as a vector for an
    ordinary wheel: traction and side force share one friction circle. The slip is the sliding speed over the
    speed at which unstrained material enters the contact.
    """
    cos_yaw = math.cos(state.pose[2])
    sin_yaw = math.sin(state.pose[2])
    for wheel in range(len(rover.angle)):
        along = rover.angle[wheel] + state.steer_rad[wheel]
        dx = math.cos(along)
        dy = math.sin(along)
        direction[wheel, 0] = dx
        direction[wheel, 1] = dy
        row, roughness = _ground_under(state, rover, ground, wheel, cos_yaw, sin_yaw)
        friction = ground.rows[row, 0]
        stiffness = ground.rows[row, 1]
        load = rover.load_n[wheel]
        deeper = math.pow(load / rover.mean_load_n, 1.0 / 3.0)
        vx = state.twist[0] - state.twist[2] * rover.place[wheel, 1]
        vy = state.twist[1] + state.twist[2] * rover.place[wheel, 0]
        rim = rover.radius_m[wheel] * state.speed_rad_s[wheel]
        ux = vx - rim * dx
        uy = vy - rim * dy
        ahead = dx * vx + dy * vy
        drag_along = roughness * (ground.rows[row, 2] + ground.rows[row, 4] * deeper)
        if math.isnan(rover.roller[wheel]):
            passing = math.sqrt(rim * rim + CREEP_M_S * CREEP_M_S)
            passing = max(passing, math.sqrt(vx * vx + vy * vy))
            strain = stiffness * math.sqrt(ux * ux + uy * uy) / (friction * passing)
            traction = load * stiffness / (passing * math.sqrt(1.0 + strain * strain))
            grip[wheel, 0] = traction
            grip[wheel, 1] = 0.0
            grip[wheel, 2] = traction
        else:
            axle = along + 0.5 * math.pi + rover.roller[wheel]
            ex = math.cos(axle)
            ey = math.sin(axle)
            aside = -ey * vx + ex * vy
            passing = math.sqrt(rim * rim + aside * aside + CREEP_M_S * CREEP_M_S)
            strain = stiffness * (ex * ux + ey * uy) / (friction * passing)
            traction = load * stiffness / (passing * math.sqrt(1.0 + strain * strain))
            across_speed = -ey * ux + ex * uy
            drag = ground.rows[row, 3] + ground.rows[row, 5] * deeper
            across = load * roughness * drag / math.sqrt(across_speed * across_speed + CREEP_M_S * CREEP_M_S)
            grip[wheel, 0] = traction * ex * ex + across * ey * ey
            grip[wheel, 1] = (traction - across) * ex * ey
            grip[wheel, 2] = traction * ey * ey + across * ex * ex
        # The ground resists the passing of the wheel: a force on the body along the wheel.
        resistance[wheel] = load * drag_along / math.sqrt(ahead * ahead + CREEP_M_S * CREEP_M_S)


@_compiled
def _ground_under(
    state: State, rover: Rover, ground: Ground, wheel: int, cos_yaw: float, sin_yaw: float
) -> tuple[int, float]:
    """Return the row of the table of grounds and the roughness at a wheel's contact point."""
    contact_x = state.pose[0] + cos_yaw * rover.place[wheel, 0] - sin_yaw * rover.place[wheel, 1]
    contact_y = state.pose[1] + sin_yaw * rover.place[wheel, 0] + cos_yaw * rover.place[wheel, 1]
    column = math.floor((contact_x - ground.x_min_m) * ground.cells_per_m)
    line = math.floor((contact_y - ground.y_min_m) * ground.cells_per_m)
    if 0 <= column < ground.row.shape[0] and 0 <= line < ground.row.shape[1]:
        return int(ground.row[column, line]), float(ground.roughness[column, line])
    return 0, 1.0


@_compiled
def _step_body(state: State, rover: Rover, direction: Array, grip: Array, resistance: Array) -> None:
    """Integrate motors, wheels and body over one step; eliminating the wheels leaves three equations."""
    step_s = rover.step_s
    count = len(rover.angle)
    free = np.empty(count)
    follow = np.empty((count, 2))
    matrix = rover.mass / step_s
    right = np.empty(3)
    momentum_over_step(state.twist, rover.mass, step_s, right)
    for wheel in range(count):
        radius = rover.radius_m[wheel]
        dx = direction[wheel, 0]
        dy = direction[wheel, 1]
        torque, braking = _motor(state, rover, wheel)
        # The wheel's force per sliding speed along its rolling direction.
        gx = grip[wheel, 0] * dx + grip[wheel, 1] * dy
        gy = grip[wheel, 1] * dx + grip[wheel, 2] * dy
        speed = state.speed_rad_s[wheel]
        braking += rover.friction_nm / math.sqrt(speed * speed + CREEP_RAD_S * CREEP_RAD_S)
        held = rover.wheel_inertia_kg_m2 / step_s + braking + radius * radius * (dx * gx + dy * gy)
        free[wheel] = (rover.wheel_inertia_kg_m2 * speed / step_s + torque) / held
        follow[wheel, 0] = radius * gx / held
        follow[wheel, 1] = radius * gy / held
        # Force on the body: -(grip + resistance d d') v + grip d r omega.
        xx = grip[wheel, 0] - radius * gx * follow[wheel, 0] + resistance[wheel] * dx * dx
        xy = grip[wheel, 1] - radius * gx * follow[wheel, 1] + resistance[wheel] * dx * dy
        yy = grip[wheel, 2] - radius * gy * follow[wheel, 1] + resistance[wheel] * dy * dy
        _add_force(matrix, rover.place[wheel, 0], rover.place[wheel, 1], xx, xy, yy)
        push_x = radius * free[wheel] * gx
        push_y = radius * free[wheel] * gy
        right[0] += push_x
        right[1] += push_y
        right[2] += rover.place[wheel, 0] * push_y - rover.place[wheel, 1] * push_x
    _add_castors(state, rover, matrix)
    solve(matrix, right, state.twist)
    for wheel in range(count):
        vx = state.twist[0] - state.twist[2] * rover.place[wheel, 1]
        vy = state.twist[1] + state.twist[2] * rover.place[wheel, 0]
        state.speed_rad_s[wheel] = free[wheel] + follow[wheel, 0] * vx + follow[wheel, 1] * vy
        state.angle_rad[wheel] += step_s * state.speed_rad_s[wheel]
    middle_yaw = state.pose[2] + 0.5 * step_s * state.twist[2]
    state.pose[0] += step_s * (math.cos(middle_yaw) * state.twist[0] - math.sin(middle_yaw) * state.twist[1])
    state.pose[1] += step_s * (math.sin(middle_yaw) * state.twist[0] + math.cos(middle_yaw) * state.twist[1])
    state.pose[2] += step_s * state.twist[2]


@_compiled
def _motor(state: State, rover: Rover, wheel: int) -> tuple[float, float]:
    """Run a speed loop; return the motor's torque as constant part and braking torque per speed.

    Torque-speed line: torque = stall torque (duty - speed / no-load speed).
    """
    if rover.driven[wheel] == 0.0:
        return 0.0, 0.0
    stall = rover.stall_nm[wheel]
    set_point = state.set_rad_s[wheel]
    error = set_point - state.speed_rad_s[wheel]
    fixed = set_point / rover.no_load_rad_s[wheel] + state.integral[wheel]
    duty = fixed + rover.speed_gain * error
    state.duty[wheel] = min(max(duty, -1.0), 1.0)
    back_emf = stall / rover.no_load_rad_s[wheel]
    if abs(duty) >= 1.0:
        return stall * state.duty[wheel], back_emf
    # The integral stops while the bridge is at its limit.
    state.integral[wheel] += rover.speed_gain * rover.integral_per_s * error * rover.step_s
    return stall * (fixed + rover.speed_gain * set_point), back_emf + stall * rover.speed_gain


@_compiled
def _add_castors(state: State, rover: Rover, matrix: Array) -> None:
    wheels = len(rover.angle)
    for index in range(len(rover.castor_drag)):
        x = rover.place[wheels + index, 0]
        y = rover.place[wheels + index, 1]
        vx = state.twist[0] - state.twist[2] * y
        vy = state.twist[1] + state.twist[2] * x
        speed = math.sqrt(vx * vx + vy * vy + CREEP_M_S * CREEP_M_S)
        drag = rover.load_n[wheels + index] * rover.castor_drag[index] / speed
        _add_force(matrix, x, y, drag, 0.0, drag)


@_compiled
def _add_force(matrix: Array, x: float, y: float, xx: float, xy: float, yy: float) -> None:
    """Add a force -(xx xy; xy yy) v at a contact point to the matrix of the body."""
    matrix[0, 0] += xx
    matrix[0, 1] += xy
    matrix[1, 0] += xy
    matrix[1, 1] += yy
    turn_x = -y * xx + x * xy
    turn_y = -y * xy + x * yy
    matrix[0, 2] += turn_x
    matrix[2, 0] += turn_x
    matrix[1, 2] += turn_y
    matrix[2, 1] += turn_y
    matrix[2, 2] += -y * turn_x + x * turn_y
