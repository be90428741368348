"""Drives of a three-wheeled rover under an overhead camera: truth for its odometry.

The rover goes along straight lines in directions of its body; each wheel's rim speed follows from the rigid
motion by the tangent of the wheel, plus what it slips. Pose by the midpoint rule at 500 Hz; ticks are whole,
the camera sees pixels of a scale of its own, with noise, and some time ago. It knows nothing of any odometry.
"""

import gzip
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WHEELS_DEG = (60.0, 180.0, 300.0)
TICKS_PER_TURN = 32000
STEP_S = 0.002
ROW_STEPS = 15
PEAK_S = 1.5
NAMES = ("t", "m1pos", "m2pos", "m3pos", "m1cur", "m2cur", "m3cur", "xpos", "ypos", "ang")
UNITS = ("ms", "ticks", "ticks", "ticks", "A", "A", "A", "pix", "pix", "deg")


@dataclass(frozen=True, kw_only=True)
class TrueRover:
    """What the rover and its camera are; the published numbers, each a little off."""

    radius_m: float = 0.04008
    arm_m: float = 0.1262
    mm_per_px: float = 1.846
    marker_deg: float = 0.6
    camera_age_s: float = 0.034
    slip_per_pull: float = 0.0
    pixel_noise: float = 0.12
    lost_ticks: float = 0.0
    losing_wheel: int = 0
    creep_m_s: float = 0.0
    """Speed of the floor under the rover, along x."""


def record(
    rover: TrueRover,
    direction_deg: float,
    speed_m_s: float,
    rng: np.random.Generator,
    *,
    duration_s: float = 12.0,
    turning: Callable[[float], float] = lambda t: 0.0,
) -> Array:
    """Return rows in the order of `NAMES`."""
    heading, spot = 0.3 * rng.standard_normal(), np.array([1.5, 1.0])
    turned, rows, past = np.zeros(3), [], []
    angles = np.radians(WHEELS_DEG)
    pulls = 0.35 + 0.5 * np.abs(np.sin(angles - math.radians(direction_deg)))
    for step in range(round(duration_s / STEP_S)):
        t = step * STEP_S
        speed = speed_m_s * min(1.0, t / PEAK_S)
        rate = turning(t)
        body = math.radians(direction_deg)
        ahead, aside = speed * math.cos(body), speed * math.sin(body)
        middle = heading + 0.5 * rate * STEP_S
        spot = spot + STEP_S * speed * np.array([math.cos(middle + body), math.sin(middle + body)])
        spot[0] += rover.creep_m_s * STEP_S * (speed > 0.0)
        heading += rate * STEP_S
        rim = -np.sin(angles) * ahead + np.cos(angles) * aside + rover.arm_m * rate
        turned = turned + rim / rover.radius_m / (1.0 - rover.slip_per_pull * (pulls - 0.2)) * STEP_S
        past.append((spot[0], spot[1], heading))
        if step % ROW_STEPS == 0:
            seen = past[max(0, step - round(rover.camera_age_s / STEP_S))]
            rows.append((t, *turned, *_current(pulls, speed, rng), *_pixels(rover, seen, rng)))
    table = np.array(rows)
    ticks = table[:, 1:4] / math.tau * TICKS_PER_TURN
    ticks[:, rover.losing_wheel] *= 1.0 - rover.lost_ticks
    table[:, 1:4] = np.floor(ticks)
    table[:, 0] *= 1000.0
    return table


def _current(pulls: Array, speed: float, rng: np.random.Generator) -> Array:
    return np.abs(pulls * (speed > 0.0) + 0.03 * rng.standard_normal(3))


def _pixels(
    rover: TrueRover, seen: tuple[float, float, float], rng: np.random.Generator
) -> tuple[float, ...]:
    x, y = np.array(seen[:2]) * 1000.0 / rover.mm_per_px + rover.pixel_noise * rng.standard_normal(2)
    return x, -y, math.degrees(seen[2]) + rover.marker_deg - 90.0 + 0.15 * rng.standard_normal()


def write(path: Path, table: Array) -> Path:
    """Write rows in the layout of the measured runs, the other columns left out."""
    heads = [";".join(names) for names in (NAMES, UNITS, NAMES)]
    rows = (";".join(f"{value:.6g}" for value in row) for row in table)
    path.write_bytes(gzip.compress("\n".join((*heads, *rows, "")).encode()))
    return path
