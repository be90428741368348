"""Nature (d): contacts whose friction falls at larger slip, of four families, mixed patch by patch.

All have one deflection u of the contact along the rim, with sliding v and running speed r (rim and roller
together: a turning roller carries fresh tread into the contact, too), and a force per load

    du/dt = v - |r| u / l - [sigma0 |v| u / g(v)],    F / N = f(u) + sigma1 fade(v) du/dt + film(v).

`TYRE`: Magic Formula of Pacejka, "Tire and Vehicle Dynamics" (2012), section 4.3, without curvature factor,
over the transient slip s = u / l of section 7.2.1: f = D sin(C atan(B s)). B and C come from the slip of the
peak and from the fall, 1 - f(1) / D.

`STRIBECK`: LuGre tyre, average lumped form, of Canudas de Wit, Tsiotras, Velenis, Basset, Gissinger (2003):
f = sigma0 u, g(v) = Coulomb + (static - Coulomb) exp(-(v / v_s)^2), film = sigma2 v. Here the term in
brackets counts, too.

`LOOSE`: shear of Janosi and Hanamoto (1961), averaged over a contact of length l under even pressure (Wong
2008, section 2.4): with the shear u at its end, f = tan(phi) (1 - (K / u) (1 - exp(-u / K))). Traction
saturates, but the wheel digs: sinkage grows by (1 + a s) / (1 - a s / 2) (form of Lyasko 2010), compaction
with it, bulldozing with its square (Bekker 1969). What is left to pull with has a peak and falls.

`WET`: a low adhesion that is lost over a sliding velocity (exponential of Tustin 1947), and a film of water
that takes over with v^0.6 (soft lubrication: de Vicente, Stokes, Spikes 2005): friction falls, then rises.
The deflection is that of `STRIBECK`.

Each f has the sign of u, so the energy of the deflection never pays for more than was put in.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from tests.nature.floors.machine import Floats, draw_machine, move_body
from tests.nature.floors.patchwork import (
    Ends,
    Floor,
    between,
    draw_kinds,
    draw_softness,
    graded,
    lay_floor,
    scatter,
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

__all__ = ["FallingPlant", "contact_force", "drag_share", "draw_floor", "friction_level"]

# Families of ground.
TYRE: Final = 0
STRIBECK: Final = 1
LOOSE: Final = 2
WET: Final = 3

# Meaning of a tile's constants; those that a family does not have are 0.
FAMILY: Final = 0
STIFFNESS: Final = 1  # Rise of f per deflection at rest, 1/m; sigma0 of `STRIBECK` and `WET`.
DAMPING: Final = 2  # sigma1, s/m.
LENGTH_M: Final = 3  # l: relaxation length.
FRICTION: Final = 4  # D, Coulomb friction, tan(phi), or what is left between adhesion and film.
STATIC: Final = 5  # Friction at rest, of `STRIBECK` and `WET`.
FALL_M_S: Final = 6  # Sliding velocity of the fall, of `STRIBECK` and `WET`.
FILM: Final = 7  # Friction coefficient of the film at 0.1 m/s of sliding, of `STRIBECK` and `WET`.
SHAPE: Final = 8  # C of `TYRE`.
STEEPNESS: Final = 9  # B of `TYRE`.
SHEAR_M: Final = 10  # K of `LOOSE`.
DIGGING: Final = 11  # a of `LOOSE`: share of slip sinkage; 1 is deep soil.
BULLDOZING: Final = 12  # Bulldozing over compaction at no slip, of `LOOSE`.
RESISTANCE: Final = 13  # Force per load against the hub's motion, at no slip.
RESISTANCE_S_M: Final = 14  # Rise of the resistance per hub speed.
ROLLER: Final = 15  # Drag per load against the rollers' turning.
CONSTANTS: Final = 16

_FILM_M_S: Final = 0.1
_FILM_POWER: Final = 0.6
_THIN_M_S: Final = 1e-3
"""Below this the film's friction is proportional to the sliding velocity."""
_DAMPING_M_S: Final = 0.02
"""Sliding velocity at which the deflection's damping has died out (Olsson 1996)."""
_SOFT_START_M_S: Final = 2e-3
"""Below this drag is proportional to speed: there is no slope that it has to hold."""


class Contact(NamedTuple):
    """State of the contacts: deflection along the rim, and the stiffness of the tile it was made on."""

    along_m: Floats
    stiffness: Floats


@njit(cache=True)
def friction_level(ground: Floats, sliding_m_s: float) -> float:
    """Return g(v) of `STRIBECK` and `WET`, per unit of load, without the film."""
    part = abs(sliding_m_s) / ground[FALL_M_S]
    if ground[FAMILY] == STRIBECK:
        part *= part
    return float(ground[FRICTION] + (ground[STATIC] - ground[FRICTION]) * math.exp(-part))


@njit(cache=True)
def _film(ground: Floats, sliding_m_s: float) -> float:
    """Return the film's friction, with the sign of the sliding."""
    share = sliding_m_s / _FILM_M_S
    if ground[FAMILY] == WET:
        thin = (sliding_m_s**2 + _THIN_M_S**2) / _FILM_M_S**2
        share *= math.exp(0.5 * (_FILM_POWER - 1.0) * math.log(thin))
    return float(ground[FILM] * share)


@njit(cache=True)
def contact_force(
    ground: Floats, load_n: float, sliding_m_s: float, running_m_s: float, deflection_m: float, step_s: float
) -> tuple[float, float]:
    """Return the force on the ground's side that follows the sliding, and the new deflection.

    The deflection's step is implicit. That of `TYRE` and `LOOSE` ends at a slip of 1: it would wind up
    otherwise, with a wheel locked.
    """
    family, length_m = ground[FAMILY], ground[LENGTH_M]
    fading_s = abs(running_m_s) / length_m
    film = 0.0
    if family in (TYRE, LOOSE):
        new_m = (deflection_m + step_s * sliding_m_s) / (1.0 + step_s * fading_s)
        new_m = min(length_m, max(-length_m, new_m))
        if family == TYRE:
            angle = ground[SHAPE] * math.atan(ground[STEEPNESS] * new_m / length_m)
            force = ground[FRICTION] * math.sin(angle)
        else:
            part = abs(new_m) / ground[SHEAR_M]
            share = 0.5 * part if part < 1e-5 else 1.0 + math.expm1(-part) / part
            force = ground[FRICTION] * math.copysign(share, new_m)
    else:
        # The rollers' drag uses up a part of the friction circle.
        level = friction_level(ground, sliding_m_s)
        level *= math.sqrt(max(0.04, 1.0 - (ground[ROLLER] / level) ** 2))
        fading_s += ground[STIFFNESS] * abs(sliding_m_s) / level
        new_m = (deflection_m + step_s * sliding_m_s) / (1.0 + step_s * fading_s)
        force = ground[STIFFNESS] * new_m
        film = _film(ground, sliding_m_s)
    damping = ground[DAMPING] * math.exp(-((sliding_m_s / _DAMPING_M_S) ** 2))
    return load_n * (force + damping * (new_m - deflection_m) / step_s + film), new_m


@njit(cache=True)
def drag_share(ground: Floats, speed_m_s: float, deflection_m: float) -> float:
    """Return resistance per load and hub velocity, s/m: with the velocity it gives a vector."""
    digging = ground[DIGGING] * min(1.0, abs(deflection_m) / ground[LENGTH_M])
    sinkage = (1.0 + digging) / (1.0 - 0.5 * digging)
    growth = sinkage * (1.0 + ground[BULLDOZING] * sinkage) / (1.0 + ground[BULLDOZING])
    drag = ground[RESISTANCE] * growth + ground[RESISTANCE_S_M] * speed_m_s
    return float(drag / math.sqrt(speed_m_s**2 + _SOFT_START_M_S**2))


@njit(cache=True)
def _carry_over(contact: Contact, wheel: int, stiffness: float) -> None:
    """Take a deflection to another tile: on stiffer ground it keeps its force, on softer its length.

    Either way a contact that does not slide yet gains no energy.
    """
    if stiffness > contact.stiffness[wheel]:
        contact.along_m[wheel] *= contact.stiffness[wheel] / stiffness
    contact.stiffness[wheel] = stiffness


@njit(cache=True)
def _wheel_step(rover: Rover, contact: Contact, wheel: int) -> None:
    """Advance one wheel and add its force to the body's."""
    machine, load_n = rover.machine, rover.load_n[wheel]
    ground = ground_under(rover, wheel)
    if ground[STIFFNESS] != contact.stiffness[wheel]:
        _carry_over(contact, wheel, ground[STIFFNESS])
    along_m_s, across_m_s = hub_velocity(rover, wheel, machine.arm_m)
    rim_m_s = machine.radius_m * rover.drive.speed_rad_s[wheel]
    sliding_m_s, running_m_s = rim_m_s - along_m_s, math.hypot(rim_m_s, across_m_s)
    traction_n, contact.along_m[wheel] = contact_force(
        ground, load_n, sliding_m_s, running_m_s, contact.along_m[wheel], rover.step_s
    )
    drag = drag_share(ground, math.hypot(along_m_s, across_m_s), contact.along_m[wheel]) * load_n
    roller = ground[ROLLER] * load_n / math.hypot(across_m_s, _SOFT_START_M_S)
    push_hub(rover, wheel, machine.arm_m, traction_n - drag * along_m_s, -(drag + roller) * across_m_s)
    turn_wheel(rover, wheel, machine.radius_m * traction_n, 1.0)


@njit(cache=True)
def _run(rover: Rover, contact: Contact, first: int, steps: int, lifted: bool) -> None:
    """Integrate `steps` steps."""
    set_loads(rover, lifted, rover.machine.com_x_m, rover.machine.com_y_m)
    for step in range(first, first + steps):
        begin_step(rover, step)
        for wheel in range(3):
            _wheel_step(rover, contact, wheel)
        move_body(rover.machine, rover.body, rover.wrench, rover.step_s)


class FallingPlant(OmniPlant):
    """A rover on ground whose friction falls at larger slip; arguments as of `RoverPlant`."""

    def _prepare(self) -> None:
        self._contact = Contact(np.zeros(3), np.zeros(3))

    def _integrate(self, steps: int) -> None:
        _run(self.rover, self._contact, self._steps, steps, self._lifted)


_KINDS: Final[dict[str, tuple[int, dict[int, Ends]]]] = {
    # Family, then hard and soft end; the tile's grade lies between.
    "tyre": (
        TYRE,
        {
            FRICTION: (0.70, 0.28),
            LENGTH_M: (0.004, 0.012),
            RESISTANCE: (0.028, 0.055),
            RESISTANCE_S_M: (0.02, 0.30),
            ROLLER: (0.020, 0.045),
        },
    ),
    "stribeck": (
        STRIBECK,
        {
            FRICTION: (0.42, 0.16),
            FALL_M_S: (0.040, 0.020),
            FILM: (0.005, 0.050),
            STIFFNESS: (900.0, 500.0),
            LENGTH_M: (0.008, 0.014),
            RESISTANCE: (0.028, 0.068),
            RESISTANCE_S_M: (0.02, 0.15),
            ROLLER: (0.020, 0.045),
        },
    ),
    "loose": (
        LOOSE,
        {
            FRICTION: (0.60, 0.45),
            LENGTH_M: (0.020, 0.030),
            SHEAR_M: (0.002, 0.009),
            DIGGING: (0.80, 0.75),
            BULLDOZING: (0.2, 0.3),
            RESISTANCE: (0.030, 0.046),
            RESISTANCE_S_M: (0.02, 0.10),
            ROLLER: (0.025, 0.050),
        },
    ),
    "wet": (
        WET,
        {
            FRICTION: (0.18, 0.07),
            FALL_M_S: (0.030, 0.015),
            FILM: (0.03, 0.09),
            STIFFNESS: (1000.0, 1000.0),
            LENGTH_M: (0.008, 0.012),
            RESISTANCE: (0.022, 0.053),
            RESISTANCE_S_M: (0.02, 0.10),
            ROLLER: (0.020, 0.040),
        },
    ),
}
"""Origins are in README.md."""
_PEAK_SLIP: Final = (0.10, 0.30)
"""Slip of the peak of `TYRE`, hard and soft end."""
_FALLS: Final = (0.2, 0.6)
"""Fall of `TYRE` from its peak to a slip of 1, as part of the peak."""
_STATIC_FACTORS: Final = {STRIBECK: (1.3, 2.5), WET: (2.8, 4.0)}
"""Static friction over `FRICTION`."""
_LEAN: Final = 2.6
"""How far the floors' grades lean to the soft end."""


def draw_floor(seed: int) -> Floor:
    """Draw a floor of all four families, and the omnidirectional rover that drives on it."""
    rng = np.random.default_rng([seed, 0xD])
    machine = draw_machine(rng)
    softness = draw_softness(seed, _LEAN)
    kinds = draw_kinds(rng, softness, _KINDS)
    return lay_floor(rng, seed, machine, softness, kinds, lambda kind: _draw_tile(rng, *kinds[kind]))


def _draw_tile(rng: np.random.Generator, name: str, grade: float) -> list[float]:
    """Return the constants of a tile."""
    family, ends = _KINDS[name]
    value = dict.fromkeys(range(CONSTANTS), 0.0) | graded(ends, grade) | {FAMILY: float(family)}
    scatter(rng, value, (FRICTION, LENGTH_M, RESISTANCE, ROLLER))
    if family == TYRE:
        value[SHAPE], value[STEEPNESS] = _tyre_curve(between(*_PEAK_SLIP, grade), float(rng.uniform(*_FALLS)))
        value[STIFFNESS] = value[FRICTION] * value[SHAPE] * value[STEEPNESS] / value[LENGTH_M]
    elif family == LOOSE:
        value[STIFFNESS] = 0.5 * value[FRICTION] / value[SHEAR_M]
    else:
        value[STATIC] = value[FRICTION] * float(rng.uniform(*_STATIC_FACTORS[family]))
        value[STIFFNESS] *= float(rng.uniform(0.93, 1.07))
    # A fifth of critical for a wheel's share of the mass on its contact.
    value[DAMPING] = 0.4 * math.sqrt(value[STIFFNESS] * 1.3 / 41.0)
    return [value[meaning] for meaning in range(CONSTANTS)]


def _tyre_curve(peak_slip: float, fall: float) -> tuple[float, float]:
    """Return C and B of the Magic Formula with this slip of the peak and this fall to a slip of 1."""
    low, high = 1.01, 2.8
    for _ in range(50):
        shape = 0.5 * (low + high)
        steepness = math.tan(0.5 * math.pi / shape) / peak_slip
        if 1.0 - math.sin(shape * math.atan(steepness)) < fall:
            low = shape
        else:
            high = shape
    return shape, steepness
