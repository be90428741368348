"""Ray casting of the textured relief, lit by sun and sky, seen by a moving camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .camera import HIGH, WIDE, Rig
from .grounds import CELL, Ground
from .motion import Motion
from .shadows import RASTER, Canvas, Occluder

F64 = NDArray[np.float64]
F32 = NDArray[Any]  # of float32

LAYER = 0.003  # metres of height between two looks along a ray
REFINE = 4  # steps of refinement after the layers
BAND_ROWS = 40  # image rows cast together, few enough to stay in the cache


@dataclass
class Light:
    """Sun direction (unit, towards the sun), its share of the light, and both colours."""

    sun: F64
    share: float
    sun_colour: tuple[float, float, float] = (0.92, 0.98, 1.0)
    sky_colour: tuple[float, float, float] = (1.0, 0.92, 0.85)


class Map:
    """The part of the ground that a drive sees, with its lighting worked in."""

    def __init__(
        self, ground: Ground, box: tuple[float, float, float, float], corner: tuple[int, int]
    ) -> None:
        """Cut the box (x0, y0, x1, y1) out of the repeating tile."""
        self.x0, self.y0 = box[0], box[1]
        tile = ground.height.shape[0]
        cols = (corner[0] + np.arange(int((box[2] - box[0]) / CELL) + 1)) % tile
        rows = (corner[1] + np.arange(int((box[3] - box[1]) / CELL) + 1)) % tile
        self.height = np.ascontiguousarray(ground.height[np.ix_(rows, cols)])
        self.albedo = np.ascontiguousarray(ground.albedo[np.ix_(rows, cols)])
        self.colour = np.array(ground.colour)
        self.sky: list[F32] = []
        self.lit: list[F32] = []

    def smooth_height(self) -> Callable[[F64, F64], F64]:
        """Return a function for the height under a wheel, smoothed over its contact patch."""
        small = cv2.resize(self.height, None, fx=1 / 8, fy=1 / 8, interpolation=cv2.INTER_AREA)
        small = cv2.GaussianBlur(small, (0, 0), 0.04 / (8 * CELL))

        def look(x: F64, y: F64) -> F64:
            u = ((x - self.x0) / CELL + 0.5) / 8 - 0.5
            v = ((y - self.y0) / CELL + 0.5) / 8 - 0.5
            got = cv2.remap(
                small,
                u.astype(np.float32)[None],
                v.astype(np.float32)[None],
                cv2.INTER_CUBIC,
                borderMode=cv2.BORDER_REPLICATE,
            )
            return np.asarray(got[0], float)

        return look

    def illuminate(self, light: Light, footprints: tuple[float, float], contrast: float) -> None:
        """Work out sunlit and sky-lit reflectance, filtered for near and far pixels."""
        gx = cv2.Sobel(self.height, cv2.CV_32F, 1, 0, ksize=3, scale=1 / (8 * CELL))
        gy = cv2.Sobel(self.height, cv2.CV_32F, 0, 1, ksize=3, scale=1 / (8 * CELL))
        sx, sy, sz = (np.float32(c) for c in light.sun)
        norm = 1 / np.sqrt(1 + gx * gx + gy * gy)
        facing = np.clip(sz - gx * sx - gy * sy, 0, None) * norm / sz
        hollow = cv2.GaussianBlur(self.height, (0, 0), 0.008 / CELL) - self.height
        open_sky = np.clip(1 - 60 * hollow, 0.45, 1.25) * (0.4 + 0.6 * norm)
        open_sky *= np.clip(1 - np.float32(0.25) * (gx * sx + gy * sy), 0.5, 1.5)
        lit = self.albedo * facing * self._self_shadow(light.sun) * np.float32(light.share)
        sky = self.albedo * open_sky * np.float32(1 - light.share)
        for full, levels in ((lit, self.lit), (sky, self.sky)):
            source = full
            if contrast < 1:
                source = full.mean() + np.float32(contrast) * (full - full.mean())
            for size in footprints:
                levels.append(cv2.GaussianBlur(source, (0, 0), max(0.35, 0.45 * size / CELL)))

    def _self_shadow(self, sun: F64) -> F32:
        """March towards the sun over the relief at half resolution."""
        small = cv2.resize(self.height, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        slope = sun[2] / np.hypot(sun[0], sun[1])
        unit = sun[:2] / np.hypot(sun[0], sun[1])
        reach = min(0.06, float(np.ptp(small)) / slope)
        lit = np.ones_like(small)
        count = int(reach / (3 * CELL)) + 1
        for distance in np.linspace(2 * CELL, max(reach, 4 * CELL), count):
            move = np.array(
                [[1, 0, -unit[0] * distance / (2 * CELL)], [0, 1, -unit[1] * distance / (2 * CELL)]]
            )
            other = cv2.warpAffine(small, move, small.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
            excess = other - small - np.float32(distance * slope)
            lit = np.minimum(lit, np.clip(1 - excess / np.float32(0.0005), 0, 1))
        return cv2.resize(lit, self.height.shape[::-1], interpolation=cv2.INTER_LINEAR)


class Renderer:
    """Casts the rays of one camera onto one map."""

    def __init__(self, ground_map: Map, rig: Rig, light: Light, occluders: list[Occluder]) -> None:
        self.map, self.rig, self.light, self.occluders = ground_map, rig, light, occluders
        self.rays = rig.rays()
        self.coarse = cv2.resize(self.rays, (WIDE // 2, HIGH // 2), interpolation=cv2.INTER_AREA)
        down = (self.rays @ rig.rotation.T.astype(np.float32))[..., 2]
        length = np.linalg.norm(self.rays, axis=2)
        slant = -rig.place[2] / down * length / rig.matrix[0, 0] * np.sqrt(-length / down)
        self.near, self.far = float(slant.min()), float(slant.max())
        self.far_weight = np.clip((slant - self.near) / (self.far - self.near), 0, 1).astype(np.float32)
        low, high = float(ground_map.height.min()), float(ground_map.height.max())
        count = int(np.clip(np.ceil((high - low) / LAYER), 3, 18))
        self.layers = np.linspace(high + 1e-4, low - 1e-4, count + 1).astype(np.float32)

    def _slopes(self, rays: F32, rotation: F64) -> tuple[F32, F32]:
        world = rays @ (rotation @ self.rig.rotation).T.astype(np.float32)
        return world[..., 0] / world[..., 2], world[..., 1] / world[..., 2]

    def _height(self, u: F32, v: F32) -> F32:
        return cv2.remap(self.map.height, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def _march(self, rays: F32, rotation: F64, eye: F64) -> F32:
        """Return the height at which each ray first meets the ground, band by band."""
        bands = [rays[i : i + BAND_ROWS] for i in range(0, len(rays), BAND_ROWS)]
        return np.concatenate([self._march_band(band, rotation, eye) for band in bands])

    def _march_band(self, rays: F32, rotation: F64, eye: F64) -> F32:
        ax, ay = self._slopes(rays, rotation)
        u0 = np.float32((eye[0] - self.map.x0) / CELL) - ax * np.float32(eye[2] / CELL)
        v0 = np.float32((eye[1] - self.map.y0) / CELL) - ay * np.float32(eye[2] / CELL)
        ax, ay = ax / np.float32(CELL), ay / np.float32(CELL)
        above = np.full(ax.shape, self.layers[0], np.float32)
        over = np.full(ax.shape, 1e-4, np.float32)
        below = np.full(ax.shape, self.layers[-1], np.float32)
        under = np.full(ax.shape, -1e-4, np.float32)
        open_ray = np.ones(ax.shape, bool)
        for level in self.layers[1:]:
            gap = level - self._height(u0 + ax * level, v0 + ay * level)
            hit = open_ray & (gap <= 0)
            np.copyto(below, level, where=hit)
            np.copyto(under, gap, where=hit)
            open_ray &= ~hit
            np.copyto(above, level, where=open_ray)
            np.copyto(over, gap, where=open_ray)
            if not open_ray.any():
                break
        guess = above
        for _ in range(REFINE):  # regula falsi within the layer that holds the hit
            guess = below + (above - below) * (-under) / np.maximum(over - under, np.float32(1e-9))
            gap = guess - self._height(u0 + ax * guess, v0 + ay * guess)
            high = gap > 0
            np.copyto(above, guess, where=high)
            np.copyto(over, gap, where=high)
            np.copyto(below, guess, where=~high)
            np.copyto(under, gap, where=~high)
        return np.asarray(guess, np.float32)

    def look(self, rotation: F64, place: F64, heading: float, t: float, quick: bool = False) -> F32:
        """Return the light that reaches each pixel from a vehicle pose."""
        eye = place + rotation @ self.rig.place
        if quick:
            hit = self._march(self.coarse, rotation, eye)
            hit = cv2.resize(hit, (WIDE, HIGH), interpolation=cv2.INTER_LINEAR)
        else:
            hit = self._march(self.rays, rotation, eye)
        ax, ay = self._slopes(self.rays, rotation)
        drop = hit - np.float32(eye[2])
        x = np.float32(eye[0] - self.map.x0) + ax * drop
        y = np.float32(eye[1] - self.map.y0) + ay * drop
        u, v = x / np.float32(CELL), y / np.float32(CELL)
        mixed = []
        for near, far in (self.map.lit, self.map.sky):
            a = cv2.remap(near, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
            b = cv2.remap(far, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            mixed.append(a + self.far_weight * (b - a))
        lit, sky = mixed
        if self.occluders:
            sun = self.light.sun
            sx = x - hit * np.float32(sun[0] / sun[2])
            sy = y - hit * np.float32(sun[1] / sun[2])
            left, top = float(sx.min()) - 0.02, float(sy.min()) - 0.02
            size = (
                int((float(sy.max()) + 0.02 - top) / RASTER) + 1,
                int((float(sx.max()) + 0.02 - left) / RASTER) + 1,
            )
            canvas = Canvas(left + self.map.x0, top + self.map.y0, np.ones(size, np.float32))
            for occluder in self.occluders:
                occluder.cast(canvas, t, place, heading)
            lit = lit * cv2.remap(
                canvas.light,
                (sx - np.float32(left)) / np.float32(RASTER),
                (sy - np.float32(top)) / np.float32(RASTER),
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )
        warm = (self.map.colour * self.light.sun_colour).astype(np.float32)
        cold = (self.map.colour * self.light.sky_colour).astype(np.float32)
        return np.asarray(lit[..., None] * warm + sky[..., None] * cold, np.float32)

    def shoot(self, motion: Motion, t: float, exposure: float, shake: F64, samples: int) -> F32:
        """Average looks over an exposure that is centred on t; shake is a turn over it, rad."""
        if samples <= 1:
            rotation, place = motion.pose(t)
            return self.look(rotation, place, float(motion.at("psi", t)), t)
        total = np.zeros((HIGH, WIDE, 3), np.float32)
        for part in (np.arange(samples) + 0.5) / samples - 0.5:
            when = t + part * exposure
            rotation, place = motion.pose(when)
            wobble, _ = cv2.Rodrigues(shake * part)
            total += self.look(rotation @ wobble, place, float(motion.at("psi", when)), when, True)
        return total / np.float32(samples)
