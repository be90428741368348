"""Nature (a): bristle friction by slip velocity, load transfer and discrete rollers.

Traction and side force follow the LuGre model of Canudas de Wit, Olsson, Astrom and Lischinsky (1995),
equations 1 to 4, per unit of load as in Canudas de Wit and Tsiotras (1999):

    dz/dt = v - sigma0 |v| z / g(v),    F = N (sigma0 z + sigma1 dz/dt + sigma2 v)

Its damping sigma1 dies out with the sliding speed (Olsson 1996, section 3.4), which keeps the model
passive. The level g(v) has the hump of elastomers over the logarithm of the sliding velocity (measured by
Grosch 1963; formula of Savkoor 1966) and, on hard ground, the fall of Stribeck (1902). It has no slip
ratio: the rover slips, because more traction needs a greater sliding VELOCITY.

The wheel is a wreath of barrel rollers in two rows. The row that touches has its own arm to the rover's
centre, the barrel's shape changes the radius over its length, and the step from roller to roller costs
drag. A roller that touches down has undeflected bristles.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from tests.nature.floors.machine import GRAVITY_M_S2, OMNI_ANGLE_RAD, Floats, draw_machine, move_body
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

__all__ = ["BristlePlant", "bristle_force", "draw_floor"]

# Meaning of a tile's constants.
STIFFNESS: Final = 0  # sigma0, 1/m: bristle force per load and deflection.
DAMPING: Final = 1  # sigma1, s/m.
VISCOUS: Final = 2  # sigma2, s/m.
LOW: Final = 3  # Friction coefficient at the slowest creep.
PEAK: Final = 4  # Friction coefficient at the top of the hump.
PEAK_M_S: Final = 5  # Sliding velocity of the hump's top.
WIDTH: Final = 6  # The hump falls by exp(-WIDTH^2) a decade away from its top.
STICTION: Final = 7  # Extra friction coefficient at rest (Stribeck).
STRIBECK_M_S: Final = 8
RESISTANCE: Final = 9  # Force per load against the hub's motion in any direction (hysteresis of the ground).
ROLLER: Final = 10  # Force per load against the rollers' turning (pins, and rolling of a small barrel).
ROLLERS: Final = 11  # Rollers per row; the same on all tiles, as are the next three.
ROW_M: Final = 12  # The rows lie so far inside and outside of the wheel's middle.
SCALLOP_M: Final = 13  # The radius is so much smaller at a barrel's ends.
GAP: Final = 14  # Relative rise of the drag at the step from roller to roller.
CONSTANTS: Final = 15

_DAMPING_M_S: Final = 0.02
"""Sliding velocity at which the bristles' damping has died out."""
_SOFT_START_M_S: Final = 2e-3
"""Below this the ground's resistance is proportional to speed: there is no slope that it has to hold."""
_WHEEL_GIVE_N_M: Final = 4e4
_ROCKING_S: Final = 0.017
"""Time in which the load shifts: the frame rocks on the give of its wheels at about 60 rad/s."""


class Contact(NamedTuple):
    """State of the contacts: bristle deflections per wheel, roller that touches, lagged acceleration."""

    along_m: Floats
    across_m: Floats
    roller: Floats
    phase_rad: Floats
    acceleration_m_s2: Floats


@njit(cache=True)
def friction_level(ground: Floats, sliding_m_s: float) -> float:
    """Return g(v), per unit of load."""
    decades = math.log10(max(abs(sliding_m_s), 1e-7) / ground[PEAK_M_S])
    hump = (ground[PEAK] - ground[LOW]) * math.exp(-((ground[WIDTH] * decades) ** 2))
    rest = ground[STICTION] * math.exp(-((sliding_m_s / ground[STRIBECK_M_S]) ** 2))
    return float(ground[LOW] + hump + rest)


@njit(cache=True)
def bristle_force(
    ground: Floats,
    load_n: float,
    level: float,
    viscous: float,
    sliding_m_s: float,
    deflection_m: float,
    step_s: float,
) -> tuple[float, float]:
    """Return the force on the ground's side that follows the sliding, and the new deflection.

    The deflection's step is implicit: it stays within level / sigma0 for any step.

    Args:
        level: g(v) of this direction, per unit of load.
        viscous: sigma2 of this direction.
    """
    stiffness = ground[STIFFNESS]
    new_m = (deflection_m + step_s * sliding_m_s) / (1.0 + step_s * stiffness * abs(sliding_m_s) / level)
    damping = ground[DAMPING] * math.exp(-((sliding_m_s / _DAMPING_M_S) ** 2))
    rate_m_s = (new_m - deflection_m) / step_s
    return load_n * (stiffness * new_m + damping * rate_m_s + viscous * sliding_m_s), new_m


@njit(cache=True)
def _roller(ground: Floats, angle_rad: float) -> tuple[float, float]:
    """Return the number of the roller that touches and the place along its barrel, -1 to 1."""
    turn = angle_rad * ground[ROLLERS] / math.pi
    number = math.floor(turn)
    return float(number), 2.0 * (turn - number) - 1.0


@njit(cache=True)
def _shift_loads(rover: Rover, contact: Contact, lifted: bool) -> None:
    """Set the loads of the wheels: weight and inertia act at the height of the centre of mass."""
    machine, acceleration_m_s2 = rover.machine, contact.acceleration_m_s2
    lean = machine.com_height_m / GRAVITY_M_S2
    set_loads(
        rover,
        lifted,
        machine.com_x_m - lean * acceleration_m_s2[0],
        machine.com_y_m - lean * acceleration_m_s2[1],
    )


@njit(cache=True)
def _wheel_step(rover: Rover, contact: Contact, wheel: int) -> None:
    """Advance one wheel and add its force to the body's."""
    machine, load_n, step_s = rover.machine, rover.load_n[wheel], rover.step_s
    ground = ground_under(rover, wheel)
    number, place = _roller(ground, rover.drive.angle_rad[wheel] + contact.phase_rad[wheel])
    if number != contact.roller[wheel]:
        contact.roller[wheel] = number
        contact.along_m[wheel] = 0.0
        contact.across_m[wheel] = 0.0
    arm_m = machine.arm_m + (ground[ROW_M] if number % 2.0 == 0.0 else -ground[ROW_M])
    radius_m = machine.radius_m - ground[SCALLOP_M] * (place**2 - 1.0 / 3.0)
    drag = 1.0 + ground[GAP] * (place**2 - 1.0 / 3.0)

    along_m_s, across_m_s = hub_velocity(rover, wheel, arm_m)
    side_n, contact.across_m[wheel] = bristle_force(
        ground, load_n, drag * ground[ROLLER], 0.0, -across_m_s, contact.across_m[wheel], step_s
    )
    sliding_m_s = radius_m * rover.drive.speed_rad_s[wheel] - along_m_s
    level = friction_level(ground, sliding_m_s)
    # Side force uses up a part of the friction circle.
    level *= math.sqrt(max(0.04, 1.0 - (drag * ground[ROLLER] / level) ** 2))
    traction_n, contact.along_m[wheel] = bristle_force(
        ground, load_n, level, ground[VISCOUS], sliding_m_s, contact.along_m[wheel], step_s
    )
    resist = drag * ground[RESISTANCE] * load_n / math.sqrt(along_m_s**2 + across_m_s**2 + _SOFT_START_M_S**2)
    push_hub(rover, wheel, arm_m, traction_n - resist * along_m_s, side_n - resist * across_m_s)
    turn_wheel(rover, wheel, radius_m * traction_n, 1.0)


@njit(cache=True)
def _run(rover: Rover, contact: Contact, first: int, steps: int, lifted: bool) -> None:
    """Integrate `steps` steps."""
    part = rover.step_s / (_ROCKING_S + rover.step_s)
    for step in range(first, first + steps):
        begin_step(rover, step)
        _shift_loads(rover, contact, lifted)
        for wheel in range(3):
            _wheel_step(rover, contact, wheel)
        for axis in range(2):
            contact.acceleration_m_s2[axis] += part * (
                rover.wrench[axis] / rover.machine.mass_kg - contact.acceleration_m_s2[axis]
            )
        move_body(rover.machine, rover.body, rover.wrench, rover.step_s)


class BristlePlant(OmniPlant):
    """A rover on ground whose traction follows the slip velocity; arguments as of `RoverPlant`."""

    def _prepare(self) -> None:
        self._contact = Contact(np.zeros(3), np.zeros(3), np.full(3, math.nan), self.phase_rad, np.zeros(2))

    def _integrate(self, steps: int) -> None:
        _run(self.rover, self._contact, self._steps, steps, self._lifted)

    def load_n(self) -> tuple[float, ...]:
        """Return the loads of the wheels."""
        _shift_loads(self.rover, self._contact, self._lifted)
        return tuple(self.rover.load_n.tolist())

    def _tilt(self) -> tuple[float, float]:
        """Return roll and pitch by the give of the wheels under their loads."""
        slope = 2.0 / (3.0 * self.machine.arm_m)
        sink_m = [load_n / _WHEEL_GIVE_N_M for load_n in self.load_n()]
        ahead = slope * sum(s * math.cos(a) for s, a in zip(sink_m, OMNI_ANGLE_RAD, strict=True))
        left = slope * sum(s * math.sin(a) for s, a in zip(sink_m, OMNI_ANGLE_RAD, strict=True))
        return -left, ahead


_KINDS: Final = table_of_kinds(
    ("vinyl", "dust", "polish"),
    {
        # Hard and soft end; the tile's grade lies between.
        STIFFNESS: ((700.0, 400.0), (600.0, 300.0), (900.0, 500.0)),
        LOW: ((0.060, 0.020), (0.055, 0.025), (0.050, 0.015)),
        PEAK: ((0.60, 0.42), (0.50, 0.32), (0.40, 0.12)),
        PEAK_M_S: ((0.5, 0.6), (0.4, 0.4), (0.3, 0.2)),
        WIDTH: ((0.75, 0.72), (0.75, 0.75), (0.75, 0.70)),
        VISCOUS: ((0.05, 0.1), (0.1, 0.6), (0.4, 2.2)),
        STICTION: ((0.10, 1e-3), (0.08, 1e-3), (0.12, 1e-3)),
        RESISTANCE: ((0.025, 0.125), (0.028, 0.115), (0.022, 0.110)),
        ROLLER: ((0.030, 0.055), (0.035, 0.055), (0.025, 0.045)),
    },
)
"""Origins are in README.md."""
_LEAN: Final = 1.45
"""How far the floors' grades lean to the soft end."""


def draw_floor(seed: int) -> Floor:
    """Draw a floor of three kinds of ground, and the rover that drives on it."""
    rng = np.random.default_rng([seed, 0xA])
    machine = draw_machine(rng)
    softness = draw_softness(seed, _LEAN)
    kinds = draw_kinds(rng, softness, _KINDS)
    wreath = [
        float(rng.choice([4, 6, 8])),
        float(rng.uniform(0.007, 0.011)),
        float(rng.uniform(1e-4, 4e-4)),
        float(rng.uniform(0.1, 0.5)),
    ]
    return lay_floor(rng, seed, machine, softness, kinds, lambda kind: _draw_tile(rng, *kinds[kind]) + wreath)


def _draw_tile(rng: np.random.Generator, name: str, grade: float) -> list[float]:
    """Return the constants STIFFNESS to ROLLER of a tile."""
    value = graded(_KINDS[name], grade)
    scatter(rng, value, (STIFFNESS, RESISTANCE, ROLLER))
    value[STRIBECK_M_S] = float(rng.uniform(0.005, 0.02))
    # Four tenths of critical for a wheel's share of the mass on its bristles.
    value[DAMPING] = 0.8 * math.sqrt(value[STIFFNESS] * 1.3 / 41.0)
    return [value[meaning] for meaning in range(ROLLERS)]
