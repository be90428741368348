"""The ground around the rover: generated on demand, deformed by wheels, lit by the sun."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_backends.arrays import Array
from sim_backends.rear_scene import kernels
from sim_backends.rear_scene.ground_kinds import make_ground, periodic_noise
from sim_backends.rear_scene.settings import GroundKind

Box: TypeAlias = tuple[int, int, int, int]

BLOCKS = kernels.MAP_SIZE // kernels.BLOCK
SHORTEST_TEXEL_M = 0.0015
STONE_CELL_M = 0.25
LARGEST_STONE_M = 0.09
PATCH_TEXEL_M = 0.031
SHADOW_MARGIN_M = 0.09
LARGEST_CHANGE_M = 0.03
NOWHERE = np.iinfo(np.int64).min


@dataclass(frozen=True, kw_only=True)
class Terrain:
    """The large shape of the ground, heights in m.

    Attributes:
        slope: Rise along x and along y, m per m.
        mounds: Rows x, y, height, radius (standard deviation) of bell-shaped mounds, m.
    """

    slope: tuple[float, float] = (0.0, 0.0)
    mounds: tuple[tuple[float, float, float, float], ...] = ()

    def arrays(self) -> tuple[Array, Array]:
        """Return slope and mounds as arrays for the compiled loops."""
        return np.array(self.slope), np.array(self.mounds, np.float64).reshape(-1, 4)

    def height_m(self, x_m: Array, y_m: Array) -> Array:
        """Return the height at points of the world."""
        height = self.slope[0] * x_m + self.slope[1] * y_m
        for x0, y0, top, radius in self.mounds:
            height = height + top * np.exp(-0.5 * ((x_m - x0) ** 2 + (y_m - y0) ** 2) / radius**2)
        return np.asarray(height)


@dataclass(frozen=True, kw_only=True)
class Sun:
    """Direction and strength of the light.

    Attributes:
        azimuth_deg: Direction to the sun in the world, counter-clockwise from x.
        elevation_deg: Elevation of the sun.
        sun_grey: Light of white ground perpendicular to the sun; 256 saturates a frame.
        sky_grey: Light of the sky.
        bands: Shadows of distant poles: direction of the normal (deg), offset, half width, softness in m.
    """

    azimuth_deg: float = 120.0
    elevation_deg: float = 50.0
    sun_grey: float = 190.0
    sky_grey: float = 75.0
    bands: tuple[tuple[float, float, float, float], ...] = ()

    def direction(self) -> Array:
        """Return the unit vector to the sun in the world."""
        azimuth, elevation = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        level = math.cos(elevation)
        return np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])

    def arrays(self) -> tuple[Array, Array]:
        """Return light and bands as arrays for the compiled loops."""
        bands = [
            (math.cos(math.radians(turn)), math.sin(math.radians(turn)), offset, half, soft)
            for turn, offset, half, soft in self.bands
        ]
        light = np.array([*self.direction(), self.sun_grey, self.sky_grey])
        return light, np.array(bands, np.float64).reshape(-1, 5)


@dataclass(frozen=True, kw_only=True)
class Rut:
    """Shape of a rut, m.

    Attributes:
        depth_m: Depth of the floor below the undisturbed ground.
        wall_per_depth: Width over which the floor rises to the edge, per depth: 1.5 in dry sand.
        berm_m: Height of the berms beside it.
        lug_m: Depth of the grousers' imprints in the floor.
        tone: Brightness of the floor against the ground's mean.
        compaction: Share of the ground's pattern that the wheel removes.
        push: Relative rise of the berm on the side to which the wheel drifts, per tangent of the drift angle.
        smear_m: Widening of the rut, per tangent of the drift angle.
    """

    depth_m: float = 0.014
    wall_per_depth: float = 1.5
    berm_m: float = 0.006
    berm_width_m: float = 0.010
    lug_m: float = 0.004
    tone: float = 0.88
    compaction: float = 0.6
    push: float = 2.5
    smear_m: float = 0.03


@dataclass(frozen=True, kw_only=True)
class GroundSettings:
    """Composition of the ground.

    Attributes:
        tile_turn_deg: Rotation of the tile in the world.
        patchiness: Strength of brightness variations over metres.
        stones_per_m2: Loose stones per square metre.
        stone_m: Median half axis of a stone.
    """

    kind: GroundKind = "fine_sand"
    terrain: Terrain = Terrain()
    tile_turn_deg: float = 17.0
    patchiness: float = 0.06
    stones_per_m2: float = 0.0
    stone_m: float = 0.012


@dataclass(frozen=True, kw_only=True)
class WheelStep:
    """One short step of a wheel over the ground.

    Attributes:
        start_m: Contact x, y in the world before the step.
        end_m: The same after it.
        heading_rad: Heading of the wheel in the world.
        lugs: Wheel angle before and after, in lug pitches.
        width_m: Width of the wheel.
        softness: 0 where the ground is too hard to take a rut, 1 where it takes the full one, more where
            the wheel digs itself in.
    """

    start_m: tuple[float, float]
    end_m: tuple[float, float]
    heading_rad: float
    lugs: tuple[float, float]
    width_m: float
    softness: float = 1.0


class GroundMap:
    """A window of the ground that follows the rover; ground farther away than its width is discarded.

    Attributes:
        maps: Height, reflectance and light.

    Args:
        settings: Composition of the ground.
        sun: The light.
        earlier_steps: Steps of earlier traces, pressed where new ground is generated.
        earlier_rut: Shape of their ruts.
        rng: Source of sand, patches and stones.
        texel_m: Width of a texel.
    """

    def __init__(
        self,
        settings: GroundSettings,
        sun: Sun,
        earlier_steps: tuple[WheelStep, ...],
        earlier_rut: Rut,
        rng: np.random.Generator,
        texel_m: float = SHORTEST_TEXEL_M,
    ) -> None:
        self.maps = kernels.Maps(
            height=np.zeros((kernels.MAP_SIZE, kernels.MAP_SIZE), np.float32),
            reflectance=np.zeros((kernels.MAP_SIZE, kernels.MAP_SIZE), np.float32),
            light=np.zeros((kernels.MAP_SIZE, kernels.MAP_SIZE, 2), np.uint16),
            is_dark=np.ones((BLOCKS, BLOCKS), np.bool_),
            texel_m=texel_m,
        )
        self._owner = np.full((BLOCKS, BLOCKS, 2), NOWHERE)
        self._settings = settings
        self._sun = sun.arrays()
        self._earlier = [(step, _reach_box(step, earlier_rut, texel_m)) for step in earlier_steps]
        self._earlier_rut = earlier_rut
        self._model = _model(settings, _light_reach(sun, texel_m), rng)
        self._stone_seed = int(rng.integers(2**32))
        self._stones_at = lru_cache(4096)(self._draw_stones)

    def press(self, step: WheelStep, rut: Rut) -> None:
        """Press the rut of one step of a wheel into the ground."""
        box = _reach_box(step, rut, self.maps.texel_m)
        self._ensure_blocks(box)
        self._press_inside(step, rut, box)

    def prepare(self, x_m: tuple[float, float], y_m: tuple[float, float]) -> None:
        """Generate and illuminate the ground in this rectangle of the world, at most as wide as the map."""
        texel_m = self.maps.texel_m
        box = (*_texels(x_m, texel_m), *_texels(y_m, texel_m))
        margin = math.ceil(SHADOW_MARGIN_M / texel_m)
        self._ensure_blocks((box[0] - margin, box[1] + margin, box[2] - margin, box[3] + margin))
        is_dark = self.maps.is_dark
        rows, columns = _blocks(box)
        for row in rows:
            for column in columns:
                slot = row % BLOCKS, column % BLOCKS
                if is_dark[slot]:
                    kernels.illuminate(self.maps, np.array(_block_box(row, column)), *self._sun)
                    is_dark[slot] = False

    def _ensure_blocks(self, box: Box) -> None:
        rows, columns = _blocks(box)
        for row in rows:
            for column in columns:
                slot = row % BLOCKS, column % BLOCKS
                if self._owner[slot][0] != row or self._owner[slot][1] != column:
                    self._owner[slot] = row, column
                    self.maps.is_dark[slot] = True
                    self._make_block(_block_box(row, column))

    def _make_block(self, box: Box) -> None:
        kernels.fill(self.maps, np.array(box), self._model)
        for stone in self._stones_near(box):
            kernels.add_stone(self.maps, np.array(box), stone)
        for step, reach in self._earlier:
            self._press_inside(step, self._earlier_rut, _overlap(box, reach))

    def _press_inside(self, step: WheelStep, rut: Rut, box: Box) -> None:
        if box[0] < box[1] and box[2] < box[3]:
            steps = np.array([*step.start_m, *_displacement(step), *_heading(step), *step.lugs])
            kernels.press(self.maps, np.array(box), steps, _shape(step, rut), self._model)

    def _stones_near(self, box: Box) -> list[Array]:
        if self._settings.stones_per_m2 == 0:
            return []
        reach = LARGEST_STONE_M / self.maps.texel_m
        cell = STONE_CELL_M / self.maps.texel_m
        rows = range(math.floor((box[0] - reach) / cell), math.floor((box[1] + reach) / cell) + 1)
        columns = range(math.floor((box[2] - reach) / cell), math.floor((box[3] + reach) / cell) + 1)
        return [stone for row in rows for column in columns for stone in self._stones_at(row, column)]

    def _draw_stones(self, row: int, column: int) -> list[Array]:
        """Return the stones of a cell, the same at every call."""
        # A seed takes no negative numbers; cells count from far below zero.
        rng = np.random.default_rng([self._stone_seed, row + 2**31, column + 2**31])
        stones = []
        for _ in range(rng.poisson(self._settings.stones_per_m2 * STONE_CELL_M**2)):
            x, y = (np.array([row, column]) + rng.random(2)) * STONE_CELL_M
            along = min(self._settings.stone_m * rng.lognormal(0, 0.5), LARGEST_STONE_M)
            across = along * rng.uniform(0.55, 0.95)
            top = across * rng.uniform(0.4, 0.8)
            stones.append(np.array([x, y, along, across, rng.uniform(0, np.pi), top, rng.uniform(0.2, 0.6)]))
        return stones


def _model(
    settings: GroundSettings, light_reach: NDArray[np.int64], rng: np.random.Generator
) -> kernels.GroundModel:
    tile = make_ground(settings.kind, rng)
    turn = math.radians(settings.tile_turn_deg)
    slope, mounds = settings.terrain.arrays()
    return kernels.GroundModel(
        slope=slope,
        mounds=mounds,
        reflectance=tile.reflectance,
        relief=tile.relief_m,
        patches=periodic_noise(256, 8, 128, rng),
        tile_placement=np.array(
            [math.cos(turn), math.sin(turn), tile.texel_m, PATCH_TEXEL_M, settings.patchiness]
        ),
        roughness=periodic_noise(256, 2, 12, rng),
        light_reach=light_reach,
    )


def _shape(step: WheelStep, rut: Rut) -> Array:
    """Return the cross-section of this step's rut: wider, with one higher berm, when the wheel drifts."""
    forward, left = _displacement(step)
    drift = left / max(abs(forward), abs(left), 1e-9)
    berm = rut.berm_m * step.softness
    return np.array(
        [
            0.5 * step.width_m + rut.smear_m * abs(drift),
            rut.depth_m * step.softness,
            max(rut.wall_per_depth * rut.depth_m * step.softness, 0.004),
            berm * (1 + rut.push * max(0.0, drift)),
            berm * (1 + rut.push * max(0.0, -drift)),
            rut.berm_width_m,
            rut.lug_m * step.softness,
            rut.tone * kernels.MEAN_REFLECTANCE,
            min(1.0, rut.compaction * step.softness),
        ]
    )


def _heading(step: WheelStep) -> tuple[float, float]:
    return math.cos(step.heading_rad), math.sin(step.heading_rad)


def _displacement(step: WheelStep) -> tuple[float, float]:
    """Return the displacement of a step, forward and to the left of the wheel's heading, m."""
    cosine, sine = _heading(step)
    x, y = step.end_m[0] - step.start_m[0], step.end_m[1] - step.start_m[1]
    return cosine * x + sine * y, cosine * y - sine * x


def _reach_box(step: WheelStep, rut: Rut, texel_m: float) -> Box:
    """Return the box of texels that a step can change."""
    reach = 0.5 * step.width_m + rut.smear_m + kernels.BERM_REACH * rut.berm_width_m
    cosine, sine = _heading(step)
    patch = kernels.CONTACT_M + 2 * texel_m
    spread_x, spread_y = abs(sine) * reach + abs(cosine) * patch, abs(cosine) * reach + abs(sine) * patch
    x_m, y_m = sorted((step.start_m[0], step.end_m[0])), sorted((step.start_m[1], step.end_m[1]))
    rows = _texels((x_m[0] - spread_x, x_m[1] + spread_x), texel_m)
    return (*rows, *_texels((y_m[0] - spread_y, y_m[1] + spread_y), texel_m))


def _light_reach(sun: Sun, texel_m: float) -> NDArray[np.int64]:
    """Return the offsets, in texels, of the ground whose light a change of the ground affects."""
    hollow = kernels.HOLLOW_M / texel_m
    away = -sun.direction()[:2] / max(sun.direction()[2], 0.1) * LARGEST_CHANGE_M / texel_m
    around = [(hollow, 0.0), (-hollow, 0.0), (0.0, hollow), (0.0, -hollow)]
    return np.round([*around, *(share * away for share in (0.33, 0.67, 1.0))]).astype(np.int64)


def _texels(span_m: tuple[float, float], texel_m: float) -> tuple[int, int]:
    return math.floor(span_m[0] / texel_m), math.ceil(span_m[1] / texel_m)


def _blocks(box: Box) -> tuple[range, range]:
    return range(box[0] // kernels.BLOCK, -(-box[1] // kernels.BLOCK)), range(
        box[2] // kernels.BLOCK, -(-box[3] // kernels.BLOCK)
    )


def _block_box(row: int, column: int) -> Box:
    return (
        row * kernels.BLOCK,
        (row + 1) * kernels.BLOCK,
        column * kernels.BLOCK,
        (column + 1) * kernels.BLOCK,
    )


def _overlap(first: Box, second: Box) -> Box:
    return (
        max(first[0], second[0]),
        min(first[1], second[1]),
        max(first[2], second[2]),
        min(first[3], second[3]),
    )
