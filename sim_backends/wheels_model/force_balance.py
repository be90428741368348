"""Motion at which the forces of all contacts carry the load: the contact laws of the simulated rover, steady.

The laws are those of `sim_backends.plants.wheels.dynamics`: traction over load follows s' / sqrt(1 + s'^2),
s' = stiffness * slip / friction, rollers and castors drag, the ground resists rolling. There the forces
accelerate the body; here the acceleration is known, from the speeds of the wheels, and the motion is sought.

All compiled functions are in this file but for `solve`: numba's cache does not detect changes in another.
"""

import math
from typing import NamedTuple

import numpy as np

from sim_backends.arrays import Array
from sim_backends.jit import compiled
from sim_backends.plants.rigid_body import solve
from sim_backends.plants.wheels.dynamics import CREEP_M_S, Rover

MOST_STEPS = 30
"""Of the iteration with the coefficients of the step before; it converges within a few."""
CONVERGED_M_S = 1e-12

_compiled = compiled()


class Contact(NamedTuple):
    """Ground under all wheels: friction, stiffness, and drag along and across the wheels, all per load."""

    friction: float
    stiffness: float
    drag_along: float
    drag_across: float


class Wheels(NamedTuple):
    """What the wheels do in n windows.

    Attributes:
        rim_m_s: Speed of the rims, shape (n, wheels); NaN of a wheel that no sensor shows: it rolls freely.
        along_rad: Direction in which each wheel rolls, in the body frame, of the same shape.
        place_m: x, y of each contact, wheels first, then castors, shape (contacts, 2).
    """

    rim_m_s: Array
    along_rad: Array
    place_m: Array


def rolling_motion(rover: Rover, wheels: Wheels) -> Array:
    """Return velocity x, y and yaw rate of rolling wheels by least squares, shape (n, 3)."""
    free = Contact(friction=1e9, stiffness=1.0, drag_along=0.0, drag_across=0.0)
    start = np.zeros((len(wheels.rim_m_s), 3))
    return _balanced(rover, wheels, free, start, start, 0.0)


def balanced_motion(rover: Rover, wheels: Wheels, contact: Contact, load: Array, rolling: Array) -> Array:
    """Return velocity x, y and yaw rate of the body, shape (n, 3); NaN where the ground cannot carry a load.

    Args:
        rover: Its constants; wheels first, then castors.
        wheels: Speeds and directions of the wheels.
        contact: The ground.
        load: Force x, y in N and moment in N m that the contacts must carry, shape (n, 3).
        rolling: The `rolling_motion` of these wheels.
    """
    return _balanced(rover, wheels, contact, load, rolling, 1.0)


def _balanced(
    rover: Rover, wheels: Wheels, contact: Contact, load: Array, start: Array, castors: float
) -> Array:
    """Return the motion that balances the load; NaN where the contacts do not resist a motion at all."""
    twist = start.copy()
    try:
        _balance(rover, wheels, contact, load, twist, castors)
    except ZeroDivisionError:
        twist[:] = np.nan
    return twist


@_compiled
def _balance(
    rover: Rover, wheels: Wheels, contact: Contact, load: Array, twist: Array, castors: float
) -> None:
    """Replace each motion by the one that balances its load; `castors` 0 leaves their drag out."""
    count = len(rover.angle)
    matrix = np.empty((3, 3))
    right = np.empty(3)
    present = np.empty(3)
    for window in range(len(twist)):
        for _ in range(MOST_STEPS):
            matrix[:] = 0.0
            right[:] = load[window]
            present[:] = twist[window]
            for wheel in range(count):
                _add_wheel(rover, wheels, contact, window, wheel, present, matrix, right)
            for castor in range(len(rover.castor_drag)):
                x = wheels.place_m[count + castor, 0]
                y = wheels.place_m[count + castor, 1]
                vx = present[0] - present[2] * y
                vy = present[1] + present[2] * x
                speed = math.sqrt(vx * vx + vy * vy + CREEP_M_S * CREEP_M_S)
                drag = castors * rover.load_n[count + castor] * rover.castor_drag[castor] / speed
                _add_drag(matrix, x, y, drag, 0.0, drag)
            solve(matrix, right, twist[window])
            change = 0.0
            for axis in range(3):
                change += abs(twist[window, axis] - present[axis])
            if change < CONVERGED_M_S:
                break


@_compiled
def _add_wheel(
    rover: Rover,
    wheels: Wheels,
    contact: Contact,
    window: int,
    wheel: int,
    twist: Array,
    matrix: Array,
    right: Array,
) -> None:
    along = wheels.along_rad[window, wheel]
    rim = wheels.rim_m_s[window, wheel]
    x = wheels.place_m[wheel, 0]
    y = wheels.place_m[wheel, 1]
    load = rover.load_n[wheel]
    dx = math.cos(along)
    dy = math.sin(along)
    vx = twist[0] - twist[2] * y
    vy = twist[1] + twist[2] * x
    ux = vx - rim * dx
    uy = vy - rim * dy
    if math.isnan(rim):
        # No motor turns it: its rim is as fast as the ground, and it grips sideways only.
        rim = 0.0
        aside = -dy * vx + dx * vy
        grip = load * _traction(contact, aside, math.sqrt(vx * vx + vy * vy + CREEP_M_S * CREEP_M_S))
        xx = grip * dy * dy
        xy = -grip * dx * dy
        yy = grip * dx * dx
    elif math.isnan(rover.roller[wheel]):
        passing = math.sqrt(rim * rim + CREEP_M_S * CREEP_M_S)
        passing = max(passing, math.sqrt(vx * vx + vy * vy))
        grip = load * _traction(contact, math.sqrt(ux * ux + uy * uy), passing)
        xx = grip
        xy = 0.0
        yy = grip
    else:
        axle = along + 0.5 * math.pi + rover.roller[wheel]
        ex = math.cos(axle)
        ey = math.sin(axle)
        aside = -ey * vx + ex * vy
        passing = math.sqrt(rim * rim + aside * aside + CREEP_M_S * CREEP_M_S)
        grip = load * _traction(contact, ex * ux + ey * uy, passing)
        across_speed = -ey * ux + ex * uy
        across = load * contact.drag_across / math.sqrt(across_speed**2 + CREEP_M_S * CREEP_M_S)
        xx = grip * ex * ex + across * ey * ey
        xy = (grip - across) * ex * ey
        yy = grip * ey * ey + across * ex * ex
    push_x = rim * (xx * dx + xy * dy)
    push_y = rim * (xy * dx + yy * dy)
    right[0] += push_x
    right[1] += push_y
    right[2] += x * push_y - y * push_x
    ahead = dx * vx + dy * vy
    resistance = load * contact.drag_along / math.sqrt(ahead * ahead + CREEP_M_S * CREEP_M_S)
    _add_drag(matrix, x, y, xx + resistance * dx * dx, xy + resistance * dx * dy, yy + resistance * dy * dy)


@_compiled
def _traction(contact: Contact, sliding: float, passing: float) -> float:
    strain = contact.stiffness * sliding / (contact.friction * passing)
    traction: float = contact.stiffness / (passing * math.sqrt(1.0 + strain * strain))
    return traction


@_compiled
def _add_drag(matrix: Array, x: float, y: float, xx: float, xy: float, yy: float) -> None:
    """Add a force -(xx xy; xy yy) v at a contact point to the matrix of the body."""
    turn_x = -y * xx + x * xy
    turn_y = -y * xy + x * yy
    matrix[0, 0] += xx
    matrix[0, 1] += xy
    matrix[1, 0] += xy
    matrix[1, 1] += yy
    matrix[0, 2] += turn_x
    matrix[2, 0] += turn_x
    matrix[1, 2] += turn_y
    matrix[2, 1] += turn_y
    matrix[2, 2] += -y * turn_x + x * turn_y
