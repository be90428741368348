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

from tests.nature.floors.machine import (
    GRAVITY_M_S2,
    OMNI_ANGLE_RAD,
    Floats,
    Machine,
    add_body_force,
    centre_motion,
    draw_machine,
    gear_loss,
    move_body,
    static_load,
)
from tests.nature.floors.measure import translation_slip
from tests.nature.floors.patchwork import (
    Floor,
    Grid,
    between,
    draw_softness,
    lay_tiles,
    softness_of_kinds,
    tile_constants,
)
from tests.nature.floors.rover import Drive, OmniPlant, drive_wheel, run_board

__all__ = ["BristlePlant", "bristle_force", "draw_floor", "steady_slip"]

# Meaning of a tile's constants.
STIFFNESS: Final = 0
"""sigma0, 1/m: bristle force per load and deflection."""
DAMPING: Final = 1
"""sigma1, s/m."""
VISCOUS: Final = 2
"""sigma2, s/m."""
LOW: Final = 3
"""Friction coefficient at the slowest creep."""
PEAK: Final = 4
"""Friction coefficient at the top of the hump."""
PEAK_M_S: Final = 5
"""Sliding velocity of the hump's top."""
WIDTH: Final = 6
"""The hump falls by exp(-WIDTH^2) a decade away from its top."""
STICTION: Final = 7
"""Extra friction coefficient at rest (Stribeck)."""
STRIBECK_M_S: Final = 8
RESISTANCE: Final = 9
"""Force per load against the hub's motion in any direction (hysteresis of the ground)."""
ROLLER: Final = 10
"""Force per load against the rollers' turning (pins, and rolling of a small barrel)."""
ROLLERS: Final = 11
"""Rollers per row; the same on all tiles, as are the next three."""
ROW_M: Final = 12
"""The rows lie so far inside and outside of the wheel's middle."""
SCALLOP_M: Final = 13
"""The radius is so much smaller at a barrel's ends."""
GAP: Final = 14
"""Relative rise of the drag at the step from roller to roller."""
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
def _load(machine: Machine, contact: Contact, wheel: int, lifted: bool) -> float:
    """Return the load of a wheel: weight and inertia act at the height of the centre of mass."""
    if lifted:
        return 0.0
    lean = machine.com_height_m / GRAVITY_M_S2
    angle = OMNI_ANGLE_RAD[wheel]
    return static_load(
        machine,
        machine.arm_m * math.cos(angle),
        machine.arm_m * math.sin(angle),
        machine.com_x_m - lean * contact.acceleration_m_s2[0],
        machine.com_y_m - lean * contact.acceleration_m_s2[1],
    )


@njit(cache=True)
def _wheel_step(
    machine: Machine,
    grid: Grid,
    drive: Drive,
    contact: Contact,
    wheel: int,
    motion: Floats,
    load_n: float,
    wrench: Floats,
    step_s: float,
) -> None:
    """Advance one wheel and add its force to the body's.

    Args:
        motion: Centre x, y, velocity ahead and left, yaw rate, cosine and sine of yaw.
    """
    cosine, sine = math.cos(OMNI_ANGLE_RAD[wheel]), math.sin(OMNI_ANGLE_RAD[wheel])
    at_x, at_y = machine.arm_m * cosine, machine.arm_m * sine
    ground = tile_constants(
        grid, motion[0] + motion[5] * at_x - motion[6] * at_y, motion[1] + motion[6] * at_x + motion[5] * at_y
    )
    number, place = _roller(ground, drive.angle_rad[wheel] + contact.phase_rad[wheel])
    if number != contact.roller[wheel]:
        contact.roller[wheel] = number
        contact.along_m[wheel] = 0.0
        contact.across_m[wheel] = 0.0
    arm_m = machine.arm_m + (ground[ROW_M] if number % 2.0 == 0.0 else -ground[ROW_M])
    radius_m = machine.radius_m - ground[SCALLOP_M] * (place**2 - 1.0 / 3.0)
    drag = 1.0 + ground[GAP] * (place**2 - 1.0 / 3.0)

    along_m_s = -sine * motion[2] + cosine * motion[3] + arm_m * motion[4]
    across_m_s = cosine * motion[2] + sine * motion[3]
    side_n, contact.across_m[wheel] = bristle_force(
        ground, load_n, drag * ground[ROLLER], 0.0, -across_m_s, contact.across_m[wheel], step_s
    )
    sliding_m_s = radius_m * drive.speed_rad_s[wheel] - along_m_s
    level = friction_level(ground, sliding_m_s)
    # Side force uses up a part of the friction circle.
    level *= math.sqrt(max(0.04, 1.0 - (drag * ground[ROLLER] / level) ** 2))
    traction_n, contact.along_m[wheel] = bristle_force(
        ground, load_n, level, ground[VISCOUS], sliding_m_s, contact.along_m[wheel], step_s
    )
    resist = drag * ground[RESISTANCE] * load_n / math.sqrt(along_m_s**2 + across_m_s**2 + _SOFT_START_M_S**2)
    along_n, across_n = traction_n - resist * along_m_s, side_n - resist * across_m_s
    add_body_force(
        machine,
        wrench,
        arm_m * cosine,
        arm_m * sine,
        -sine * along_n + cosine * across_n,
        cosine * along_n + sine * across_n,
    )

    load_nm = radius_m * traction_n
    friction_nm = machine.friction_nm * machine.gear_ratio + gear_loss(
        machine, drive.speed_rad_s[wheel], load_nm
    )
    drive_wheel(machine, drive, wheel, load_nm, friction_nm, step_s)


@njit(cache=True)
def _run(
    machine: Machine,
    grid: Grid,
    drive: Drive,
    contact: Contact,
    body: Floats,
    first: int,
    steps: int,
    substeps: int,
    step_s: float,
    lifted: bool,
) -> None:
    """Integrate `steps` steps."""
    motion, wrench = np.empty(7), np.empty(3)
    for step in range(first, first + steps):
        if step % substeps == 0:
            run_board(machine, drive)
        motion[0], motion[1], motion[2], motion[3], motion[4] = centre_motion(machine, body)
        motion[5], motion[6] = math.cos(body[2]), math.sin(body[2])
        wrench[:] = 0.0
        for wheel in range(3):
            load_n = _load(machine, contact, wheel, lifted)
            _wheel_step(machine, grid, drive, contact, wheel, motion, load_n, wrench, step_s)
        part = step_s / (_ROCKING_S + step_s)
        for axis in range(2):
            contact.acceleration_m_s2[axis] += part * (
                wrench[axis] / machine.mass_kg - contact.acceleration_m_s2[axis]
            )
        move_body(machine, body, wrench, step_s)


class BristlePlant(OmniPlant):
    """A rover on ground whose traction follows the slip velocity; arguments as of `RoverPlant`."""

    def _prepare(self) -> None:
        self._contact = Contact(np.zeros(3), np.zeros(3), np.full(3, math.nan), self.phase_rad, np.zeros(2))

    def _integrate(self, steps: int) -> None:
        _run(
            self.machine,
            self.floor.grid,
            self.drive,
            self._contact,
            self.body,
            self._steps,
            steps,
            self._substeps,
            self._step_s,
            self._lifted,
        )

    def load_n(self) -> tuple[float, ...]:
        """Return the loads of the wheels."""
        return tuple(_load(self.machine, self._contact, wheel, self._lifted) for wheel in range(3))

    def _tilt(self) -> tuple[float, float]:
        """Return roll and pitch by the give of the wheels under their loads."""
        slope = 2.0 / (3.0 * self.machine.arm_m)
        sink_m = [load_n / _WHEEL_GIVE_N_M for load_n in self.load_n()]
        ahead = slope * sum(s * math.cos(a) for s, a in zip(sink_m, OMNI_ANGLE_RAD, strict=True))
        left = slope * sum(s * math.sin(a) for s, a in zip(sink_m, OMNI_ANGLE_RAD, strict=True))
        return -left, ahead


_KINDS: Final[dict[str, dict[int, tuple[float, float]]]] = {
    # Hard and soft end; the tile's grade lies between.
    "vinyl": {
        STIFFNESS: (700.0, 400.0),
        LOW: (0.060, 0.020),
        PEAK: (0.60, 0.42),
        PEAK_M_S: (0.5, 0.6),
        WIDTH: (0.75, 0.72),
        VISCOUS: (0.05, 0.1),
        STICTION: (0.10, 1e-3),
        RESISTANCE: (0.025, 0.125),
        ROLLER: (0.030, 0.055),
    },
    "dust": {
        STIFFNESS: (600.0, 300.0),
        LOW: (0.055, 0.025),
        PEAK: (0.50, 0.32),
        PEAK_M_S: (0.4, 0.4),
        WIDTH: (0.75, 0.75),
        VISCOUS: (0.1, 0.6),
        STICTION: (0.08, 1e-3),
        RESISTANCE: (0.028, 0.115),
        ROLLER: (0.035, 0.055),
    },
    "polish": {
        STIFFNESS: (900.0, 500.0),
        LOW: (0.050, 0.015),
        PEAK: (0.40, 0.12),
        PEAK_M_S: (0.3, 0.2),
        WIDTH: (0.75, 0.70),
        VISCOUS: (0.4, 2.2),
        STICTION: (0.12, 1e-3),
        RESISTANCE: (0.022, 0.110),
        ROLLER: (0.025, 0.045),
    },
}
"""Origins are in README.md."""
_KIND_SPREAD: Final = 0.12
"""Grades of a floor's kinds differ by this to either side."""
_LEAN: Final = 1.45
"""How far the floors' grades lean to the soft end."""


def draw_floor(seed: int) -> Floor:
    """Draw a floor of three kinds of ground, and the rover that drives on it."""
    rng = np.random.default_rng([seed, 0xA])
    machine = draw_machine(rng)
    softness = draw_softness(seed, _LEAN)
    names = tuple(str(name) for name in rng.permutation(list(_KINDS)))
    grades = softness_of_kinds(rng, softness, len(names), _KIND_SPREAD)
    wreath = [
        float(rng.choice([4, 6, 8])),
        float(rng.uniform(0.007, 0.011)),
        float(rng.uniform(1e-4, 4e-4)),
        float(rng.uniform(0.1, 0.5)),
    ]

    def draw_tile(kind: int) -> list[float]:
        return _draw_tile(rng, names[kind], grades[kind]) + wreath

    kind, grid = lay_tiles(rng, len(names), draw_tile)
    return Floor(seed, machine, softness, names, kind, grid)


def _draw_tile(rng: np.random.Generator, name: str, grade: float) -> list[float]:
    """Return the constants STIFFNESS to ROLLER of a tile."""
    ends = _KINDS[name]
    value = {meaning: between(hard, soft, grade) for meaning, (hard, soft) in ends.items()}
    for meaning in (STIFFNESS, RESISTANCE, ROLLER):
        value[meaning] *= float(rng.uniform(0.93, 1.07))
    value[STRIBECK_M_S] = float(rng.uniform(0.005, 0.02))
    # Four tenths of critical for a wheel's share of the mass on its bristles.
    value[DAMPING] = 0.8 * math.sqrt(value[STIFFNESS] * 1.3 / 41.0)
    return [value[meaning] for meaning in range(ROLLERS)]


def steady_slip(floor: Floor, speed_m_s: float = 0.15, direction_rad: float = 0.0) -> float:
    """Return the steady slip of a straight drive across the floor, 1 - true path / path by the wheels."""
    plant = BristlePlant(floor, np.random.default_rng(floor.seed), 0)
    return translation_slip(plant, speed_m_s, direction_rad)
