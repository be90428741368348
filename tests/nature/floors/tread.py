"""Nature (b): an elastic tread with relaxation length and parabolic pressure.

Brush model of Pacejka, "Tire and Vehicle Dynamics" (2012), section 3.2: with a parabolic pressure the force
is

    F = mu N (3 t - 3 t^2 + t^3),   t = theta |sigma| < 1,   theta = C / (3 mu N),   else F = mu N,

where C is the slip stiffness 2 c_p a^2. Here sigma is sliding over the speed at which the tread runs
through the contact: a slip RATIO, without any velocity scale. The transient is the contact's deflection u
of section 7.2.1,

    du/dt = sliding - |running| u / l,    sigma = u / l,

with relaxation length l. The tread of an omnidirectional wheel's roller runs through the contact also when
the roller turns, so the running speed is that of rim and roller together. The rollers have no camber.
Rolling drag acts on the hub, the rollers' own drag along the axle.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from tests.nature.floors.machine import Floats, Machine, draw_machine, move_body
from tests.nature.floors.patchwork import (
    Floor,
    draw_kinds,
    draw_softness,
    graded,
    lay_floor,
    scatter,
    table_of_kinds,
)
from tests.nature.floors.rover import (
    OmniPlant,
    Rover,
    begin_step,
    ground_under,
    hub_velocity,
    push_hub,
    set_loads,
    turn_wheel,
)

__all__ = ["TreadPlant", "brush_force", "drag_share", "draw_floor", "draw_tread_floor"]

# Meaning of a tile's constants.
FRICTION: Final = 0  # mu.
SLIP_STIFFNESS: Final = 1  # C per load: rise of the traction coefficient per slip, at small slip.
RELAXATION_M: Final = 2  # Relaxation length.
DAMPING_S_M: Final = (
    3  # Damping of the tread that sticks, per load; only felt near rest (Pacejka 2012, section 8.6).
)
DRAG: Final = 4  # Rolling drag per load against the hub's motion.
DRAG_S_M: Final = 5  # Rise of the rolling drag per hub speed.
ROLLER: Final = 6  # Drag per load against the rollers' turning.
CONSTANTS: Final = 7

_SOFT_START_M_S: Final = 2e-3
"""Below this drag is proportional to speed: there is no slope that it has to hold."""


class Tread(NamedTuple):
    """Deflection of each wheel's contact along the rim."""

    along_m: Floats


@njit(cache=True)
def brush_force(
    ground: Floats, load_n: float, sliding_m_s: float, running_m_s: float, deflection_m: float, step_s: float
) -> tuple[float, float]:
    """Return the force on the ground's side that follows the sliding, and the new deflection.

    The deflection ends where all of the tread slides: it would wind up otherwise, with a wheel locked or
    spinning on the spot.
    """
    length_m = ground[RELAXATION_M]
    theta = ground[SLIP_STIFFNESS] / (3.0 * ground[FRICTION])
    most_m = length_m / theta
    new_m = (deflection_m + step_s * sliding_m_s) / (1.0 + step_s * abs(running_m_s) / length_m)
    new_m = min(most_m, max(-most_m, new_m))
    part = theta * abs(new_m) / length_m
    rise = math.copysign(1.0 - (1.0 - part) ** 3, new_m)
    damping = ground[DAMPING_S_M] * (1.0 - part) ** 2 * sliding_m_s
    return load_n * (ground[FRICTION] * rise + damping), new_m


@njit(cache=True)
def drag_share(ground: Floats, speed_m_s: float) -> float:
    """Return rolling drag per load and hub velocity, s/m: with the velocity it gives a vector."""
    drag = ground[DRAG] + ground[DRAG_S_M] * speed_m_s
    return float(drag / math.sqrt(speed_m_s**2 + _SOFT_START_M_S**2))


@njit(cache=True)
def _wheel_step(rover: Rover, tread: Tread, wheel: int) -> None:
    """Advance one wheel and add its force to the body's."""
    machine, load_n = rover.machine, rover.load_n[wheel]
    ground = ground_under(rover, wheel)
    along_m_s, across_m_s = hub_velocity(rover, wheel, machine.arm_m)
    rim_m_s = machine.radius_m * rover.drive.speed_rad_s[wheel]
    sliding_m_s, running_m_s = rim_m_s - along_m_s, math.hypot(rim_m_s, across_m_s)
    traction_n, tread.along_m[wheel] = brush_force(
        ground, load_n, sliding_m_s, running_m_s, tread.along_m[wheel], rover.step_s
    )
    drag = drag_share(ground, math.hypot(along_m_s, across_m_s)) * load_n
    roller = ground[ROLLER] * load_n / math.hypot(across_m_s, _SOFT_START_M_S)
    push_hub(rover, wheel, machine.arm_m, traction_n - drag * along_m_s, -(drag + roller) * across_m_s)
    turn_wheel(rover, wheel, machine.radius_m * traction_n, 1.0)


@njit(cache=True)
def _run(rover: Rover, tread: Tread, first: int, steps: int, lifted: bool) -> None:
    """Integrate `steps` steps."""
    set_loads(rover, lifted, rover.machine.com_x_m, rover.machine.com_y_m)
    for step in range(first, first + steps):
        begin_step(rover, step)
        for wheel in range(3):
            _wheel_step(rover, tread, wheel)
        move_body(rover.machine, rover.body, rover.wrench, rover.step_s)


class TreadPlant(OmniPlant):
    """A rover on ground whose traction follows the slip ratio; arguments as of `RoverPlant`."""

    def _prepare(self) -> None:
        self._tread = Tread(np.zeros(3))

    def _integrate(self, steps: int) -> None:
        _run(self.rover, self._tread, self._steps, steps, self._lifted)


_KINDS: Final = table_of_kinds(
    ("linoleum", "concrete", "mat"),
    {
        # Hard and soft end; the tile's grade lies between.
        FRICTION: ((0.70, 0.35), (0.85, 0.40), (0.80, 0.50)),
        SLIP_STIFFNESS: ((6.0, 0.50), (8.0, 0.58), (5.0, 0.48)),
        RELAXATION_M: ((0.004, 0.010), (0.002, 0.008), (0.008, 0.020)),
        DRAG: ((0.025, 0.085), (0.028, 0.100), (0.028, 0.100)),
        DRAG_S_M: ((0.01, 0.05), (0.01, 0.03), (0.02, 0.10)),
        ROLLER: ((0.020, 0.045), (0.025, 0.050), (0.020, 0.040)),
    },
)
"""Origins are in README.md."""
_LEAN: Final = 2.0
"""How far the floors' grades lean to the soft end."""


def draw_tread_floor(
    rng: np.random.Generator, seed: int, machine: Machine, softness: float, tread_factor: float = 1.0
) -> Floor:
    """Draw a floor of three kinds of ground around a grade.

    Args:
        tread_factor: Slip stiffness of this rover's tread over that of an omnidirectional wheel's rollers.
    """
    kinds = draw_kinds(rng, softness, _KINDS)
    return lay_floor(
        rng, seed, machine, softness, kinds, lambda kind: _draw_tile(rng, *kinds[kind], tread_factor)
    )


def _draw_tile(rng: np.random.Generator, name: str, grade: float, tread_factor: float) -> list[float]:
    """Return the constants of a tile."""
    value = graded(_KINDS[name], grade)
    value[SLIP_STIFFNESS] *= tread_factor
    scatter(rng, value, (SLIP_STIFFNESS, DRAG, ROLLER))
    # A fifth of critical for a wheel's share of the mass on its tread.
    value[DAMPING_S_M] = 0.4 * math.sqrt(value[SLIP_STIFFNESS] / value[RELAXATION_M] * 1.3 / 41.0)
    return [value[meaning] for meaning in range(CONSTANTS)]


def draw_floor(seed: int) -> Floor:
    """Draw a floor of three kinds of ground, and the omnidirectional rover that drives on it."""
    rng = np.random.default_rng([seed, 0xB])
    machine = draw_machine(rng)
    return draw_tread_floor(rng, seed, machine, draw_softness(seed, _LEAN))
