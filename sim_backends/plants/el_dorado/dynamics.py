"""The rover's equations of motion, compiled.

A step is linearly implicit: it includes the derivative of the forces by the body's velocity, computed by
differences, so that a light body on a stiff soil needs no microsecond steps. In steady state it is exact.

All compiled functions are in this file: numba's cache does not detect changes in another.
"""

import math
from typing import NamedTuple

import numpy as np

from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.arrays import Array
from sim_backends.jit import compiled
from sim_backends.plants.el_dorado.wheel_table import WheelTable

REST_M_S = 1e-5
"""When every rim is slower, the soil holds the rover at rest."""
FRICTION_SMOOTHING_RAD_S = 0.02
LEAST_LOAD = 0.02
"""A wheel carries at least this share of the weight: the rover does not tip."""

_compiled = compiled()


class Rover(NamedTuple):
    """Constants of the body.

    Attributes:
        contact_m: Contact of each wheel, rows x, y in the body frame.
        inertia: Mass, mass, moment of inertia about the vertical.
    """

    contact_m: Array
    radius_m: float
    centre_height_m: float
    inertia: Array


class Ground(NamedTuple):
    """Shape of the ground.

    Attributes:
        grade: Rise along x and y below the mounds.
        mounds: Rows x, y, height, radius.
    """

    grade: Array
    mounds: Array


class State(NamedTuple):
    """State variables; arrays are updated in place.

    Attributes:
        pose: x, y in the world, yaw.
        tilt: Pitch (nose down positive) and roll (left side up positive) of the contact plane.
        twist: Velocity forward and to the left in that plane, rate about its normal.
        torque_nm: Torque of the soil on each wheel.
        slip: Slip ratio of each wheel.
    """

    pose: Array
    tilt: Array
    twist: Array
    torque_nm: Array
    slip: Array


class Drives(NamedTuple):
    """Motors, gears and steering of the wheels.

    Attributes:
        speed_lag_s: Time constant of the speed loops.
        steer_rate_rad_s: Speed of the steering.
        no_load_current_a: Current of a motor that turns its gear only.
        torque_per_ampere_nm: Torque at the wheel.
        inertia_kg_m2: Of the rover at one wheel.
    """

    speed_lag_s: float
    steer_rate_rad_s: float
    no_load_current_a: float
    torque_per_ampere_nm: float
    inertia_kg_m2: float


class WheelState(NamedTuple):
    """State of the four wheels; arrays are updated in place.

    Attributes:
        set_rad_s, set_steer_rad: Setpoints.
        strength: Factor on the soil's horizontal forces at each wheel.
        rim_m_s: Mean rim speeds in the newest step.
    """

    set_rad_s: Array
    set_steer_rad: Array
    speed_rad_s: Array
    angle_rad: Array
    steer_rad: Array
    strength: Array
    rim_m_s: Array


class GroundContact(NamedTuple):
    """Load and camber of each wheel, and the effect of the weight along the contact plane.

    Attributes:
        load_n: Load on each wheel.
        camber_rad: From the surface's normal under the wheel to the wheel's plane, positive to the left.
        pull: Weight along the body's x and y, N, and its moment, N m; rises under the wheels that differ
            from the plane of the four contacts included.
    """

    load_n: Array
    camber_rad: Array
    pull: Array


@_compiled
def surface(ground: Ground, x_m: float, y_m: float) -> tuple[float, float, float]:
    """Return height and rise along x and y of the ground at a point."""
    rise_x, rise_y = ground.grade[0], ground.grade[1]
    height = rise_x * x_m + rise_y * y_m
    for row in range(ground.mounds.shape[0]):
        from_x, from_y = x_m - ground.mounds[row, 0], y_m - ground.mounds[row, 1]
        radius_2 = ground.mounds[row, 3] ** 2
        part = ground.mounds[row, 2] * math.exp(-0.5 * (from_x**2 + from_y**2) / radius_2)
        height += part
        rise_x -= part * from_x / radius_2
        rise_y -= part * from_y / radius_2
    return height, rise_x, rise_y


@_compiled
def settle(state: State, rover: Rover, ground: Ground) -> GroundContact:
    """Tilt the body onto the best-fit plane of its contacts, and distribute its weight over the wheels."""
    cosine, sine = math.cos(state.pose[2]), math.sin(state.pose[2])
    ahead, left = rover.contact_m[:, 0], rover.contact_m[:, 1]
    rise_ahead = rise_left = 0.0
    wheel_rise = np.empty((4, 2))
    for wheel in range(4):
        height, rise_x, rise_y = surface(
            ground,
            state.pose[0] + cosine * ahead[wheel] - sine * left[wheel],
            state.pose[1] + sine * ahead[wheel] + cosine * left[wheel],
        )
        rise_ahead += 0.25 * height / ahead[wheel]
        rise_left += 0.25 * height / left[wheel]
        wheel_rise[wheel, 0] = cosine * rise_x + sine * rise_y
        wheel_rise[wheel, 1] = -sine * rise_x + cosine * rise_y
    state.tilt[0] = -math.atan(rise_ahead)
    state.tilt[1] = math.atan(rise_left / math.hypot(1.0, rise_ahead))
    weight_n = rover.inertia[0] * STANDARD_GRAVITY_M_S2
    back = -math.sin(state.tilt[0])
    right = math.cos(state.tilt[0]) * math.sin(state.tilt[1])
    upright = math.cos(state.tilt[0]) * math.cos(state.tilt[1])
    load = np.empty(4)
    camber = np.empty(4)
    pull = np.array([-weight_n * back, -weight_n * right, 0.0])
    for wheel in range(4):
        shift = rover.centre_height_m * (back / ahead[wheel] + right / left[wheel])
        load[wheel] = weight_n * max(LEAST_LOAD, 0.25 * (upright - shift))
        steeper_ahead = math.atan(wheel_rise[wheel, 0]) + state.tilt[0]
        camber[wheel] = math.atan(wheel_rise[wheel, 1]) - math.atan(rise_left)
        back_n, right_n = load[wheel] * math.sin(steeper_ahead), load[wheel] * math.sin(camber[wheel])
        pull[0] -= back_n
        pull[1] -= right_n
        pull[2] += back_n * left[wheel] - right_n * ahead[wheel]
    return GroundContact(load, camber, pull)


@_compiled
def _cell_of(axis: Array, value: float) -> tuple[int, float]:
    """Return the cell of an axis and the relative position in it; values are clamped to the ends."""
    cell = min(max(int(np.searchsorted(axis, value)) - 1, 0), len(axis) - 2)
    share = (value - axis[cell]) / (axis[cell + 1] - axis[cell])
    return cell, min(max(share, 0.0), 1.0)


@_compiled
def look_up(
    table: WheelTable, load_n: float, slip: float, side_rad: float, camber_rad: float
) -> tuple[float, float, float]:
    """Return drawbar pull, side force to the left, and torque over radius, as shares of the load."""
    mirror = -1.0 if side_rad < 0.0 else 1.0
    first, a = _cell_of(table.load_n, load_n)
    second, b = _cell_of(table.slip, slip)
    third, c = _cell_of(table.side_rad, mirror * side_rad)
    fourth, d = _cell_of(table.camber_rad, mirror * camber_rad)
    drawbar = side = torque = 0.0
    for corner in range(16):
        i, j, k, m = corner & 1, corner >> 1 & 1, corner >> 2 & 1, corner >> 3
        weight = (a if i else 1.0 - a) * (b if j else 1.0 - b) * (c if k else 1.0 - c) * (d if m else 1.0 - d)
        cell = table.share[first + i, second + j, third + k, fourth + m]
        drawbar += weight * cell[0]
        side += weight * cell[1]
        torque += weight * cell[2]
    return drawbar, mirror * side, torque


@_compiled
def wheel_shares(
    table: WheelTable, load_n: float, rim_m_s: float, ahead_m_s: float, left_m_s: float, camber_rad: float
) -> tuple[float, float, float, float]:
    """Return force forward, to the left and torque over radius, as shares of the load, and the slip ratio.

    Backward travel mirrors forward travel. A wheel pushed against the rotation of its rim ploughs: its
    resistance grows with that speed up to its load.
    """
    direction = -1.0 if rim_m_s < 0.0 or (rim_m_s == 0.0 and ahead_m_s < 0.0) else 1.0
    rim, forward = direction * rim_m_s, direction * ahead_m_s
    ploughing = min(max(-forward / rim, 0.0), 1.0) if rim > 0.0 else 0.0
    forward = max(forward, 0.0)
    faster = max(rim, forward, 1e-12)
    slip = (rim - forward) / faster
    drawbar, side, torque = look_up(table, load_n, slip, math.atan(left_m_s / faster), camber_rad)
    return direction * (drawbar + ploughing), side, direction * torque, slip


@_compiled
def _soil_forces(
    twist: Array,
    rim_m_s: Array,
    steer_rad: Array,
    strength: Array,
    rover: Rover,
    contact: GroundContact,
    table: WheelTable,
    state: State,
) -> Array:
    """Return the soil's forces on the body along x, y, and its moment; update slips and torques."""
    total = np.zeros(3)
    for wheel in range(4):
        ahead, left = rover.contact_m[wheel, 0], rover.contact_m[wheel, 1]
        x_m_s, y_m_s = twist[0] - twist[2] * left, twist[1] + twist[2] * ahead
        cosine, sine = math.cos(steer_rad[wheel]), math.sin(steer_rad[wheel])
        load_n = contact.load_n[wheel]
        drawbar, side, torque, slip = wheel_shares(
            table,
            load_n,
            rim_m_s[wheel],
            cosine * x_m_s + sine * y_m_s,
            -sine * x_m_s + cosine * y_m_s,
            contact.camber_rad[wheel],
        )
        drawbar_n, side_n = strength[wheel] * load_n * drawbar, strength[wheel] * load_n * side
        x_n, y_n = cosine * drawbar_n - sine * side_n, sine * drawbar_n + cosine * side_n
        total[0] += x_n
        total[1] += y_n
        total[2] += ahead * y_n - left * x_n
        state.torque_nm[wheel] = torque * load_n * rover.radius_m
        state.slip[wheel] = slip
    return total


@_compiled
def step(
    state: State,
    rover: Rover,
    ground: Ground,
    table: WheelTable,
    rim_m_s: Array,
    steer_rad: Array,
    strength: Array,
    step_s: float,
) -> None:
    """Integrate one step with the rims at given speeds.

    Args:
        state: State, updated in place.
        rover: Constants of the body.
        ground: Shape of the ground.
        table: Forces of the soil.
        rim_m_s: Rim speed of each wheel.
        steer_rad: Angle of each wheel, counter-clockwise.
        strength: Factor on the soil's horizontal forces at each wheel.
        step_s: Length of the step.
    """
    contact = settle(state, rover, ground)
    fastest = np.max(np.abs(rim_m_s))
    if fastest < REST_M_S:
        state.twist[:] = 0.0
        state.torque_nm[:] = 0.0
        state.slip[:] = 0.0
        return
    matrix = np.zeros((3, 3))
    probe = 1e-3 * fastest
    for axis in range(3):
        # Central differences: the drawbar pull is even in the sideways speed.
        less, more = state.twist.copy(), state.twist.copy()
        less[axis] -= probe
        more[axis] += probe
        below = _soil_forces(less, rim_m_s, steer_rad, strength, rover, contact, table, state)
        above = _soil_forces(more, rim_m_s, steer_rad, strength, rover, contact, table, state)
        matrix[:, axis] = (below - above) / (2.0 * probe)
        matrix[axis, axis] += rover.inertia[axis] / step_s
    forces = _soil_forces(state.twist, rim_m_s, steer_rad, strength, rover, contact, table, state)
    state.twist[:] += np.linalg.solve(matrix, forces + contact.pull)
    _move(state, rover, ground, step_s)


@_compiled
def _move(state: State, rover: Rover, ground: Ground, step_s: float) -> None:
    """Integrate the pose along the contact plane, and tilt it onto the next one."""
    pitch, roll = state.tilt[0], state.tilt[1]
    forward = state.twist[0] * math.cos(pitch) + state.twist[1] * math.sin(pitch) * math.sin(roll)
    left = state.twist[1] * math.cos(roll)
    turn = state.twist[2] * step_s / (math.cos(pitch) * math.cos(roll))
    middle = state.pose[2] + 0.5 * turn
    state.pose[0] += step_s * (math.cos(middle) * forward - math.sin(middle) * left)
    state.pose[1] += step_s * (math.sin(middle) * forward + math.cos(middle) * left)
    settle(state, rover, ground)
    # On curved ground a body that does not turn about its own normal still turns in plan view.
    state.pose[2] += turn + math.tan(roll) / math.cos(pitch) * (state.tilt[0] - pitch)


@_compiled
def advance(
    state: State,
    wheels: WheelState,
    rover: Rover,
    drives: Drives,
    ground: Ground,
    table: WheelTable,
    step_s: float,
) -> None:
    """Integrate one step: the wheels' first-order lag is exact, the body moves at their mean speed."""
    lag_s = drives.speed_lag_s
    kept = math.exp(-step_s / lag_s)
    most_rad = drives.steer_rate_rad_s * step_s
    for wheel in range(4):
        set_rad_s = wheels.set_rad_s[wheel]
        error_rad_s = wheels.speed_rad_s[wheel] - set_rad_s
        turned = set_rad_s * step_s + error_rad_s * (lag_s * (1.0 - kept))
        wheels.angle_rad[wheel] += turned
        wheels.speed_rad_s[wheel] = set_rad_s + error_rad_s * kept
        missing_rad = wheels.set_steer_rad[wheel] - wheels.steer_rad[wheel]
        wheels.steer_rad[wheel] += min(max(missing_rad, -most_rad), most_rad)
        wheels.rim_m_s[wheel] = rover.radius_m * turned / step_s
    step(state, rover, ground, table, wheels.rim_m_s, wheels.steer_rad, wheels.strength, step_s)


@_compiled
def write_currents(state: State, wheels: WheelState, drives: Drives, current_a: Array) -> None:
    """Compute the signed currents for friction, soil and acceleration; the gears hold at rest."""
    for wheel in range(4):
        speed_rad_s = wheels.speed_rad_s[wheel]
        turning = speed_rad_s / math.hypot(speed_rad_s, FRICTION_SMOOTHING_RAD_S)
        inertia_nm = drives.inertia_kg_m2 * ((wheels.set_rad_s[wheel] - speed_rad_s) / drives.speed_lag_s)
        load_nm = abs(turning) * state.torque_nm[wheel] + inertia_nm
        current_a[wheel] = drives.no_load_current_a * turning + load_nm / drives.torque_per_ampere_nm
