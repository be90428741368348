"""Sites on which a three-wheeled omnidirectional rover nearly gets stuck: truth for what judges its slip.

The rover starts on ordinary ground. Once its distance from the start exceeds a limit, in any direction, the
constants of the ground under it change for good. Beyond, a rover commanded straight on creeps at a few per
cent of its wheels' travel (`draw_stuck`), or drives on at another slip (`draw_healthy`). Nothing holds it:
soft ground takes nearly all of its traction. The ground is made in three steps: friction, stiffness and the
other constants of the law are drawn; the slip wanted is drawn; then bisection over the resistance against the
hubs finds that slip, as it comes out of the plant's own truth. A ground that has no such resistance, or that
the rover does not get on to in the state wanted (a falling law can have two), is drawn again.

It knows nothing of any estimator.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from tests.nature import omni_contact
from tests.nature.floors import NATURES, Nature, bristle, carpet, falling, tread
from tests.nature.floors.bristle import BristlePlant
from tests.nature.floors.carpet import CarpetPlant
from tests.nature.floors.falling import FallingPlant
from tests.nature.floors.machine import NANOSECONDS, OMNI_ANGLE_RAD, Floats
from tests.nature.floors.patchwork import Floor, Grid
from tests.nature.floors.rover import OmniPlant
from tests.nature.floors.tread import TreadPlant
from tests.nature.omni_contact import OmniContact

__all__ = ["LAWS", "Site", "SitePlant", "Slips", "draw_healthy", "draw_stuck", "drive_slips"]

LAWS: Final = ("bristle", "tread", "carpet", "falling", *omni_contact.LAWS)

SPEED_M_S: Final = 0.15
STUCK_SLIP: Final = (0.90, 0.985)
HEALTHY_SLIP: Final = (0.02, 0.70)
AT_M: Final = (0.2, 0.7)

_CHECK_NS: Final = 5_000_000
"""The distance from the start is looked at this often, counted from the start time."""
_RELAY_NS: Final = 20_000_000
"""Ground that differs from wheel to wheel is laid anew this often, if the rover has moved."""
_TILE_M: Final = 0.05
_TILES: Final = 16
_SAMPLE_NS: Final = 50_000_000
_PATIENCE_S: Final = 20.0
SETTLE_S: Final = 4.0
"""A pile under creeping wheels takes seconds to bend."""
_LATE_S: Final = 15.0
"""A slip is steady that is still there so long after the ground changed."""
_WINDOW_S: Final = 4.0
_SEARCH_AT_M: Final = 0.15
_SEARCH_SLIP: Final = 0.002
_GOOD_SLIP: Final = 0.006
_LATE_SLIP: Final = 0.012
_ORDINARY_SLIP: Final = (0.0, 0.35)
_LEAST_WHEELS: Final = 0.5
"""The wheels make at least this part of the travel commanded: less counts as motors that stall."""
_JUMP_RATIO: Final = 1.02
_JUMP_SLIP: Final = 0.15
"""Bisection gives up where so little more resistance makes so much more slip: the law jumps there."""
_STALLED: Final = 2.0
"""Stands for the slip of a rover whose motors stall: too much resistance."""
_STALL_RATIO: Final = 1.5
"""Bisection gives up where so little more resistance stalls the motors, and the slip is not reached yet."""
_ATTEMPTS: Final = 200


class ChangingRover(OmniPlant):
    """A rover of `tests/nature/floors` whose ground changes for good at a distance from its start.

    Args:
        floor: The ordinary ground and the rover's constants.
        rng: Source of what differs between two runs on one floor.
        start_ns: Time of the start.
        at_m: The distance.
        beyond: Constants of the ground under each wheel from there on; a row per wheel.
    """

    def __init__(
        self, floor: Floor, rng: np.random.Generator, start_ns: int, *, at_m: float, beyond: Floats
    ) -> None:
        super().__init__(floor, rng, start_ns)
        self.at_m, self.is_beyond = at_m, False
        self._beyond = beyond
        self._uneven = bool(np.any(beyond != beyond[0]))
        self._check_ns = start_ns + _CHECK_NS
        self._laid = np.zeros(3)

    def advance(self, t_ns: int) -> None:
        """Integrate to the last step at or before `t_ns`; looks at the distance on a fixed grid of times."""
        while self._check_ns <= t_ns and (self._uneven or not self.is_beyond):
            super().advance(self._check_ns)
            self._check_ns += _RELAY_NS if self.is_beyond else _CHECK_NS
            truth = self.truth()
            place = np.array([truth.x_m, truth.y_m, truth.yaw_rad])
            if not self.is_beyond and math.hypot(truth.x_m, truth.y_m) > self.at_m:
                self.is_beyond = True
                self._lay(place)
            elif self.is_beyond and np.any(np.abs(place - self._laid) > (0.015, 0.015, 0.1)):
                self._lay(place)
        super().advance(t_ns)

    def _lay(self, place: Floats) -> None:
        """Lay the ground beyond: each tile is of the wheel nearest to it, so far from any wheel's edge."""
        count = _TILES if self._uneven else 1
        corner_m = -0.5 * _TILE_M * count
        middle_m = corner_m + _TILE_M * (np.arange(count) + 0.5)
        angles = place[2] + np.array(OMNI_ANGLE_RAD)
        aside_x = middle_m[None, :, None] - self.machine.arm_m * np.cos(angles)
        aside_y = middle_m[:, None, None] - self.machine.arm_m * np.sin(angles)
        nearest = np.argmin(np.hypot(aside_x, aside_y), axis=-1)
        constants = np.ascontiguousarray(self._beyond[nearest])
        grid = Grid(constants, float(place[0]) + corner_m, float(place[1]) + corner_m, _TILE_M)
        self.floor = dataclasses.replace(self.floor, kind=np.zeros((count, count), dtype=np.int64), grid=grid)
        self.rover = self.rover._replace(grid=grid)
        self._laid = place


class ChangingBristle(ChangingRover, BristlePlant):
    """Traction follows the slip velocity."""


class ChangingTread(ChangingRover, TreadPlant):
    """Traction follows the slip ratio."""


class ChangingCarpet(ChangingRover, CarpetPlant):
    """A pile bends and springs back."""


class ChangingFalling(ChangingRover, FallingPlant):
    """Traction falls at larger slip."""


@dataclass
class ChangingOmni(OmniContact):
    """A rover of `omni_contact.py` whose ground changes for good at a distance from its start.

    Args:
        at_m: The distance.
        beyond: Constants of the ground from there on, as of a tile.
        factors: Grip and drag of the ground beyond under each wheel, over those of `beyond`.
    """

    at_m: float = 0.5
    beyond: tuple[float, ...] = (0.2, 2.0, 0.05, 0.05)
    factors: tuple[float, ...] = (1.0, 1.0, 1.0)
    is_beyond: bool = False

    def advance(self, t_ns: int) -> None:
        """Integrate to the last step before `t_ns`; looks at the distance on a fixed grid of times."""
        while not self.is_beyond and self._next_check_ns() <= t_ns:
            super().advance(self._next_check_ns())
            if math.hypot(self._pose[0], self._pose[1]) > self.at_m:
                self.is_beyond = True
                floor = self.floor
                self.floor = omni_contact.Floor.uniform(floor.law, floor.relaxation_m, self.beyond)
                self._loads_n = self._loads_n * np.array(self.factors)
        super().advance(t_ns)

    def _next_check_ns(self) -> int:
        return self._t_ns + _CHECK_NS - (self._t_ns - self.start_ns) % _CHECK_NS


SitePlant = ChangingRover | ChangingOmni


class Slips(NamedTuple):
    """What a drive straight on tells, by the plant's truth.

    Attributes:
        before: Slip of the travel on the ordinary ground, from 0.4 of the distance on to where it ends.
        beyond: Steady slip of the travel on the ground beyond; not a number if the rover does not get there.
        wheels_m_s: Speed of the travel by the wheels' turns, beyond.
        straightness: Way as the crow flies over path, beyond.
    """

    before: float
    beyond: float
    wheels_m_s: float
    straightness: float


_NOWHERE: Final = Slips(math.nan, math.nan, 0.0, 0.0)


def _kinematics(plant: SitePlant) -> Floats:
    """Return the wheel speeds (rad/s) per body velocity, if all wheels roll rigidly."""
    if isinstance(plant, ChangingRover):
        rolling: Floats = plant.kinematics / plant.machine.radius_m
        return rolling
    body = plant.body
    angles = np.radians(body.angles_deg)
    return np.column_stack((-np.sin(angles), np.cos(angles), np.full(3, body.arm_m))) / body.radius_m


class _Paths:
    """Adds up the true path and the path by the wheels' turns of a rover that drives."""

    def __init__(self, plant: SitePlant) -> None:
        self._plant, self._inverse = plant, np.linalg.inv(_kinematics(plant))
        self._place, self._turns = self._state()
        self._first = self._place
        self.true_m = self.wheels_m = 0.0

    def _state(self) -> tuple[Floats, Floats]:
        truth = self._plant.truth()
        return np.array([truth.x_m, truth.y_m]), np.array(truth.wheel_position_rad)

    def advance(self, t_ns: int) -> None:
        """Drive on to a time."""
        self._plant.advance(t_ns)
        place, turns = self._state()
        self.true_m += float(np.hypot(*(place - self._place)))
        self.wheels_m += float(np.hypot(*(self._inverse @ (turns - self._turns))[:2]))
        self._place, self._turns = place, turns

    def slip(self) -> float:
        """Return 1 - true path / path by the wheels."""
        return 1.0 - self.true_m / self.wheels_m if self.wheels_m > 0.0 else 0.0

    def straightness(self) -> float:
        """Return the way as the crow flies over the path."""
        return float(np.hypot(*(self._place - self._first))) / self.true_m if self.true_m > 0.0 else 0.0


def drive_slips(
    plant: SitePlant,
    direction_rad: float = 0.0,
    speed_m_s: float = SPEED_M_S,
    settle_s: float = SETTLE_S,
) -> Slips:
    """Drive a rover at rest straight on in its own frame and return the slips before and beyond.

    Args:
        plant: It is driven.
        direction_rad: Of the velocity, in the body frame.
        speed_m_s: Body speed by rigid rolling.
        settle_s: From where the ground changes to where the slip beyond begins to count, over four seconds.
    """
    velocity = np.array([speed_m_s * math.cos(direction_rad), speed_m_s * math.sin(direction_rad), 0.0])
    plant.set_wheel_speeds((_kinematics(plant) @ velocity).tolist())
    start_ns = t_ns = plant.truth().t_ns
    paths = _Paths(plant)
    before: _Paths | None = None
    slip = 0.0
    while not plant.is_beyond:
        if t_ns - start_ns > _PATIENCE_S * NANOSECONDS:
            return _NOWHERE
        slip = slip if before is None else before.slip()
        t_ns += _SAMPLE_NS
        (before or paths).advance(t_ns)
        truth = plant.truth()
        if before is None and math.hypot(truth.x_m, truth.y_m) > 0.4 * plant.at_m:
            before = _Paths(plant)
    t_ns += round(settle_s * NANOSECONDS)
    plant.advance(t_ns)
    beyond = _Paths(plant)
    for end_ns in range(t_ns, t_ns + round(_WINDOW_S * NANOSECONDS), _SAMPLE_NS):
        beyond.advance(end_ns + _SAMPLE_NS)
    return Slips(slip, beyond.slip(), beyond.wheels_m / _WINDOW_S, beyond.straightness())


@dataclass(frozen=True)
class Scene:
    """A rover, its ordinary ground and the ground beyond.

    Attributes:
        law: One of `LAWS`.
        ordinary: The ordinary ground; with the rover's constants in case of `tests/nature/floors`.
        body: The rover, of the other laws.
        beyond: Constants of the ground beyond, under a wheel that grips like the others.
        better: The wheel that grips better beyond, or None.
        grip: Friction under that wheel over that under the others.
        drag: Resistance under that wheel over that under the others; it is `grip`, too, of `omni_contact.py`.
    """

    law: str
    ordinary: Floor | omni_contact.Floor
    body: omni_contact.Body
    beyond: Floats
    better: int | None = None
    grip: float = 1.0
    drag: float = 1.0

    def plant(self, seed: int, start_ns: int, at_m: float) -> SitePlant:
        """Return the rover at rest at its start."""
        if not isinstance(self.ordinary, Floor):
            factors = [self.grip if wheel == self.better else 1.0 for wheel in range(3)]
            return ChangingOmni(
                self.ordinary,
                start_ns,
                self.body,
                at_m=at_m,
                beyond=tuple(self.beyond.tolist()),
                factors=tuple(factors),
            )
        kind = _FLOORS[self.law]
        wheels = np.tile(self.beyond, (3, 1))
        if self.better is not None:
            wheels[self.better, list(kind.grips)] *= self.grip
            wheels[self.better, kind.nature.resistance] *= self.drag
        rng = np.random.default_rng([seed, 0xE])
        return kind.plant(self.ordinary, rng, start_ns, at_m=at_m, beyond=wheels)

    def resisting(self, resistance: float) -> "Scene":
        """Return the same scene with another resistance of the ground beyond."""
        beyond = self.beyond.copy()
        if self.law in _FLOORS:
            beyond[_FLOORS[self.law].nature.resistance] = resistance
        else:
            # The rollers' drag comes on top of the hub's resistance, which acts in every direction.
            beyond[3] += resistance - beyond[2]
            beyond[2] = resistance
        return dataclasses.replace(self, beyond=beyond)


@dataclass
class Site:
    """A place at which the ground changes, and the rover that drives there.

    Attributes:
        law: One of `LAWS`.
        at_m: The ground changes at this distance from the start.
        target_slip: Slip of the travel beyond that was drawn.
        steady_slip: The slip that comes out, driving straight on in `direction_rad` at 0.15 m/s.
        uneven: Whether a wheel grips better than the others beyond.
        direction_rad: Of that drive, in the body frame.
        ordinary_slip: Slip of the travel on the ordinary ground, in the same drive.
    """

    law: str
    seed: int
    at_m: float
    target_slip: float
    steady_slip: float
    uneven: bool
    direction_rad: float = 0.0
    ordinary_slip: float = 0.0
    scene: Scene | None = field(default=None, repr=False)

    def plant(self, start_ns: int) -> SitePlant:
        """Return the rover at rest at the origin with yaw 0; every one moves alike."""
        if self.scene is None:
            raise ValueError("a site is drawn by draw_stuck or draw_healthy")
        return self.scene.plant(self.seed, start_ns, self.at_m)


class _Kind(NamedTuple):
    """What a law of `tests/nature/floors` needs here.

    Attributes:
        grips: Constants that friction scales.
        fixed: Constants that belong to the rover, the same on all ground.
        soften: Makes ordinary ground one to get stuck in, but for its resistance.
    """

    nature: Nature
    plant: type[ChangingRover]
    grips: tuple[int, ...]
    fixed: tuple[int, ...]
    soften: Callable[[np.random.Generator, Floats], None]


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a positive number, as likely in each octave."""
    return math.exp(float(rng.uniform(math.log(low), math.log(high))))


def _soften_bristle(rng: np.random.Generator, ground: Floats) -> None:
    ground[list(_BRISTLE_GRIPS)] *= _log(rng, 0.25, 0.9)
    ground[bristle.VISCOUS] = _log(rng, 0.05, 1.5)


def _soften_tread(rng: np.random.Generator, ground: Floats) -> None:
    factor = _log(rng, 0.2, 0.8)
    ground[tread.FRICTION] *= factor
    ground[tread.SLIP_STIFFNESS] = ground[tread.FRICTION] * _log(rng, 1.5, 12.0)
    ground[tread.DRAG_S_M] = _log(rng, 0.05, 10.0)
    ground[tread.ROLLER] *= factor


def _soften_carpet(rng: np.random.Generator, ground: Floats) -> None:
    # The motors have little current: they would stall on much friction.
    ground[carpet.FRICTION] = float(rng.uniform(0.10, 0.26))
    ground[carpet.STIFFNESS] *= _log(rng, 0.1, 1.0)
    ground[carpet.RESISTANCE_RISE] *= _log(rng, 0.5, 3.0)
    ground[carpet.ROLLER] *= float(rng.uniform(0.3, 1.0))
    # Pile that is trodden down leans less.
    ground[[carpet.NAP_STIFFNESS, carpet.NAP_RESISTANCE]] *= 0.2


def _soften_falling(rng: np.random.Generator, ground: Floats) -> None:
    factor = _log(rng, 0.3, 1.0)
    ground[list(_FALLING_GRIPS)] *= factor
    ground[falling.ROLLER] *= factor
    ground[falling.RESISTANCE_S_M] = _log(rng, 0.1, 10.0)


_BRISTLE_GRIPS: Final = (bristle.LOW, bristle.PEAK, bristle.STICTION, bristle.VISCOUS)
_TREAD_GRIPS: Final = (tread.FRICTION, tread.SLIP_STIFFNESS)
_CARPET_GRIPS: Final = (carpet.FRICTION, carpet.STIFFNESS)
_FALLING_GRIPS: Final = (falling.FRICTION, falling.STATIC, falling.FILM, falling.STIFFNESS)
_NATURES: Final = {nature.name: nature for nature in NATURES}
_FLOORS: Final = {
    "bristle": _Kind(
        _NATURES["bristle"],
        ChangingBristle,
        _BRISTLE_GRIPS,
        (bristle.ROLLERS, bristle.ROW_M, bristle.SCALLOP_M, bristle.GAP),
        _soften_bristle,
    ),
    "tread": _Kind(_NATURES["tread"], ChangingTread, _TREAD_GRIPS, (), _soften_tread),
    "carpet": _Kind(
        _NATURES["carpet"],
        ChangingCarpet,
        _CARPET_GRIPS,
        (carpet.CURRENT_A, carpet.GEAR_STICKING, carpet.GEAR_RAD_S),
        _soften_carpet,
    ),
    "falling": _Kind(_NATURES["falling"], ChangingFalling, _FALLING_GRIPS, (), _soften_falling),
}


def _tile(rng: np.random.Generator, nature: Nature) -> tuple[Floor, Floats]:
    """Draw an endless floor of one tile, and return its constants, too."""
    floor = nature.draw_floor(int(rng.integers(1_000_000)))
    rows, columns = floor.kind.shape
    floor = floor.uniform(int(rng.integers(rows)), int(rng.integers(columns)))
    return floor, floor.grid.constants[0, 0].copy()


def _contact_ground(rng: np.random.Generator, *, soft: bool) -> Floats:
    """Draw the constants of a tile of `omni_contact.py`."""
    limit = float(rng.uniform(0.10, 0.32) if soft else rng.uniform(0.3, 0.9))
    slope = limit * _log(rng, 0.4, 12.0) if soft else _log(rng, 1.0, 25.0)
    along = float(rng.uniform(0.005, 0.08))
    roller = limit * float(rng.uniform(0.02, 0.25))
    return np.array([limit, slope, along, along + roller])


def _draw_start(law: str, rng: np.random.Generator) -> Scene:
    """Draw a rover on ordinary ground that goes on for ever."""
    if law in _FLOORS:
        floor, ground = _tile(rng, _FLOORS[law].nature)
        return Scene(law, floor, omni_contact.Body(), ground)
    loads = rng.uniform(0.30, 0.37, 3)
    body = omni_contact.Body(
        mass_kg=float(rng.uniform(12.0, 13.5)),
        inertia_kg_m2=float(rng.uniform(0.20, 0.25)),
        loads=tuple((loads / loads.sum()).tolist()),
    )
    ground = _contact_ground(rng, soft=False)
    return Scene(law, omni_contact.Floor.uniform(law, _log(rng, 0.002, 0.02), ground.tolist()), body, ground)


def _draw_beyond(start: Scene, rng: np.random.Generator, *, soft: bool, uneven: bool) -> Scene:
    """Draw the ground beyond, but for its resistance."""
    kind = _FLOORS.get(start.law)
    if kind is None:
        ground = _contact_ground(rng, soft=soft)
    else:
        ground = _tile(rng, kind.nature)[1]
        ground[list(kind.fixed)] = start.beyond[list(kind.fixed)]
        if soft:
            kind.soften(rng, ground)
    if not uneven:
        return dataclasses.replace(start, beyond=ground)
    return dataclasses.replace(
        start,
        beyond=ground,
        better=int(rng.choice(3, p=(0.2, 0.6, 0.2))),
        grip=float(rng.uniform(1.3, 2.5)),
        drag=float(rng.uniform(0.3, 1.0)),
    )


def _most_resistance(scene: Scene) -> float:
    """Return the most resistance that the plant's step can bear."""
    loose = scene.law == "falling" and scene.beyond[falling.FAMILY] == falling.LOOSE
    return 0.15 if loose else 0.6


def _solve(scene: Scene, seed: int, target: float, direction_rad: float) -> Scene | None:
    """Return the scene with the resistance that gives the slip wanted; None if bisection finds none."""

    def excess(resistance: float) -> float:
        plant = scene.resisting(resistance).plant(seed, 0, _SEARCH_AT_M)
        slips = drive_slips(plant, direction_rad)
        stalls = slips.wheels_m_s < _LEAST_WHEELS * SPEED_M_S
        return _STALLED if stalls else slips.beyond - target

    low, high = 0.008, _most_resistance(scene)
    under, over = excess(low), _STALLED
    if under > 0.0 or excess(high) < 0.0:
        return None
    for _ in range(14):
        middle = math.sqrt(low * high)
        found = excess(middle)
        if abs(found) < _SEARCH_SLIP:
            return scene.resisting(middle)
        if found > 0.0:
            high, over = middle, found
        else:
            low, under = middle, found
        ratio = _STALL_RATIO if over == _STALLED else _JUMP_RATIO
        if high < ratio * low and over - under > _JUMP_SLIP:
            return None
    return None


def _start_with_ordinary_slip(law: str, rng: np.random.Generator, seed: int, direction_rad: float) -> Scene:
    for _ in range(_ATTEMPTS):
        start = _draw_start(law, rng)
        slips = drive_slips(start.plant(seed, 0, _SEARCH_AT_M), direction_rad)
        # Beyond is the same ground, here.
        if _ORDINARY_SLIP[0] < slips.beyond < _ORDINARY_SLIP[1]:
            return start
    raise RuntimeError(f"no ordinary ground for {law}, seed {seed}")


def _draw(law: str, seed: int, direction_rad: float, *, stuck: bool) -> Site:
    rng = np.random.default_rng([seed, LAWS.index(law), int(stuck), 0x57])
    at_m = float(rng.uniform(*AT_M))
    # Every third seed: chance would leave a dozen sites of a law without any.
    uneven = (seed + LAWS.index(law) + int(stuck)) % 3 == 2
    low, high = STUCK_SLIP if stuck else HEALTHY_SLIP
    target = float(rng.uniform(low, high))
    start = _start_with_ordinary_slip(law, rng, seed, direction_rad)
    for attempt in range(_ATTEMPTS):
        # Ordinary ground does not have every slip: motors stall before, or a falling law jumps.
        soft = stuck or (attempt + seed) % 2 == 1
        scene = _solve(_draw_beyond(start, rng, soft=soft, uneven=uneven), seed, target, direction_rad)
        if scene is None:
            continue
        slips = drive_slips(scene.plant(seed, 0, at_m), direction_rad)
        right = abs(slips.beyond - target) < _GOOD_SLIP and low <= slips.beyond <= high
        if not right or slips.wheels_m_s < _LEAST_WHEELS * SPEED_M_S:
            continue
        late = drive_slips(scene.plant(seed, 0, at_m), direction_rad, settle_s=_LATE_S)
        if abs(late.beyond - target) < _LATE_SLIP:
            return Site(law, seed, at_m, target, slips.beyond, uneven, direction_rad, slips.before, scene)
    raise RuntimeError(f"no ground beyond for {law}, seed {seed}")


def draw_stuck(law: str, seed: int, *, direction_rad: float = 0.0) -> Site:
    """Draw a site at which a rover that drives straight on in a direction of its own nearly gets stuck."""
    return _draw(law, seed, direction_rad, stuck=True)


def draw_healthy(law: str, seed: int, *, direction_rad: float = 0.0) -> Site:
    """Draw a site at which the ground changes to another on which the rover drives well."""
    return _draw(law, seed, direction_rad, stuck=False)
