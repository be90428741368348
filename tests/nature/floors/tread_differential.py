"""Nature (b) on two driven wheels and a castor: tyre scrub, side slip and a swivel with friction.

The contact is the brush of `tread.py`. A tyre, unlike a roller, also resists sideways: rim and axle
direction share one brush, whose force points along the deflection (isotropic tread, Pacejka 2012, section
3.3). Turning on the spot scrubs the contact: a moment about the vertical with its own deflection angle
(turn slip, Pacejka 2012, section 4.2.1), limited by friction over the size of the contact.

The castor trails behind its swivel. Its wheel rolls freely with drag; its side force turns the swivel,
which has Coulomb friction and a little inertia (as in the shimmy models of Pacejka 2012, section 6.2,
without compliance of the king-pin). Driven backwards it flips over.

Wheels in the order left, right. Positive rotation drives ahead.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from tests.nature.floors.machine import (
    GRAVITY_M_S2,
    Floats,
    Machine,
    add_body_force,
    draw_machine,
    move_body,
)
from tests.nature.floors.patchwork import Floor, draw_softness
from tests.nature.floors.rover import Rover, RoverPlant, begin_step, ground_at, turn_wheel
from tests.nature.floors.tread import (
    DAMPING_S_M,
    FRICTION,
    RELAXATION_M,
    SLIP_STIFFNESS,
    drag_share,
    draw_tread_floor,
)

__all__ = ["DifferentialTreadPlant", "brush_vector", "draw_floor", "scrub_moment"]

_SWIVEL_X_M: Final = -0.18
"""Place of the castor's swivel, behind the axle."""
_TRAIL_M: Final = 0.025
_SWIVEL_INERTIA_KG_M2: Final = 3e-4
_SWIVEL_FRICTION_NM: Final = 0.015
_CONTACT_M: Final = 0.008
"""Mean lever of friction in the contact of a tyre 20 to 25 mm wide."""
_FREE: Final = 0.0
_CASTOR_DRAG: Final = 2.4
"""Drag of the castor's wheel over that of the tyres: it rises as the radius falls (0.06 m to 0.025 m)."""
_TREAD_FACTOR: Final = 0.68
"""Foam-filled tyres give about twice as much as the rollers' tread."""


class Tyres(NamedTuple):
    """State of the tyres, left, right, castor: deflections, scrub angle; the swivel's angle and its rate."""

    along_m: Floats
    across_m: Floats
    scrub_rad: Floats
    swivel: Floats


@njit(cache=True)
def brush_vector(
    ground: Floats,
    wheel: int,
    tyres: Tyres,
    load_n: float,
    sliding_along_m_s: float,
    sliding_across_m_s: float,
    running_m_s: float,
    step_s: float,
) -> tuple[float, float]:
    """Advance a tyre's deflection; return the force on the ground's side that follows the sliding."""
    length_m = ground[RELAXATION_M]
    theta = ground[SLIP_STIFFNESS] / (3.0 * ground[FRICTION])
    fresh = 1.0 + step_s * abs(running_m_s) / length_m
    along_m = (tyres.along_m[wheel] + step_s * sliding_along_m_s) / fresh
    across_m = (tyres.across_m[wheel] + step_s * sliding_across_m_s) / fresh
    size_m = math.hypot(along_m, across_m)
    most_m = length_m / theta
    if size_m > most_m:
        along_m, across_m, size_m = along_m * most_m / size_m, across_m * most_m / size_m, most_m
    tyres.along_m[wheel], tyres.across_m[wheel] = along_m, across_m
    rest = 1.0 - theta * size_m / length_m
    # Force over deflection; for no deflection it tends to the slip stiffness over the relaxation length.
    spring = load_n * ground[FRICTION] * (1.0 - rest**3) / max(size_m, 1e-12)
    if size_m < 1e-9:
        spring = load_n * ground[SLIP_STIFFNESS] / length_m
    damping = load_n * ground[DAMPING_S_M] * rest**2
    return spring * along_m + damping * sliding_along_m_s, spring * across_m + damping * sliding_across_m_s


@njit(cache=True)
def scrub_moment(
    ground: Floats,
    wheel: int,
    tyres: Tyres,
    load_n: float,
    turn_rad_s: float,
    running_m_s: float,
    step_s: float,
) -> float:
    """Advance a contact's scrub angle; return the moment on the wheel, against the turning."""
    length_m = ground[RELAXATION_M]
    angle = (tyres.scrub_rad[wheel] + step_s * turn_rad_s) / (1.0 + step_s * abs(running_m_s) / length_m)
    most_nm = ground[FRICTION] * load_n * _CONTACT_M
    stiffness = load_n * ground[SLIP_STIFFNESS] / length_m * _CONTACT_M**2
    most_rad = ground[FRICTION] * length_m / (ground[SLIP_STIFFNESS] * _CONTACT_M)
    angle = min(most_rad, max(-most_rad, angle))
    tyres.scrub_rad[wheel] = angle
    return float(min(most_nm, max(-most_nm, -stiffness * angle)))


@njit(cache=True)
def _wheel_step(rover: Rover, tyres: Tyres, wheel: int) -> None:
    """Advance one driven wheel and add its force and scrub to the body's."""
    machine, motion, load_n, step_s = rover.machine, rover.motion, rover.load_n[wheel], rover.step_s
    at_y = machine.arm_m * (1.0 - 2.0 * wheel)
    ground = ground_at(rover, 0.0, at_y)
    along_m_s, across_m_s = motion[2] - motion[4] * at_y, motion[3]
    rim_m_s = machine.radius_m * rover.drive.speed_rad_s[wheel]
    traction_n, side_n = brush_vector(
        ground, wheel, tyres, load_n, rim_m_s - along_m_s, -across_m_s, rim_m_s, step_s
    )
    drag = drag_share(ground, math.hypot(along_m_s, across_m_s)) * load_n
    along_n, across_n = traction_n - drag * along_m_s, side_n - drag * across_m_s
    add_body_force(machine, rover.wrench, 0.0, at_y, along_n, across_n)
    rover.wrench[2] += scrub_moment(ground, wheel, tyres, load_n, motion[4], rim_m_s, step_s)
    turn_wheel(rover, wheel, machine.radius_m * traction_n, 1.0)


@njit(cache=True)
def _castor_step(rover: Rover, tyres: Tyres) -> None:
    """Advance the castor: its side force acts on the swivel's place, its moment on the swivel alone."""
    motion, wrench, load_n, step_s = rover.motion, rover.wrench, rover.load_n[2], rover.step_s
    cosine, sine = math.cos(tyres.swivel[0]), math.sin(tyres.swivel[0])
    ground = ground_at(rover, _SWIVEL_X_M - _TRAIL_M * cosine, -_TRAIL_M * sine)
    turn_rad_s = motion[4] + tyres.swivel[1]
    swivel_x_m_s, swivel_y_m_s = motion[2], motion[3] + motion[4] * _SWIVEL_X_M
    along_m_s = cosine * swivel_x_m_s + sine * swivel_y_m_s
    across_m_s = -sine * swivel_x_m_s + cosine * swivel_y_m_s - _TRAIL_M * turn_rad_s
    # The castor's wheel follows the ground along its own direction: there is sliding across only.
    _, side_n = brush_vector(ground, 2, tyres, load_n, _FREE, -across_m_s, along_m_s, step_s)
    drag = _CASTOR_DRAG * drag_share(ground, math.hypot(along_m_s, across_m_s)) * load_n
    along_n, across_n = -drag * along_m_s, side_n - drag * across_m_s
    scrub_nm = scrub_moment(ground, 2, tyres, load_n, turn_rad_s, along_m_s, step_s)
    add_body_force(
        rover.machine,
        wrench,
        _SWIVEL_X_M,
        0.0,
        cosine * along_n - sine * across_n,
        sine * along_n + cosine * across_n,
    )
    free = tyres.swivel[1] + step_s * (-_TRAIL_M * across_n + scrub_nm) / _SWIVEL_INERTIA_KG_M2
    stop = step_s * _SWIVEL_FRICTION_NM / _SWIVEL_INERTIA_KG_M2
    rate = 0.0 if abs(free) <= stop else free - math.copysign(stop, free)
    # What the swivel's friction takes from the castor it gives to the body.
    wrench[2] += _SWIVEL_INERTIA_KG_M2 * (free - rate) / step_s
    tyres.swivel[1] = rate
    tyres.swivel[0] += step_s * rate


@njit(cache=True)
def castor_share(machine: Machine) -> float:
    """Return the castor's part of the weight, with the castor trailing straight."""
    return float(machine.com_x_m / (_SWIVEL_X_M - _TRAIL_M))


@njit(cache=True)
def _run(rover: Rover, tyres: Tyres, first: int, steps: int, lifted: bool) -> None:
    """Integrate `steps` steps."""
    machine, load_n = rover.machine, rover.load_n
    weight_n = 0.0 if lifted else machine.mass_kg * GRAVITY_M_S2
    load_n[2] = weight_n * castor_share(machine)
    for wheel in range(2):
        side = machine.com_y_m / machine.arm_m * (1.0 - 2.0 * wheel)
        load_n[wheel] = 0.5 * (weight_n - load_n[2]) + 0.5 * weight_n * side
    for step in range(first, first + steps):
        begin_step(rover, step)
        for wheel in range(2):
            _wheel_step(rover, tyres, wheel)
        _castor_step(rover, tyres)
        move_body(machine, rover.body, rover.wrench, rover.step_s)


class DifferentialTreadPlant(RoverPlant):
    """Two driven wheels and a castor; arguments as of `RoverPlant`.

    The castor starts within 0.3 rad of straight, as the last run left it.
    """

    wheel_count = 2

    @property
    def kinematics(self) -> Floats:
        """Rim speeds per body velocity; a wheel does not roll sideways, so y does not count."""
        arm_m = self.machine.arm_m
        return np.array([[1.0, 0.0, -arm_m], [1.0, 0.0, arm_m]])

    def _prepare(self) -> None:
        swivel_rad = 0.3 * (float(self.phase_rad[0]) / math.pi - 1.0)
        self.tyres = Tyres(np.zeros(3), np.zeros(3), np.zeros(3), np.array([swivel_rad, 0.0]))

    def _integrate(self, steps: int) -> None:
        _run(self.rover, self.tyres, self._steps, steps, self._lifted)


_LEAN: Final = 2.0
"""How far the floors' grades lean to the soft end."""


def draw_floor(seed: int) -> Floor:
    """Draw a floor of three kinds of ground, and the rover of two wheels that drives on it."""
    rng = np.random.default_rng([seed, 0xD])
    machine = draw_machine(rng, radius_m=0.06, arm_m=0.15, com_x_m=-0.05)
    return draw_tread_floor(rng, seed, machine, draw_softness(seed, _LEAN), _TREAD_FACTOR)
