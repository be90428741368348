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

from tests.nature.floors.machine import (
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

__all__ = ["TreadPlant", "brush_force", "drag_share", "draw_floor", "draw_tread_floor", "steady_slip"]

# Meaning of a tile's constants.
FRICTION: Final = 0
"""mu."""
SLIP_STIFFNESS: Final = 1
"""C per load: rise of the traction coefficient per slip, at small slip."""
RELAXATION_M: Final = 2
"""Relaxation length."""
DAMPING_S_M: Final = 3
"""Damping of the tread that sticks, per load; only felt near rest (Pacejka 2012, section 8.6)."""
DRAG: Final = 4
"""Rolling drag per load against the hub's motion."""
DRAG_S_M: Final = 5
"""Rise of the rolling drag per hub speed."""
ROLLER: Final = 6
"""Drag per load against the rollers' turning."""
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
def _wheel_step(
    machine: Machine,
    grid: Grid,
    drive: Drive,
    tread: Tread,
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
    along_m_s = -sine * motion[2] + cosine * motion[3] + machine.arm_m * motion[4]
    across_m_s = cosine * motion[2] + sine * motion[3]
    rim_m_s = machine.radius_m * drive.speed_rad_s[wheel]
    traction_n, tread.along_m[wheel] = brush_force(
        ground, load_n, rim_m_s - along_m_s, math.hypot(rim_m_s, across_m_s), tread.along_m[wheel], step_s
    )
    drag = drag_share(ground, math.hypot(along_m_s, across_m_s)) * load_n
    roller = ground[ROLLER] * load_n / math.hypot(across_m_s, _SOFT_START_M_S)
    along_n, across_n = traction_n - drag * along_m_s, -(drag + roller) * across_m_s
    add_body_force(
        machine, wrench, at_x, at_y, -sine * along_n + cosine * across_n, cosine * along_n + sine * across_n
    )
    load_nm = machine.radius_m * traction_n
    friction_nm = machine.friction_nm * machine.gear_ratio + gear_loss(
        machine, drive.speed_rad_s[wheel], load_nm
    )
    drive_wheel(machine, drive, wheel, load_nm, friction_nm, step_s)


@njit(cache=True)
def _run(
    machine: Machine,
    grid: Grid,
    drive: Drive,
    tread: Tread,
    body: Floats,
    first: int,
    steps: int,
    substeps: int,
    step_s: float,
    lifted: bool,
) -> None:
    """Integrate `steps` steps."""
    motion, wrench, load_n = np.empty(7), np.empty(3), np.zeros(3)
    for wheel in range(3):
        angle = OMNI_ANGLE_RAD[wheel]
        if not lifted:
            load_n[wheel] = static_load(
                machine,
                machine.arm_m * math.cos(angle),
                machine.arm_m * math.sin(angle),
                machine.com_x_m,
                machine.com_y_m,
            )
    for step in range(first, first + steps):
        if step % substeps == 0:
            run_board(machine, drive)
        motion[0], motion[1], motion[2], motion[3], motion[4] = centre_motion(machine, body)
        motion[5], motion[6] = math.cos(body[2]), math.sin(body[2])
        wrench[:] = 0.0
        for wheel in range(3):
            _wheel_step(machine, grid, drive, tread, wheel, motion, load_n[wheel], wrench, step_s)
        move_body(machine, body, wrench, step_s)


class TreadPlant(OmniPlant):
    """A rover on ground whose traction follows the slip ratio; arguments as of `RoverPlant`."""

    def _prepare(self) -> None:
        self._tread = Tread(np.zeros(3))

    def _integrate(self, steps: int) -> None:
        _run(
            self.machine,
            self.floor.grid,
            self.drive,
            self._tread,
            self.body,
            self._steps,
            steps,
            self._substeps,
            self._step_s,
            self._lifted,
        )


_KINDS: Final[dict[str, dict[int, tuple[float, float]]]] = {
    # Hard and soft end; the tile's grade lies between.
    "linoleum": {
        FRICTION: (0.70, 0.35),
        SLIP_STIFFNESS: (6.0, 0.50),
        RELAXATION_M: (0.004, 0.010),
        DRAG: (0.025, 0.085),
        DRAG_S_M: (0.01, 0.05),
        ROLLER: (0.020, 0.045),
    },
    "concrete": {
        FRICTION: (0.85, 0.40),
        SLIP_STIFFNESS: (8.0, 0.58),
        RELAXATION_M: (0.002, 0.008),
        DRAG: (0.028, 0.100),
        DRAG_S_M: (0.01, 0.03),
        ROLLER: (0.025, 0.050),
    },
    "mat": {
        FRICTION: (0.80, 0.50),
        SLIP_STIFFNESS: (5.0, 0.48),
        RELAXATION_M: (0.008, 0.020),
        DRAG: (0.028, 0.100),
        DRAG_S_M: (0.02, 0.10),
        ROLLER: (0.020, 0.040),
    },
}
"""Origins are in README.md."""
_KIND_SPREAD: Final = 0.12
"""Grades of a floor's kinds differ by this to either side."""
_LEAN: Final = 2.0
"""How far the floors' grades lean to the soft end."""


def draw_tread_floor(
    rng: np.random.Generator, seed: int, machine: Machine, softness: float, tread_factor: float = 1.0
) -> Floor:
    """Draw a floor of three kinds of ground around a grade.

    Args:
        tread_factor: Slip stiffness of this rover's tread over that of an omnidirectional wheel's rollers.
    """
    names = tuple(str(name) for name in rng.permutation(list(_KINDS)))
    grades = softness_of_kinds(rng, softness, len(names), _KIND_SPREAD)

    def draw_tile(kind: int) -> list[float]:
        return _draw_tile(rng, names[kind], grades[kind], tread_factor)

    kind, grid = lay_tiles(rng, len(names), draw_tile)
    return Floor(seed, machine, softness, names, kind, grid)


def _draw_tile(rng: np.random.Generator, name: str, grade: float, tread_factor: float) -> list[float]:
    """Return the constants of a tile."""
    value = {meaning: between(hard, soft, grade) for meaning, (hard, soft) in _KINDS[name].items()}
    value[SLIP_STIFFNESS] *= tread_factor
    for meaning in (SLIP_STIFFNESS, DRAG, ROLLER):
        value[meaning] *= float(rng.uniform(0.93, 1.07))
    # A fifth of critical for a wheel's share of the mass on its tread.
    value[DAMPING_S_M] = 0.4 * math.sqrt(value[SLIP_STIFFNESS] / value[RELAXATION_M] * 1.3 / 41.0)
    return [value[meaning] for meaning in range(CONSTANTS)]


def draw_floor(seed: int) -> Floor:
    """Draw a floor of three kinds of ground, and the omnidirectional rover that drives on it."""
    rng = np.random.default_rng([seed, 0xB])
    machine = draw_machine(rng)
    return draw_tread_floor(rng, seed, machine, draw_softness(seed, _LEAN))


def steady_slip(floor: Floor, speed_m_s: float = 0.15, direction_rad: float = 0.0) -> float:
    """Return the steady slip of a straight drive across the floor, 1 - true path / path by the wheels."""
    plant = TreadPlant(floor, np.random.default_rng(floor.seed), 0)
    return translation_slip(plant, speed_m_s, direction_rad)
