"""Cast shadows, drawn as polygons on the ground plane and softened by the sun's size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
F32 = NDArray[Any]  # of float32

RASTER = 0.002  # metres per cell of the shadow canvas
SUN_WIDTH = 0.0093  # angular diameter of the sun, rad


@dataclass
class Canvas:
    """A patch of ground plane on which the lit fraction of the sun is kept."""

    x0: float
    y0: float
    light: F32  # 1 = full sun

    def shade(self, polygons: list[F64], distance: float, opacity: float) -> None:
        """Darken polygons; the penumbra is the sun's width seen from the casting edge."""
        mask = np.zeros(self.light.shape, np.uint8)
        for polygon in polygons:
            points = (polygon - [self.x0, self.y0]) / RASTER
            cv2.fillPoly(mask, [np.round(points * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
        if not mask.any():
            return
        width = max(0.6, 0.3 * SUN_WIDTH * distance / RASTER)
        soft = cv2.GaussianBlur(mask.astype(np.float32) / 255, (0, 0), width)
        self.light *= 1 - np.float32(opacity) * soft

    def grid(self) -> tuple[F32, F32]:
        """Return ground coordinates of the cells."""
        rows, cols = self.light.shape
        xs = self.x0 + RASTER * np.arange(cols, dtype=np.float32)
        ys = self.y0 + RASTER * np.arange(rows, dtype=np.float32)
        return xs[None, :], ys[:, None]


class Occluder(Protocol):
    """Anything that takes sun away from a canvas at a given time."""

    def cast(self, canvas: Canvas, t: float, place: F64, heading: float) -> None:
        """Darken the canvas; place and heading are the rover's."""


@dataclass
class Rover:
    """The rover's own body, mast and solar panel as boxes (centre and half size)."""

    sun: F64
    boxes: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = (
        ((0.0, 0.0, 0.28), (0.36, 0.17, 0.10)),
        ((-0.33, 0.1, 0.55), (0.025, 0.025, 0.30)),
        ((-0.33, 0.1, 0.86), (0.05, 0.10, 0.04)),
        ((0.05, 0.0, 0.45), (0.26, 0.30, 0.012)),
        ((-0.325, 0.225, 0.09), (0.09, 0.055, 0.09)),
        ((-0.325, -0.225, 0.09), (0.09, 0.055, 0.09)),
    )

    def cast(self, canvas: Canvas, t: float, place: F64, heading: float) -> None:
        c, s = np.cos(heading), np.sin(heading)
        for centre, half in self.boxes:
            corners = np.array(centre) + np.array(half) * np.array(
                [[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]
            )
            flat = corners[:, :2] @ np.array([[c, s], [-s, c]]) + place[:2]
            flat -= corners[:, 2:] * self.sun[:2] / self.sun[2]
            hull = cv2.convexHull(flat.astype(np.float32))[:, 0].astype(float)
            canvas.shade([hull], centre[2] / self.sun[2], 0.97)


@dataclass
class Still:
    """Shadows of things that stand: posts, a fence, a rock."""

    polygons: list[F64]
    distance: float = 1.0

    def cast(self, canvas: Canvas, t: float, place: F64, heading: float) -> None:
        canvas.shade(self.polygons, self.distance, 0.95)


@dataclass
class Leaves:
    """A branch whose leaves sway, each a little out of step with the gusts."""

    centres: F64
    sizes: F64
    turns: F64
    phases: F64
    sway: float  # metres
    rhythm: float  # Hz

    def cast(self, canvas: Canvas, t: float, place: F64, heading: float) -> None:
        gust = 0.5 + 0.5 * np.sin(0.9 * t + 0.5) * np.sin(0.37 * t)
        swing = self.sway * (0.4 + gust) * np.sin(2 * np.pi * self.rhythm * t + self.phases)
        polygons = []
        ring = np.linspace(0, 2 * np.pi, 14, endpoint=False)
        for centre, size, turn, move in zip(self.centres, self.sizes, self.turns, swing, strict=False):
            angle = turn + 4 * move
            a, b = size * np.cos(ring), 0.4 * size * np.sin(ring)
            c, s = np.cos(angle), np.sin(angle)
            shift = np.array([move, 0.6 * move + 0.3 * self.sway * gust])
            polygons.append(np.stack([a * c - b * s, a * s + b * c], 1) + centre + shift)
        canvas.shade(polygons, 1.5, 0.9)


@dataclass
class Passer:
    """A shadow that sweeps over at a steady speed and comes again."""

    polygon: F64
    velocity: F64
    start: F64
    period: float

    def cast(self, canvas: Canvas, t: float, place: F64, heading: float) -> None:
        canvas.shade([self.polygon + self.start + self.velocity * (t % self.period)], 0.8, 0.95)


@dataclass
class Clouds:
    """Cloud edges: wide, soft, and fast."""

    velocity: F64
    width: float  # metres of the soft edge
    spacing: float
    depth: float
    phase: float

    def cast(self, canvas: Canvas, t: float, place: F64, heading: float) -> None:
        pace = float(np.hypot(*self.velocity))
        xs, ys = canvas.grid()
        along = (xs * self.velocity[0] + ys * self.velocity[1]) / pace - pace * t
        along = along + np.float32(0.15) * np.sin(3.0 * ys + 1.7 * xs)
        wave = np.sin(2 * np.pi * along / self.spacing + self.phase)
        steep = self.spacing / (2 * np.pi * self.width)
        canvas.light *= (1 - self.depth * 0.5 * (1 + np.tanh(2 * steep * wave))).astype(np.float32)
