"""Nature (c): carpet, whose pile gives way elastically, on motors with little current and a sticking gear.

Each wheel bends the fibres under it by a vector w. The fibre tips stick to the wheel up to friction; the
fibres push back by K w and give their energy back when the wheel lets go. Travel of the hub puts fresh,
upright fibres under the wheel:

    dw/dt = v_tip - |v_hub| w / length,    F = -N (K w + D v_tip) + return to the friction limits

This is an elastoplastic contact with a return map (Simo and Hughes 1998, section 1.4) and the turnover of
the bristles of a moving contact (Kalker 1990, section 2.2.2, simplified theory with one compliance). In
steady driving F = N K length s / (1 - s): the slip is counted against the true travel.

Across the axle's direction the rollers turn as soon as the side force reaches their drag; below it the pile
gives and springs back. The pile leans (the nap): against it the pile is stiffer and resists more.
Resistance grows with speed and saturates, since fibres that are not up again cannot be bent a second time.

The motors' output stage limits the current to little more than an ampere, and the gear has the friction of
Stribeck (1902): it sticks with more than it turns with.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from tests.nature.floors.machine import (
    OMNI_ANGLE_RAD,
    Floats,
    centre_motion,
    draw_machine,
    move_body,
    static_load,
)
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

__all__ = ["CarpetPlant", "against_nap", "draw_floor", "pile_force", "pile_resistance"]

# Meaning of a tile's constants.
STIFFNESS: Final = 0  # K, 1/m: push of the pile per load and deflection.
LENGTH_M: Final = 1  # Travel that replaces the fibres under a wheel.
DAMPING_S_M: Final = 2  # D, s/m: rubbing of fibres on fibres, per load.
FRICTION: Final = 3  # Friction coefficient of fibre tips on the wheel.
ROLLER: Final = 4  # Drag per load against the rollers' turning.
RESISTANCE: Final = 5  # Resistance per load against the hub at creeping speed.
RESISTANCE_RISE: Final = 6  # Rise of the resistance up to high speed.
RISE_M_S: Final = 7  # Speed at which half of the rise is reached.
NAP_RAD: Final = 8  # Direction in which the pile leans, in the world frame.
NAP_STIFFNESS: Final = 9  # Relative change of the stiffness with or against the nap.
NAP_RESISTANCE: Final = 10  # Relative change of the resistance with or against the nap.
GIVE_N_M: Final = 11  # Vertical stiffness of the pile under a wheel.
CURRENT_A: Final = 12  # Limit of the motor current; the same on all tiles, as are the next two.
GEAR_STICKING: Final = 13  # Friction of the resting gear over that of the turning gear.
GEAR_RAD_S: Final = 14  # Wheel speed at which the gear's sticking has died out.
CONSTANTS: Final = 15

_SOFT_START_M_S: Final = 1e-2
"""Below this the resistance is proportional to speed: fibres bent so slowly come up again behind the wheel.
So the bent pile can push a resting rover back."""
_FULL_SCALE_A: Final = 2.0
_FULL_SCALE_COUNTS: Final = 1023


class Pile(NamedTuple):
    """State of the pile: deflection of each wheel's fibres (world x, y) and their stiffness just now."""

    x_m: Floats
    y_m: Floats
    stiffness: Floats


@njit(cache=True)
def against_nap(ground: Floats, velocity_x_m_s: float, velocity_y_m_s: float) -> float:
    """Return 1 for travel against the nap, -1 along with it, 0 across and at rest; world frame."""
    speed_m_s = math.sqrt(velocity_x_m_s**2 + velocity_y_m_s**2 + _SOFT_START_M_S**2)
    along = velocity_x_m_s * math.cos(ground[NAP_RAD]) + velocity_y_m_s * math.sin(ground[NAP_RAD])
    return float(-along / speed_m_s)


@njit(cache=True)
def pile_resistance(ground: Floats, speed_m_s: float, against: float) -> float:
    """Return resistance per load and hub velocity, s/m: with the velocity it gives a vector."""
    rise = ground[RESISTANCE_RISE] * speed_m_s / (speed_m_s + ground[RISE_M_S])
    factor = 1.0 + ground[NAP_RESISTANCE] * against
    return float((ground[RESISTANCE] + rise) * factor / math.sqrt(speed_m_s**2 + _SOFT_START_M_S**2))


@njit(cache=True)
def pile_force(
    ground: Floats,
    wheel: int,
    pile: Pile,
    load_n: float,
    against: float,
    tip: Floats,
    travel_m_s: float,
    rim_x: float,
    rim_y: float,
    step_s: float,
) -> tuple[float, float]:
    """Advance the pile under a wheel; return its force along the rim and across, on the wheel.

    Args:
        tip: Velocity of the wheel's surface over the ground, world frame: fibre tips that stick follow it.
        travel_m_s: Speed of the hub.
        rim_x: Direction of the rim in the world frame.
        rim_y: Direction of the rim in the world frame.
    """
    stiffness = ground[STIFFNESS] * (1.0 + ground[NAP_STIFFNESS] * against)
    # Stiffer fibres keep the force and not the deflection, softer ones keep the deflection: so a change of
    # the direction of travel, or of the tile, can only lose energy.
    keep = min(1.0, pile.stiffness[wheel] / stiffness) if pile.stiffness[wheel] > 0.0 else 1.0
    pile.stiffness[wheel] = stiffness
    fresh = 1.0 + step_s * travel_m_s / ground[LENGTH_M]
    x_m = (keep * pile.x_m[wheel] + step_s * tip[0]) / fresh
    y_m = (keep * pile.y_m[wheel] + step_s * tip[1]) / fresh
    along_m, across_m = rim_x * x_m + rim_y * y_m, rim_y * x_m - rim_x * y_m
    # Return map: first the rollers turn, then the tips slide along the rim with the rest of the friction.
    most_across_m = ground[ROLLER] / stiffness
    rolls = abs(across_m) > most_across_m
    across_m = min(most_across_m, max(-most_across_m, across_m))
    most_along_m = math.sqrt(max(0.0, ground[FRICTION] ** 2 - (stiffness * across_m) ** 2)) / stiffness
    slides = abs(along_m) > most_along_m
    along_m = min(most_along_m, max(-most_along_m, along_m))
    pile.x_m[wheel], pile.y_m[wheel] = rim_x * along_m + rim_y * across_m, rim_y * along_m - rim_x * across_m
    # Fibres rub on each other only while they follow the wheel.
    rub_along = 0.0 if slides else ground[DAMPING_S_M] * (rim_x * tip[0] + rim_y * tip[1])
    rub_across = 0.0 if rolls else ground[DAMPING_S_M] * (rim_y * tip[0] - rim_x * tip[1])
    return -load_n * (stiffness * along_m + rub_along), -load_n * (stiffness * across_m + rub_across)


@njit(cache=True)
def _gear_sticking(ground: Floats, speed_rad_s: float) -> float:
    """Return the gear's friction over that of a gear that turns: it falls from sticking to turning."""
    sticking = (ground[GEAR_STICKING] - 1.0) * math.exp(-((speed_rad_s / ground[GEAR_RAD_S]) ** 2))
    return float(1.0 + sticking)


@njit(cache=True)
def _wheel_step(rover: Rover, pile: Pile, wheel: int, tip: Floats) -> None:
    """Advance one wheel and add its force to the body's; `tip` is room for the velocity of its surface."""
    machine, load_n = rover.machine, rover.load_n[wheel]
    cosine, sine = math.cos(OMNI_ANGLE_RAD[wheel]), math.sin(OMNI_ANGLE_RAD[wheel])
    turn_c, turn_s = rover.motion[5], rover.motion[6]
    ground = ground_under(rover, wheel)
    along_m_s, across_m_s = hub_velocity(rover, wheel, machine.arm_m)
    # Directions of rim and axle in the world frame; (rim_y, -rim_x) points outwards along the axle.
    rim_x, rim_y = -turn_c * sine - turn_s * cosine, -turn_s * sine + turn_c * cosine
    hub_x = rim_x * along_m_s + rim_y * across_m_s
    hub_y = rim_y * along_m_s - rim_x * across_m_s
    speed_rad_s = rover.drive.speed_rad_s[wheel]
    rim_m_s = machine.radius_m * speed_rad_s
    against = against_nap(ground, hub_x, hub_y)
    travel_m_s = math.hypot(hub_x, hub_y)
    tip[0], tip[1] = hub_x - rim_m_s * rim_x, hub_y - rim_m_s * rim_y
    along_n, across_n = pile_force(
        ground, wheel, pile, load_n, against, tip, travel_m_s, rim_x, rim_y, rover.step_s
    )
    resistance = load_n * pile_resistance(ground, travel_m_s, against)
    push_hub(
        rover,
        wheel,
        machine.arm_m,
        along_n - resistance * along_m_s,
        across_n - resistance * across_m_s,
    )
    turn_wheel(rover, wheel, machine.radius_m * along_n, _gear_sticking(ground, speed_rad_s))


@njit(cache=True)
def _run(rover: Rover, pile: Pile, first: int, steps: int, lifted: bool) -> None:
    """Integrate `steps` steps."""
    set_loads(rover, lifted, rover.machine.com_x_m, rover.machine.com_y_m)
    tip = np.empty(2)
    for step in range(first, first + steps):
        begin_step(rover, step)
        for wheel in range(3):
            _wheel_step(rover, pile, wheel, tip)
        move_body(rover.machine, rover.body, rover.wrench, rover.step_s)


class CarpetPlant(OmniPlant):
    """A rover on carpet; arguments as of `RoverPlant`."""

    def _prepare(self) -> None:
        self._pile = Pile(np.zeros(3), np.zeros(3), np.zeros(3))

    def _integrate(self, steps: int) -> None:
        _run(self.rover, self._pile, self._steps, steps, self._lifted)

    def _tilt(self) -> tuple[float, float]:
        """Return roll and pitch of a frame whose wheels sink into the pile by their loads and tiles."""
        if self._lifted:
            return 0.0, 0.0
        machine = self.machine
        x_m, y_m, *_ = centre_motion(machine, self.body)
        ahead, left = 0.0, 0.0
        for angle in OMNI_ANGLE_RAD:
            at_x, at_y = machine.arm_m * math.cos(angle), machine.arm_m * math.sin(angle)
            cosine, sine = math.cos(self.body[2]), math.sin(self.body[2])
            row, column = self.floor.tile_at(
                x_m + cosine * at_x - sine * at_y, y_m + sine * at_x + cosine * at_y
            )
            load_n = static_load(machine, at_x, at_y, machine.com_x_m, machine.com_y_m)
            sink_m = load_n / float(self.floor.grid.constants[row, column, GIVE_N_M])
            slope = 2.0 / (3.0 * machine.arm_m**2) * sink_m
            ahead, left = ahead + slope * at_x, left + slope * at_y
        return -left, ahead

    def current_counts(self) -> tuple[int, ...]:
        """Return the motor currents as the board's 10-bit converter gives them: without sign, 2 A at most."""
        return tuple(
            min(_FULL_SCALE_COUNTS, int(abs(float(current_a)) / _FULL_SCALE_A * _FULL_SCALE_COUNTS))
            for current_a in self.drive.current_a
        )


_KINDS: Final = table_of_kinds(
    ("needle felt", "loop pile", "cut pile"),
    {
        # Hard and soft end; the tile's grade lies between.
        STIFFNESS: ((380.0, 20.0), (330.0, 15.0), (290.0, 12.5)),
        LENGTH_M: ((0.016, 0.012), (0.018, 0.014), (0.020, 0.016)),
        FRICTION: ((0.80, 0.55), (0.75, 0.55), (0.70, 0.50)),
        ROLLER: ((0.030, 0.060), (0.035, 0.065), (0.035, 0.060)),
        RESISTANCE: ((0.020, 0.090), (0.025, 0.080), (0.025, 0.070)),
        RESISTANCE_RISE: ((0.010, 0.030), (0.015, 0.050), (0.020, 0.060)),
        NAP_STIFFNESS: ((0.03, 0.05), (0.05, 0.10), (0.10, 0.20)),
        NAP_RESISTANCE: ((0.03, 0.06), (0.05, 0.10), (0.10, 0.20)),
        GIVE_N_M: ((6e4, 2.5e4), (4e4, 1.5e4), (3e4, 1.0e4)),
    },
)
"""Origins are in README.md."""
_LEAN: Final = 1.35
"""How far the floors' grades lean to the soft end."""


def draw_floor(seed: int) -> Floor:
    """Draw a floor of three kinds of carpet, and the rover that drives on it."""
    rng = np.random.default_rng([seed, 0xC])
    machine = draw_machine(rng)
    softness = draw_softness(seed, _LEAN)
    kinds = draw_kinds(rng, softness, _KINDS)
    # Each kind comes off its own roll, so its tiles share the nap up to the care of the layer.
    naps_rad = rng.uniform(-math.pi, math.pi, len(kinds))
    drives = [float(rng.uniform(0.9, 1.3)), float(rng.uniform(1.2, 1.6)), float(rng.uniform(0.1, 0.4))]
    machine = machine._replace(current_limit_a=drives[0])

    def draw_tile(kind: int) -> list[float]:
        nap_rad = float(naps_rad[kind] + rng.uniform(-0.15, 0.15))
        return _draw_tile(rng, *kinds[kind], nap_rad) + drives

    return lay_floor(rng, seed, machine, softness, kinds, draw_tile)


def _draw_tile(rng: np.random.Generator, name: str, grade: float, nap_rad: float) -> list[float]:
    """Return the constants STIFFNESS to GIVE_N_M of a tile."""
    value = graded(_KINDS[name], grade)
    scatter(rng, value, (STIFFNESS, RESISTANCE, ROLLER))
    value[NAP_RAD] = nap_rad
    value[RISE_M_S] = float(rng.uniform(0.05, 0.15))
    # A fifth of critical for a wheel's share of the mass on the pile.
    value[DAMPING_S_M] = 0.4 * math.sqrt(value[STIFFNESS] * 1.3 / 41.0)
    return [value[meaning] for meaning in range(CURRENT_A)]
