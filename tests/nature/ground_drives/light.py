"""Light on the ground: sun on the relief with its own shadows, sky, and shadows of objects.

Shadows of objects are drawn in a picture of the plane through the wheel contacts, seen along the sun's rays,
in a frame that moves and turns with the rover. A point of the ground above that plane looks up its shadow
where the sun's ray through it meets the plane, so that edges of shadows follow the relief.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np

from tests.nature.ground_drives.ground import Ground, Terrain
from tests.nature.ground_drives.noise import Bytes, Image, Points, blur, image

SUN_RADIUS_RAD = 0.00465


@dataclass(frozen=True)
class Sun:
    """Direction to the sun in the world, and the strength of sun and sky.

    `sun` is the irradiance of a plane that faces the sun, `sky` that of a level plane under the open sky;
    both are relative, linear blue, green, red. `lean` is the share of the sky's light that comes from one
    side, at `lean_azimuth_rad`.
    """

    elevation_rad: float
    azimuth_rad: float
    sun: Points
    sky: Points
    lean: float
    lean_azimuth_rad: float

    @property
    def direction(self) -> Points:
        """Unit vector to the sun."""
        flat = np.cos(self.elevation_rad)
        return np.asarray(
            (flat * np.cos(self.azimuth_rad), flat * np.sin(self.azimuth_rad), np.sin(self.elevation_rad)),
            np.float64,
        )

    @property
    def shift(self) -> Points:
        """Displacement of a shadow per metre of height, in the world's x and y."""
        return np.asarray(-self.direction[:2] / self.direction[2], np.float64)


def shade(ground: Ground, terrain: Terrain, sun: Sun) -> Image:
    """Return the light on each cell: channel 0 the sun's share, channel 1 the sky's.

    1 is the light of a plane that faces the sun, and of a level plane under the open sky.
    """
    x, y = ground.coordinates()
    height = ground.height + image(terrain.height_m(x, y)) if len(terrain.mounds) else ground.height
    slope_x = image(cv2.Sobel(height, cv2.CV_32F, 1, 0, ksize=3, scale=1 / (8 * ground.cell_m)))
    slope_y = image(cv2.Sobel(height, cv2.CV_32F, 0, 1, ksize=3, scale=1 / (8 * ground.cell_m)))
    up = 1.0 / np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    to_x, to_y, to_z = (np.float32(v) for v in sun.direction)
    facing = np.maximum((to_z - to_x * slope_x - to_y * slope_y) * up, 0.0)
    lean_x = np.float32(sun.lean * np.cos(sun.lean_azimuth_rad))
    lean_y = np.float32(sun.lean * np.sin(sun.lean_azimuth_rad))
    open_sky = np.ones_like(height)
    for sigma_m, strength in ((0.003, 0.25), (0.008, 0.35), (0.025, 0.35)):
        hollow = (blur(height, sigma_m / ground.cell_m) - height) / np.float32(sigma_m)
        open_sky -= np.float32(strength) * np.clip(hollow, -0.25, 1.0)
    sky = np.clip(open_sky, 0.25, 1.25) * np.maximum(
        0.5 + 0.5 * up - (lean_x * slope_x + lean_y * slope_y) * up, 0.1
    )
    lit = facing * (1.0 - self_shadow(height, ground.cell_m, sun))
    return image(np.dstack((lit, sky)))


def self_shadow(height: Image, cell_m: float, sun: Sun) -> Image:
    """Return the share of the sun's disc, 0 to 1, that the relief itself hides at each cell."""
    tangent = np.tan(sun.elevation_rad)
    reach_m = min(float(np.ptp(height)) / tangent, 0.9)
    if reach_m < 2 * cell_m:
        return np.zeros_like(height)
    rows, columns = height.shape
    fall_m = np.float32(cell_m * tangent)

    def ahead(values: Image, step: float, flags: int) -> Image:
        move = step * np.cos(sun.azimuth_rad), step * np.sin(sun.azimuth_rad)
        matrix = np.asarray(((1.0, 0.0, move[0]), (0.0, 1.0, move[1])))
        flags |= cv2.WARP_INVERSE_MAP
        return image(
            cv2.warpAffine(values, matrix, (columns, rows), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        )

    # `horizon` is the highest of the sun's rays that the ground at 1 to n cells towards the sun blocks.
    # n doubles at each step.
    horizon = ahead(height, 1.0, cv2.INTER_LINEAR) - fall_m
    distance = np.ones_like(height)
    step = 1
    while step * cell_m < reach_m:
        further = ahead(horizon, step, cv2.INTER_LINEAR) - step * fall_m
        distance = np.where(further > horizon, ahead(distance, step, cv2.INTER_NEAREST) + step, distance)
        np.maximum(horizon, further, out=horizon)
        step *= 2
    spread = np.float32(2.0 * SUN_RADIUS_RAD * cell_m * (1.0 + tangent * tangent))
    return image(
        np.clip((horizon - height) / (0.0004 + spread * distance) + 0.5 * (horizon > height), 0.0, 1.0)
    )


@dataclass(frozen=True)
class Box:
    """Part of the rover in its frame: centre and half size in m, turned about z by `turn_rad`."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    turn_rad: float = 0.0

    def corners(self) -> Points:
        """Return the eight corners, m."""
        signs = np.asarray([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], np.float64)
        local = signs * np.asarray(self.half)
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        turned = np.column_stack(
            (cos * local[:, 0] - sin * local[:, 1], sin * local[:, 0] + cos * local[:, 1], local[:, 2])
        )
        return np.asarray(turned + np.asarray(self.centre), np.float64)


@dataclass(frozen=True)
class Passing:
    """Object whose shadow crosses the ground: an outline on the ground that moves through the world.

    `outline` is (n, 2) in m about `start`, the position at `time_s`; `height_m` is its height
    above ground, which sets how soft the edge is. It exists within `life_s` of `time_s`.
    """

    outline: Points
    start: Points
    velocity_mps: Points
    time_s: float
    life_s: float
    height_m: float
    opacity: float


@dataclass(frozen=True)
class Foliage:
    """Leaves above the ground: centre (of the shadow, in the world), half size, angle and branch of each."""

    centres: Points
    sizes: Points
    angles: Points
    branch: np.ndarray
    sway_m: float
    flutter_rad: float
    phases: Points
    rates: Points
    height_m: float
    opacity: float

    def outlines(self, time_s: float) -> Points:
        """Return the outlines at a time, (leaves, 8, 2) in m of the world."""
        phase = self.phases[self.branch]
        rate = self.rates[self.branch]
        gust = 0.6 + 0.4 * np.sin(0.31 * time_s + phase[:, 0])
        move_x = self.sway_m * gust * np.sin(rate[:, 0] * time_s + phase[:, 0])
        move_y = self.sway_m * gust * np.sin(rate[:, 1] * time_s + phase[:, 1])
        own = np.arange(len(self.centres))
        turn = self.angles + self.flutter_rad * gust * np.sin(5.0 * rate[:, 0] * time_s + own)
        round_about = np.linspace(0, 2 * np.pi, 8, endpoint=False)
        u = self.sizes[:, :1] * np.cos(round_about) * (1.0 + 0.2 * np.cos(round_about))
        v = self.sizes[:, 1:] * np.sin(round_about)
        cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
        x = (self.centres[:, 0] + move_x)[:, None] + cos * u - sin * v
        y = (self.centres[:, 1] + move_y)[:, None] + sin * u + cos * v
        return np.stack((x, y), axis=2)


@dataclass
class ShadowPlane:
    """Picture of the shadows on the wheel-contact plane, around the view of the camera.

    `left_back` is the position of cell (0, 0) in the rover's frame, m; columns run forward (x),
    rows to the left (y).
    """

    left_back: tuple[float, float] = (-1.75, -0.75)
    size_m: tuple[float, float] = (1.7, 2.0)
    cell_m: float = 0.0035
    parts: tuple[Box, ...] = ()
    passing: tuple[Passing, ...] = ()
    foliage: tuple[Foliage, ...] = ()
    _blank: Bytes = field(init=False, repr=False)

    def __post_init__(self) -> None:
        columns, rows = (int(v / self.cell_m) for v in self.size_m)
        self._blank = np.zeros((rows, columns), np.uint8)

    def transmission(self, sun: Sun, pose: tuple[float, float, float], tilt: Points, time_s: float) -> Image:
        """Return the share of the sun's light that reaches each cell, 0 to 1.

        Args:
            sun: where the sun stands in the world.
            pose: x, y in m and heading in rad of the rover.
            tilt: (3, 3) rotation from the rover's frame to the level frame of the same heading.
            time_s: time of the frame.
        """
        light = np.ones(self._blank.shape, np.float32)
        for mask, sigma_m, opacity in self._rover_masks(sun, pose[2], tilt):
            light *= self._soft(mask, sigma_m, opacity)
        slant = 1.0 / np.sin(sun.elevation_rad)
        for thing in self.passing:
            if abs(time_s - thing.time_s) > thing.life_s:
                continue
            outline = thing.outline + thing.start + thing.velocity_mps * (time_s - thing.time_s)
            mask = self._fill([_to_local(outline, pose)])
            if mask.any():
                light *= self._soft(mask, SUN_RADIUS_RAD * thing.height_m * slant, thing.opacity)
        for leaves in self.foliage:
            outlines = leaves.outlines(time_s)
            local = _to_local(outlines.reshape(-1, 2), pose).reshape(outlines.shape)
            mask = self._fill(list(local))
            light *= self._soft(mask, SUN_RADIUS_RAD * leaves.height_m * slant, leaves.opacity)
        return light

    def _rover_masks(self, sun: Sun, heading_rad: float, tilt: Points) -> list[tuple[Bytes, float, float]]:
        turn = np.cos(heading_rad), np.sin(heading_rad)
        shift = np.asarray(
            (turn[0] * sun.shift[0] + turn[1] * sun.shift[1], turn[0] * sun.shift[1] - turn[1] * sun.shift[0])
        )
        layers: dict[int, list[Points]] = {}
        for part in self.parts:
            corners = part.corners() @ tilt.T
            ground = corners[:, :2] + corners[:, 2:] * shift
            hull = np.asarray(cv2.convexHull(ground.astype(np.float32)), np.float64).reshape(-1, 2)
            layers.setdefault(int(part.centre[2] / 0.25), []).append(hull)
        slant = 1.0 / np.sin(sun.elevation_rad)
        return [
            (self._fill(hulls), SUN_RADIUS_RAD * (0.25 * layer + 0.12) * slant, 1.0)
            for layer, hulls in layers.items()
        ]

    def _fill(self, outlines: list[Points]) -> Bytes:
        mask = self._blank.copy()
        for outline in outlines:
            pixel = 16.0 * (outline - np.asarray(self.left_back)) / self.cell_m
            low, high = pixel.min(axis=0), pixel.max(axis=0)
            if (high < 0).any() or low[0] > 16 * mask.shape[1] or low[1] > 16 * mask.shape[0]:
                continue
            cv2.fillPoly(mask, [np.round(pixel).astype(np.int32)], 255, cv2.LINE_AA, 4)
        return mask

    def _soft(self, mask: Bytes, sigma_m: float, opacity: float) -> Image:
        return 1.0 - np.float32(opacity / 255.0) * blur(image(mask), max(sigma_m / self.cell_m, 0.5))

    def hidden_sky(self, body: Box) -> Image:
        """Return the share of the sky's light that the rover's body leaves at each cell."""
        rows, columns = self._blank.shape
        x = self.left_back[0] + self.cell_m * np.arange(0, columns, 8)
        y = self.left_back[1] + self.cell_m * np.arange(0, rows, 8)
        grid = np.meshgrid(x, y)
        away_x = np.maximum(np.abs(grid[0] - body.centre[0]) - body.half[0], 0.0)
        away_y = np.maximum(np.abs(grid[1] - body.centre[1]) - body.half[1], 0.0)
        distance = np.hypot(away_x, away_y)
        bottom, top = body.centre[2] - body.half[2], body.centre[2] + body.half[2]
        elevation = np.arctan2(top, distance + 0.02) - np.arctan2(max(bottom, 0.0), distance + 0.02)
        width = 2.0 * np.arctan2(body.half[1], distance + 0.1)
        loss = np.clip(0.5 * elevation / (0.5 * np.pi) * width / np.pi, 0.0, 0.7)
        return image(cv2.resize(image(1.0 - loss), (columns, rows), interpolation=cv2.INTER_LINEAR))


def _to_local(points: Points, pose: tuple[float, float, float]) -> Points:
    """Return points (n, 2) of the world in the rover's frame, m."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray((points - np.asarray(pose[:2])) @ np.asarray(((cos, -sin), (sin, cos))), np.float64)
