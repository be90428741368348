"""Five kinds of ground as height field and albedo: sand, gravel, grass, cracked soil, paving."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from tests.nature.ground_drives.noise import Image, Points, blur, image, octave, octaves, stone_shapes


@dataclass
class Ground:
    """A patch of ground on a grid: columns along x, rows along y of the world.

    `height` is in m relative to the terrain (`Terrain`), `albedo` is linear blue, green, red from 0 to 1,
    `cell_m` the grid's step, `origin` the world position (x, y) of cell (0, 0).
    """

    cell_m: float
    origin: tuple[float, float]
    height: Image
    albedo: Image

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height.shape[0], self.height.shape[1]

    def coordinates(self) -> tuple[Image, Image]:
        """Return x and y of each cell in m."""
        rows, columns = self.shape
        x = self.origin[0] + self.cell_m * np.arange(columns)
        y = self.origin[1] + self.cell_m * np.arange(rows)
        grid = np.meshgrid(x, y)
        return image(grid[0]), image(grid[1])


@dataclass(frozen=True)
class Terrain:
    """Large smooth relief, known everywhere: a sum of Gaussian mounds (x, y, radius, height in m)."""

    mounds: Points

    def height_m(self, x: Points | Image, y: Points | Image) -> Points:
        """Return the height at each position, m."""
        total = np.zeros(np.shape(x), np.float64)
        for centre_x, centre_y, radius, height in self.mounds:
            total += height * np.exp(-((x - centre_x) ** 2 + (y - centre_y) ** 2) / (2.0 * radius**2))
        return total


SOIL_COLOURS = (  # linear blue, green, red
    (0.12, 0.21, 0.30), (0.16, 0.24, 0.31), (0.20, 0.26, 0.30), (0.09, 0.14, 0.22), (0.07, 0.13, 0.27),
    (0.18, 0.19, 0.20), (0.06, 0.08, 0.11), (0.26, 0.32, 0.37),
)  # fmt: skip


def _soil_colour(rng: np.random.Generator) -> Points:
    colour = np.asarray(SOIL_COLOURS[rng.integers(len(SOIL_COLOURS))])
    return colour * rng.uniform(0.75, 1.3) * rng.uniform(0.93, 1.07, 3)


def _tinted(colour: Points, tone: Image) -> Image:
    return image(np.clip(tone[..., None] * colour.astype(np.float32), 0.01, 0.9))


def _tone(rng: np.random.Generator, shape: tuple[int, int], cell_m: float, grain: float) -> Image:
    """Return the relative tone of bare soil: blotches of 50 cm to 3 cm, and grain."""
    bands = [(0.8, rng.uniform(0.02, 0.08)), (0.2, rng.uniform(0.02, 0.06)), (0.05, rng.uniform(0.01, 0.06))]
    bands += [(0.012, 0.5 * grain), (0.005, 0.7 * grain), (0.0, grain)]
    return image(np.exp(octaves(rng, shape, cell_m, bands)))


def scatter_stones(
    rng: np.random.Generator,
    ground: Ground,
    count_per_m2: float,
    radius_m: tuple[float, float],
    colour: Points,
) -> None:
    """Lay stones on the ground; the number beyond a radius falls as its square."""
    rows, columns = ground.shape
    count = int(count_per_m2 * rows * columns * ground.cell_m**2)
    low, high = radius_m
    share = rng.uniform(0.0, 1.0, count)
    radii = low / np.sqrt(1.0 - share * (1.0 - (low / high) ** 2))
    cells = np.maximum(np.round(radii / ground.cell_m).astype(int), 1)
    shapes = {int(r): stone_shapes(rng, int(r), 12) for r in np.unique(cells)}
    spread = rng.uniform(0.1, 0.35)
    tones = np.exp(rng.normal(0.0, spread, count))
    hues = np.exp(rng.normal(0.0, 0.15 * spread, (count, 3)))
    tops, lefts = rng.integers(0, rows, count), rng.integers(0, columns, count)
    for i in np.argsort(radii):
        r = int(cells[i])
        shape = shapes[r][i % 12]
        top, left = max(tops[i] - r, 0), max(lefts[i] - r, 0)
        bottom, right = min(tops[i] + r + 1, rows), min(lefts[i] + r + 1, columns)
        part = shape[top - tops[i] + r : bottom - tops[i] + r, left - lefts[i] + r : right - lefts[i] + r]
        height = ground.height[top:bottom, left:right]
        base = float(height.mean())
        dome = base + np.float32(0.75 * radii[i]) * part - np.float32(0.0006)
        above = (part > 0.05) & (dome > height)
        height[above] = dome[above]
        texture = (1.0 + 0.06 * rng.standard_normal(part.shape, dtype=np.float32))[above, None]
        ground.albedo[top:bottom, left:right][above] = texture * (colour * tones[i] * hues[i]).astype(
            np.float32
        )
    np.clip(ground.albedo, 0.01, 0.9, out=ground.albedo)


def _rough(rng: np.random.Generator, shape: tuple[int, int], cell_m: float, size: float) -> Image:
    bands = [(0.6, 0.004), (0.2, 0.0015), (0.07, 0.0008), (0.025, 0.00045), (0.011, 0.0003), (0.005, 0.0002)]
    return octaves(
        rng, shape, cell_m, [(length, size * rms * rng.uniform(0.6, 1.4)) for length, rms in bands]
    )


def sand(rng: np.random.Generator, ground: Ground) -> None:
    """Fine grain, hollows, a few pebbles; often ripples of the wind."""
    shape, cell_m = ground.shape, ground.cell_m
    colour = _soil_colour(rng)
    ground.height += _rough(rng, shape, cell_m, rng.uniform(0.6, 1.5))
    if rng.uniform() < 0.5:
        x, y = ground.coordinates()
        direction, length_m = rng.uniform(0, np.pi), rng.uniform(0.05, 0.14)
        warp = octaves(rng, shape, cell_m, [(0.5, 0.6), (0.15, 0.35)])
        phase = 2 * np.pi * (x * np.cos(direction) + y * np.sin(direction)) / length_m + 3.0 * warp
        fade = np.clip(0.6 + 0.6 * octave(rng, shape, 0.7 / cell_m), 0.0, 1.3)
        ground.height += np.float32(0.03 * length_m * rng.uniform(0.4, 1.0)) * fade * image(np.sin(phase))
    ground.albedo[:] = _tinted(colour, _tone(rng, shape, cell_m, rng.uniform(0.03, 0.09)))
    grey = 0.5 * colour + 0.5 * colour.mean()
    scatter_stones(
        rng, ground, rng.uniform(20, 700), (0.0015, rng.uniform(0.004, 0.012)), grey * rng.uniform(0.6, 1.4)
    )


def gravel(rng: np.random.Generator, ground: Ground) -> None:
    """Soil covered by stones of 2 to 25 mm."""
    shape, cell_m = ground.shape, ground.cell_m
    colour = _soil_colour(rng)
    ground.height += _rough(rng, shape, cell_m, rng.uniform(1.0, 2.0))
    ground.albedo[:] = _tinted(colour, _tone(rng, shape, cell_m, rng.uniform(0.06, 0.14)))
    grey = 0.3 * colour + 0.7 * rng.uniform(0.12, 0.3)
    scatter_stones(rng, ground, rng.uniform(900, 3500), (0.002, rng.uniform(0.008, 0.02)), grey)
    if rng.uniform() < 0.5:
        scatter_stones(rng, ground, rng.uniform(3, 25), (0.012, 0.03), grey * rng.uniform(0.7, 1.3))


def grass(rng: np.random.Generator, ground: Ground) -> None:
    """Soil with tufts: blades are thin lines that rise from the root to the middle."""
    sand(rng, ground)
    rows, columns = ground.shape
    ground.albedo *= np.float32(rng.uniform(0.5, 0.8))
    tufts = int(rng.uniform(30, 160) * rows * columns * ground.cell_m**2)
    green = np.asarray((0.03, 0.12, 0.07)) if rng.uniform() < 0.65 else np.asarray((0.08, 0.2, 0.24))
    for _ in range(tufts):
        root = rng.uniform((0, 0), (columns, rows))
        length_m = rng.uniform(0.02, 0.10)
        blades = int(rng.integers(6, 28))
        lean = rng.normal(0.0, 0.35, 2)
        for angle, share, tone in zip(
            rng.uniform(0, 2 * np.pi, blades),
            rng.uniform(0.4, 1.0, blades),
            rng.uniform(0.4, 1.8, blades),
            strict=True,
        ):
            reach = share * length_m / ground.cell_m * (np.asarray((np.cos(angle), np.sin(angle))) + lean)
            start = root + rng.normal(0.0, 0.004 / ground.cell_m, 2)
            _blade(ground, start, reach, green * tone * rng.uniform(0.8, 1.2, 3), 0.25 * length_m)


def _blade(ground: Ground, start: Points, reach: Points, colour: Points, rise_m: float) -> None:
    ends = [start, start + 0.6 * reach, start + reach + 0.12 * reach[::-1]]
    for part, (low, high) in enumerate(itertools.pairwise(ends)):
        first, second = (tuple(int(v) for v in np.round(8 * point)) for point in (low, high))
        if not all(abs(v) < 2**20 for v in (*first, *second)):
            continue
        paint = tuple(float(v) for v in colour)
        cv2.line(ground.albedo, first, second, paint, 2 - part, cv2.LINE_AA, 3)
        column = int(np.clip(low[0], 0, ground.shape[1] - 1))
        row = int(np.clip(low[1], 0, ground.shape[0] - 1))
        level = float(ground.height[row, column]) + rise_m * (0.4, 0.1)[part]
        cv2.line(ground.height, first, second, level, 1, cv2.LINE_8, 3)


def cracked_soil(rng: np.random.Generator, ground: Ground) -> None:
    """Dried mud: plates of 5 to 20 cm, slightly dished, with open cracks between them."""
    shape, cell_m = ground.shape, ground.cell_m
    colour = _soil_colour(rng)
    plate_m, crack_m = rng.uniform(0.05, 0.2), rng.uniform(0.0015, 0.006)
    gap_m, index = _nearest_plate(rng, ground, plate_m)
    width = crack_m * np.clip(1.0 + 0.5 * octave(rng, shape, 0.1 / cell_m), 0.2, 2.5)
    crack = image(np.clip(1.3 - gap_m / np.maximum(width, cell_m), 0.0, 1.0))
    dish = image(np.clip(1.0 - gap_m / (0.35 * plate_m), 0.0, 1.0)) ** 2
    level = rng.normal(0.0, 0.0008, 4096).astype(np.float32)[index % 4096]
    ground.height += _rough(rng, shape, cell_m, rng.uniform(0.4, 0.9)) + level
    ground.height += np.float32(rng.uniform(0.0, 0.004)) * dish - np.float32(rng.uniform(0.003, 0.01)) * crack
    plates = np.exp(rng.normal(0.0, 0.05, 4096)).astype(np.float32)[index % 4096]
    tone = _tone(rng, shape, cell_m, rng.uniform(0.02, 0.06)) * plates * (1.0 - 0.5 * crack)
    ground.albedo[:] = _tinted(colour, tone)


def _nearest_plate(rng: np.random.Generator, ground: Ground, plate_m: float) -> tuple[Image, np.ndarray]:
    """Return the distance to the border of the nearest Voronoi cell in m, and the cell's number.

    Evaluated on a grid of half the step, with coordinates that are bent by noise.
    """
    rows, columns = ((n + 1) // 2 for n in ground.shape)
    step = 2 * ground.cell_m / plate_m
    bend = [octaves(rng, (rows, columns), 2 * ground.cell_m, [(0.12, 0.05), (0.03, 0.02)]) for _ in range(2)]
    x = image(np.arange(columns) * step)[None, :] + bend[0]
    y = image(np.arange(rows) * step)[:, None] + bend[1]
    x, y = x + 2.0, y + 2.0
    seeds = rng.uniform(0.1, 0.9, (int(y.max()) + 4, int(x.max()) + 4, 2)).astype(np.float32)
    column, row = x.astype(np.int32), y.astype(np.int32)
    first, second = np.full((2, rows, columns), 9.0, np.float32)
    index = np.zeros((rows, columns), np.int32)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            i, j = np.maximum(row + down, 0), np.maximum(column + right, 0)
            seed = seeds[i, j]
            distance = np.hypot(seed[..., 0] + j - x, seed[..., 1] + i - y)
            nearer = distance < first
            second = np.where(nearer, first, np.minimum(second, distance))
            index = np.where(nearer, i * seeds.shape[1] + j, index)
            first = np.where(nearer, distance, first)
    size = (ground.shape[1], ground.shape[0])
    gap = cv2.resize(image(0.5 * plate_m * (second - first)), size, interpolation=cv2.INTER_LINEAR)
    return image(gap), cv2.resize(index, size, interpolation=cv2.INTER_NEAREST)


def paving(rng: np.random.Generator, ground: Ground) -> None:
    """Bricks in running bond or square slabs, in any direction; joints filled with sand."""
    shape, cell_m = ground.shape, ground.cell_m
    x, y = ground.coordinates()
    square = rng.uniform() < 0.4
    length_m = rng.uniform(0.18, 0.26)
    width_m = length_m if square else 0.5 * length_m
    joint_m, turn = rng.uniform(0.003, 0.008), rng.uniform(0, np.pi)
    bend = octaves(rng, shape, cell_m, [(0.1, 0.0006)])
    along = (np.cos(turn) * x + np.sin(turn) * y + bend) / length_m + 50.0
    across = (np.cos(turn) * y - np.sin(turn) * x + bend) / width_m + 50.0
    course = np.floor(across)
    along = along + (0.0 if square else 0.5) * (course % 2)
    brick = (np.floor(along) * 131 + course * 71).astype(np.int64) % 4096
    edge_m = np.minimum(
        length_m * np.minimum(along % 1.0, 1.0 - along % 1.0),
        width_m * np.minimum(across % 1.0, 1.0 - across % 1.0),
    )
    stone = image(np.clip((edge_m - 0.5 * joint_m) / 0.004, 0.0, 1.0))
    tilt = rng.normal(0.0, 0.0008, 4096).astype(np.float32)[brick]
    ground.height += stone * (np.float32(rng.uniform(0.002, 0.006)) + tilt) + _rough(rng, shape, cell_m, 0.35)
    colours = np.asarray(((0.09, 0.12, 0.27), (0.2, 0.22, 0.24), (0.12, 0.18, 0.27), (0.1, 0.1, 0.11)))
    colour = colours[rng.integers(4)] * rng.uniform(0.8, 1.2)
    tones = np.exp(rng.normal(0.0, rng.uniform(0.03, 0.18), 4096)).astype(np.float32)[brick]
    tone = _tone(rng, shape, cell_m, rng.uniform(0.03, 0.08))
    joint = _tinted(_soil_colour(rng) * 0.7, tone)
    ground.albedo[:] = stone[..., None] * _tinted(colour, tone * tones) + (1.0 - stone[..., None]) * joint


KINDS: dict[str, Callable[[np.random.Generator, Ground], None]] = {
    "sand": sand,
    "gravel": gravel,
    "grass": grass,
    "cracked_soil": cracked_soil,
    "paving": paving,
}
"""Kinds of ground by name."""


def wet_patches(rng: np.random.Generator, ground: Ground, count: int, streaks: bool) -> None:
    """Darken patches of the ground by water; `streaks` are long and lie in any direction."""
    x, y = ground.coordinates()
    ragged = octaves(rng, ground.shape, ground.cell_m, [(0.3, 0.25), (0.1, 0.12), (0.03, 0.06)])
    for _ in range(count):
        centre = rng.uniform((float(x.min()), float(y.min())), (float(x.max()), float(y.max())))
        turn = rng.normal(0.0, 0.25) if streaks and rng.uniform() < 0.6 else rng.uniform(0, np.pi)
        half = rng.uniform(0.08, 0.45)
        long, wide = (rng.uniform(0.5, 2.0), rng.uniform(0.03, 0.12)) if streaks else (half, half)
        u = ((x - centre[0]) * np.cos(turn) + (y - centre[1]) * np.sin(turn)) / long
        v = ((y - centre[1]) * np.cos(turn) - (x - centre[0]) * np.sin(turn)) / wide
        edge = rng.uniform(0.05, 0.3)
        wet = image(np.clip((1.0 - np.hypot(u, v) + ragged) / edge, 0.0, 1.0))
        ground.albedo *= 1.0 - np.float32(rng.uniform(0.2, 0.55)) * wet[..., None]


def pressed_base(ground: Ground, wheel_width_m: float) -> Image:
    """Return the height below a wheel that pressed the ground flat over a third of its width."""
    return blur(ground.height, wheel_width_m / 3.0 / ground.cell_m)
