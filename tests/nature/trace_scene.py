"""Pictures of a `trace_drive`: for every pixel the ray meets the ground, and what lies there is looked up.

Ruts are distance fields along the ways of the wheels, with a profile of their own look; the ground is a
photograph (CC0, as scikit-image ships them) or sums of random grids, repeated by mirroring.
"""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tests.nature.trace_drive import (
    HEIGHT,
    POINT_M,
    WIDTH,
    Drive,
    Floats,
    hides,
    rocked,
    turned,
)
from tests.nature.trace_rut import COARSE, LOOKS, Layer, Way, beside, draw_look, enlarged, profile, smooth

Picture = NDArray[np.uint8]

PHOTOGRAPHS = Path(__file__).parents[2] / "sim_backends" / "rear_scene" / "photographs"
STEP_M = 0.003
"""Slopes towards the sun are differences over this distance."""


def grown(size: int, finest: int, coarsest: int, fall: float, rng: np.random.Generator) -> Layer:
    """Return noise of unit variance: random grids of cells from finest to coarsest, enlarged and added."""
    total = np.zeros((size, size), np.float32)
    cell = finest
    while cell <= coarsest:
        grid = rng.standard_normal((size // cell + 4, size // cell + 4)).astype(np.float32)
        large = cv2.resize(grid, None, fx=cell, fy=cell, interpolation=cv2.INTER_CUBIC)
        total += np.asarray(large[cell : cell + size, cell : cell + size], np.float32) * cell**fall
        cell *= 2
    return np.asarray((total - total.mean()) / total.std(), np.float32)


class Texture:
    """A tile that is mirrored at its edges, looked up at world places."""

    def __init__(self, tile: Layer, texel_m: float, turn_rad: float = 0.0) -> None:
        both = np.hstack([tile, tile[:, ::-1]])
        self._tile = np.ascontiguousarray(np.vstack([both, both[::-1]]))
        self._texel_m, self._turn = texel_m, turn_rad

    def at(self, x: Layer, y: Layer) -> Layer:
        """Return its values at world places in m."""
        cosine, sine = (
            np.float32(np.cos(self._turn) / self._texel_m),
            np.float32(np.sin(self._turn) / self._texel_m),
        )
        column, row = x * cosine - y * sine, x * sine + y * cosine
        return np.asarray(
            cv2.remap(self._tile, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.float32
        )


class Ground:
    """Brightness (logarithm) and relief of the undisturbed ground."""

    def __init__(self, is_photograph: bool, rng: np.random.Generator) -> None:
        turn = float(rng.uniform(0, 2 * np.pi))
        if is_photograph:
            self.kind = str(rng.choice(["gravel", "grass", "brick"]))
            read = cv2.imread(str(PHOTOGRAPHS / f"{self.kind}.png"), cv2.IMREAD_GRAYSCALE)
            photograph = np.asarray(read, np.float32) / 255
            texel = float(rng.uniform(0.0010, 0.0026))
            tone = np.log(np.maximum(photograph, 0.08))
            tone = (tone - tone.mean()) * rng.uniform(0.6, 1.0)
            bumps = cv2.GaussianBlur(tone, (0, 0), 1.5) * 0.002
        else:
            self.kind = str(rng.choice(["fine", "coarse", "pebbly"]))
            texel, size = float(rng.uniform(0.0012, 0.0020)), 768
            grain, lumps = grown(size, 1, 4, -0.3, rng), grown(size, 8, 64, 0.5, rng)
            tone = {"fine": 0.05, "coarse": 0.11, "pebbly": 0.07}[self.kind] * grain + 0.03 * lumps
            if self.kind == "pebbly":
                tone -= 0.5 * np.clip(grown(size, 4, 8, 0.0, rng) - 1.7, 0, 1)
            bumps = (0.0004 * grain + 0.0012 * lumps) * rng.uniform(0.5, 1.2)
        blurred = cv2.GaussianBlur(tone, (0, 0), 0.008 / texel)
        self.tone = Texture(np.asarray(tone, np.float32), texel, turn)
        self.blurred = Texture(np.asarray(blurred, np.float32), texel, turn)
        self.bumps = Texture(np.asarray(bumps, np.float32), texel, turn)
        self.patches = Texture(grown(256, 8, 64, 0.5, rng), 0.012)
        self.patchiness = float(rng.uniform(0.02, 0.10))


class TraceScene:
    """Renders the frames of a drive.

    Args:
        drive: Motion, camera and wheels.
        look: One of `LOOKS`: how the ruts look.
    """

    def __init__(self, drive: Drive, look: str) -> None:
        self.drive = drive
        self.look = draw_look(look, np.random.default_rng([drive.seed, LOOKS.index(look), 98]))
        # Ground, light and camera are the same whatever the look, so that looks can be compared.
        rng = np.random.default_rng([drive.seed, 99])
        photographs = {"texture": 1.0, "easy": 0.2}.get(drive.name, 0.6)
        self.ground = Ground(bool(rng.random() < photographs), rng)
        self._draw_light(rng)
        self._ways = [self._way(number) for number in (3, 2, 1, 0)]
        self._old = self._old_ways(rng) if drive.name in ("overlap", "no_trace") else []
        per_m2 = float(rng.uniform(8, 25) if drive.name == "shadow" else rng.uniform(0, 6))
        self._stones = self._draw_stones(per_m2, rng)
        self._rays = drive.camera.rays(1).astype(np.float32)
        self._coarse_rays = drive.camera.rays(COARSE)
        to_ground = -drive.camera.place_m[2] / np.minimum(self._rays[..., 2:], -1e-3)
        self._wheel = hides(drive.wheels[0], drive.camera.place_m, self._rays.astype(np.float64) * to_ground)
        rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
        off = ((columns - WIDTH / 2) ** 2 + (rows - HEIGHT / 2) ** 2) / (WIDTH / 2) ** 2
        self._vignette = np.asarray(1 - rng.uniform(0, 0.22) * off, np.float32)
        tint = np.array([rng.uniform(0.65, 0.95), rng.uniform(0.9, 1.0), rng.uniform(1.0, 1.15)])
        self._tint = np.asarray(tint, np.float32)
        self._level, self._gamma = float(rng.uniform(75, 140)), float(rng.uniform(0.6, 1.0))
        self._noise, self._blur = float(rng.uniform(1.0, 4.5)), float(rng.uniform(0.4, 1.1))
        self._quality = int(rng.integers(60, 96))

    def frames(self) -> Iterator[Picture]:
        """Render all frames in order; the same ones with every call."""
        for frame in range(len(self.drive.steps)):
            yield self.frame(frame)

    def frame(self, frame: int) -> Picture:
        """Return the picture (BGR) of one frame."""
        rng = np.random.default_rng([self.drive.seed, frame, 5])
        bright = self._light_on_ground(self.drive.steps[frame])
        bright[self._wheel] = 0.12 + 0.02 * np.asarray(rng.random(), np.float32)
        grey = self._level * self.drive.gain[frame] * self._vignette * bright**self._gamma
        grey = cv2.GaussianBlur(np.asarray(grey, np.float32), (0, 0), self._blur)
        noise = rng.standard_normal((HEIGHT, WIDTH), np.float32) * self._noise
        coloured = (grey + noise)[..., None] * self._tint
        whole = np.clip(coloured + 0.5, 0, 255).astype(np.uint8)
        packed = cv2.imencode(".jpg", whole, [cv2.IMWRITE_JPEG_QUALITY, self._quality])[1]
        return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)

    def on_ground(self, step: int, rays: Floats | Layer) -> tuple[Layer, Layer]:
        """Return the world places (x, y) that rays of the level vehicle meet, the body's rocking included."""
        turn = rocked(*self.drive.motion.rock_rad[step])
        place = turn @ self.drive.camera.place_m
        leaning = [rays @ np.asarray(axis, rays.dtype) for axis in turn]
        reach = np.asarray(place[2], rays.dtype) / np.maximum(-leaning[2], 0.05)
        yaw, origin = float(self.drive.motion.yaw_rad[step]), self.drive.motion.origin_m[step]
        ahead, left = np.float32(place[0]) + reach * leaning[0], np.float32(place[1]) + reach * leaning[1]
        cosine, sine = np.float32(np.cos(yaw)), np.float32(np.sin(yaw))
        x, y = cosine * ahead - sine * left + origin[0], sine * ahead + cosine * left + origin[1]
        return np.asarray(x, np.float32), np.asarray(y, np.float32)

    def _light_on_ground(self, step: int) -> Layer:
        x, y = self.on_ground(step, self._rays)
        coarse = self.on_ground(step, self._coarse_rays)
        sun_x, sun_y, sun_z = self._sun
        dx, dy = (
            np.float32(STEP_M * sun_x / np.hypot(sun_x, sun_y)),
            np.float32(STEP_M * sun_y / np.hypot(sun_x, sun_y)),
        )
        tone = self.ground.tone.at(x, y)
        rough = (self.ground.bumps.at(x + dx, y + dy) - self.ground.bumps.at(x, y)) / np.float32(STEP_M)
        even = self.ground.blurred.at(x, y)
        slope, own = np.zeros_like(tone), np.zeros_like(tone)
        gone = np.zeros_like(tone)
        wobble = self.ground.patches.at(x * 12, y * 12)
        for way, until in [(way, None) for way in self._old] + [(way, step) for way in self._ways]:
            found = beside(way, until, coarse, (float(dx), float(dy)))
            if found is None:
                continue
            view, (along, aside, along_sun, aside_sun) = found
            aside = aside + wobble[view] * np.float32(way.look.ragged_m)
            here, height, colour = profile(way, along, aside)
            _, ahead, _ = profile(way, along + along_sun, aside + aside_sun)
            slope[view] += here * ((ahead - height) / np.float32(STEP_M) - slope[view])
            own[view] += here * (colour - own[view])
            gone[view] += here * (np.float32(way.look.blur) * (here > 0.5) - gone[view])
        tone = tone + gone * (even - tone) + self.ground.patchiness * self.ground.patches.at(x, y) + own
        slope = slope + rough * (1 - gone)
        facing = np.clip(sun_z - slope * np.hypot(sun_x, sun_y), 0, None) / np.sqrt(1 + slope**2)
        lit = self._shade_of_rover(step, coarse) * self._shade_of_trees(x, y)
        albedo = np.exp(np.clip(tone, -2.5, 1.2))
        self._lay_stones(step, x, y, albedo, facing)
        return np.asarray(albedo * (self._sky + (1 - self._sky) * lit * facing / sun_z), np.float32)

    def _draw_light(self, rng: np.random.Generator) -> None:
        heading = float(self.drive.motion.yaw_rad[0])
        low = self.drive.name == "shadow" or (self.drive.name == "no_trace" and rng.random() < 0.5)
        azimuth = heading + rng.uniform(-1.0, 1.0) if low else rng.uniform(0, 2 * np.pi)
        elevation = np.radians(rng.uniform(25, 45) if low else rng.uniform(35, 70))
        flat = np.cos(elevation)
        self._sun = (float(flat * np.cos(azimuth)), float(flat * np.sin(azimuth)), float(np.sin(elevation)))
        self._sky = float(rng.uniform(0.25, 0.5) if low else rng.uniform(0.3, 0.7))
        self._penumbra_m = float(rng.uniform(0.004, 0.03))
        self._mast = (
            float(rng.uniform(-0.2, 0.2)),
            float(rng.uniform(-0.2, 0.2)),
            float(rng.uniform(0.5, 0.9)),
        )
        self._leaves = Texture(grown(512, 16, 128, 0.3, rng), 0.004) if low else None
        self._leaf_share = float(rng.uniform(-0.3, 0.8))

    def _way(self, number: int) -> Way:
        wheel, motion = self.drive.wheels[number], self.drive.motion
        points = motion.wheel_way(wheel)
        gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        way = np.concatenate([[0.0], np.cumsum(gaps)])
        course = np.unwrap(np.arctan2(*np.gradient(points, axis=0).T[::-1]))
        return Way(
            points_m=points,
            way_m=way,
            theta_rad=course - motion.yaw_rad - wheel.steer_rad,
            takes_rut=motion.takes_rut(motion.way_m + wheel.x_m - self.drive.wheels[0].x_m),
            width_m=wheel.width_m,
            pitch_m=2 * np.pi * wheel.radius_m / wheel.lug_count * 0.85,
            look=self.look,
        )

    def _old_ways(self, rng: np.random.Generator) -> list[Way]:
        """Lay straight old traces across the way; beside a missing one none lies within 35 degrees of it."""
        points, ways = self.drive.motion.wheel_way(self.drive.wheels[0]), []
        least = 35 if self.drive.name == "no_trace" else 12
        for middle in points[:: max(len(points) // 5, 1)]:
            turn = np.radians(rng.choice([-1, 1]) * rng.uniform(least, 75))
            heading = float(self.drive.motion.yaw_rad[0]) + turn
            along = np.arange(-2.0, 2.0, POINT_M)
            line = middle + rng.normal(0, 0.15, 2) + along[:, None] * [np.cos(heading), np.sin(heading)]
            ways.append(
                Way(
                    points_m=line,
                    way_m=along + 2.0,
                    theta_rad=np.zeros(len(along)),
                    takes_rut=np.ones(len(along), np.bool_),
                    width_m=self.drive.wheels[0].width_m,
                    pitch_m=0.03,
                    look=self.look,
                )
            )
        return ways

    def _draw_stones(self, per_m2: float, rng: np.random.Generator) -> Floats:
        """Return stones beside the wheels' ways: world x, y, radius, logarithm of brightness."""
        points = self.drive.motion.wheel_way(self.drive.wheels[0])
        low, high = points.min(axis=0) - 1.2, points.max(axis=0) + 1.2
        count = int(per_m2 * np.prod(high - low))
        stones = np.column_stack(
            [
                rng.uniform(low, high, (count, 2)),
                rng.uniform(0.004, 0.022, count),
                rng.uniform(-0.7, 0.5, count),
            ]
        )
        near = np.concatenate([way.points_m[:: len(way.points_m) // 400 + 1] for way in self._ways])
        free = cKDTree(near).query(stones[:, :2])[0] > self.drive.wheels[0].width_m / 2 + stones[:, 2]
        return np.asarray(stones[free], np.float64)

    def _shade_of_rover(self, step: int, coarse: tuple[Layer, Layer]) -> Layer:
        """Return how much of the sun body, mast and wheels let through; edges are as wide as penumbras."""
        yaw, origin = self.drive.motion.yaw_rad[step], self.drive.motion.origin_m[step]
        local = turned(np.stack(coarse, axis=-1) - origin, np.array(-yaw))
        sun = turned(np.array(self._sun[:2]), np.array(-yaw)) / self._sun[2]
        front, rear = self.drive.wheels[1], self.drive.wheels[0]
        mast_x, mast_y, mast_z = self._mast
        boxes = [
            (rear.x_m - 0.05, front.x_m + 0.05, -rear.y_m + 0.08, rear.y_m - 0.08, 0.16, 0.32),
            (mast_x - 0.02, mast_x + 0.02, mast_y - 0.02, mast_y + 0.02, 0.3, mast_z),
        ]
        for wheel in self.drive.wheels:
            long, half = 0.75 * wheel.radius_m, wheel.width_m / 2
            box = (
                wheel.x_m - long,
                wheel.x_m + long,
                wheel.y_m - half,
                wheel.y_m + half,
                0.0,
                2 * wheel.radius_m,
            )
            boxes.append(box)
        distance = np.full(local.shape[:2], 1.0)
        for x0, x1, y0, y1, z0, z1 in boxes:
            corners = np.array([(x, y) - sun * z for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)])
            hull = cv2.convexHull(corners.astype(np.float32))[:, 0].astype(np.float64)
            sides = np.roll(hull, -1, axis=0) - hull
            normals = np.stack([-sides[:, 1], sides[:, 0]], axis=1) / np.linalg.norm(sides, axis=1)[:, None]
            normals *= np.sign(((hull - hull.mean(axis=0)) * normals).sum(axis=1))[:, None]
            distance = np.minimum(distance, (local @ normals.T - (hull * normals).sum(axis=1)).max(axis=-1))
        return smooth(enlarged(np.asarray(distance, np.float32)) / np.float32(self._penumbra_m))

    def _shade_of_trees(self, x: Layer, y: Layer) -> Layer:
        if self._leaves is None:
            return np.ones_like(x)
        return 0.15 + 0.85 * smooth(np.float32(4.0) * (self._leaves.at(x, y) + np.float32(self._leaf_share)))

    def _lay_stones(self, step: int, x: Layer, y: Layer, albedo: Layer, facing: Layer) -> None:
        """Put stones and their shadows into the albedo and the light."""
        motion, camera = self.drive.motion, self.drive.camera
        local = turned(
            self._stones[:, :2] - motion.origin_m[step], np.full(len(self._stones), -motion.yaw_rad[step])
        )
        pixels = camera.pixels(np.insert(local, 2, 0.0, axis=1) @ rocked(*motion.rock_rad[step]))
        inside = (pixels > -20).all(axis=1) & (pixels < (WIDTH + 20, HEIGHT + 20)).all(axis=1)
        sun = np.array(self._sun)
        for stone, pixel in zip(self._stones[inside], np.round(pixels[inside]).astype(int), strict=True):
            half = 70
            view = np.s_[max(pixel[1] - half, 0) : pixel[1] + half, max(pixel[0] - half, 0) : pixel[0] + half]
            u, v = (x[view] - np.float32(stone[0])) / stone[2], (y[view] - np.float32(stone[1])) / stone[2]
            away = sun[:2] / sun[2] * 0.5
            shade = (u + away[0]) ** 2 + (v + away[1]) ** 2 < 1
            on = u**2 + v**2 < 1
            facing[view][shade & ~on] *= 0.2
            bulge = np.clip(sun[2] + 0.8 * (u * sun[0] + v * sun[1]), 0.1, None)
            albedo[view][on] = np.exp(stone[3])
            facing[view][on] = bulge[on]
