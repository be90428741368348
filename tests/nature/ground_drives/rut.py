"""Prints of wheels: a pressed floor, walls, berms, grooves of the grousers, and another tone."""

from dataclasses import dataclass

import cv2
import numpy as np

from tests.nature.ground_drives.ground import Ground, pressed_base
from tests.nature.ground_drives.noise import Image, Points, image, octaves


@dataclass(frozen=True)
class Tread:
    """Wheel that prints: width and grouser pitch at the rim, length of its contact, all in m.

    `slant_rad` turns the bars against the axle; with `chevron` both halves are slanted against each other.
    """

    width_m: float
    pitch_m: float
    contact_m: float = 0.06
    slant_rad: float = 0.0
    chevron: bool = False


@dataclass(frozen=True)
class Strength:
    """How strongly the ground takes a print: lengths in m.

    `tone` is the logarithm of the floor's albedo against the ground, `berm_tone` that of the berms; `smooth`
    from 0 to 1 is how much of the ground's own relief the wheel presses flat; `lumps_m` is the rms of the
    loose soil.
    """

    depth_m: float
    berm_m: float
    grouser_m: float
    tone: float
    berm_tone: float
    smooth: float
    lumps_m: float


@dataclass(frozen=True)
class Pass:
    """One wheel's way: position, its direction, the wheel's heading, turned rim length and softness.

    Attributes:
        points: (n, 2) position of the contact point, m, at most 4 mm apart.
        direction_rad: direction of motion of the contact point in the world.
        heading_rad: direction in which the wheel points in the world.
        rim_m: length that the rim has turned.
        softness: 0 (no print) to 1 (full strength).
    """

    points: Points
    direction_rad: Points
    heading_rad: Points
    rim_m: Points
    softness: Points


@dataclass(frozen=True)
class _Lateral:
    """Cells near a pass with the nearest sample, and the offsets along and across it in m."""

    rows: np.ndarray
    columns: np.ndarray
    nearest: np.ndarray
    along: Points
    across: Points


def _near(ground: Ground, path: Pass, reach_m: float) -> _Lateral | None:
    """Return the cells within `reach_m` of the pass; None if it does not cross the grid."""
    rows, columns = ground.shape
    pixel = np.round((path.points - np.asarray(ground.origin)) / ground.cell_m).astype(int)
    inside = (pixel >= 0).all(axis=1) & (pixel[:, 0] < columns) & (pixel[:, 1] < rows)
    if not inside.any():
        return None
    empty = np.full((rows, columns), 255, np.uint8)
    sample_at = np.zeros((rows, columns), np.int32)
    samples = np.flatnonzero(inside)
    empty[pixel[samples, 1], pixel[samples, 0]] = 0
    sample_at[pixel[samples, 1], pixel[samples, 0]] = samples
    distance, label = cv2.distanceTransformWithLabels(
        empty, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    ways = np.zeros(int(label.max()) + 1, np.int32)
    zero = empty == 0
    ways[label[zero]] = sample_at[zero]
    row, column = np.nonzero(distance * ground.cell_m < reach_m)
    nearest = ways[label[row, column]]
    offset_x = ground.origin[0] + ground.cell_m * column - path.points[nearest, 0]
    offset_y = ground.origin[1] + ground.cell_m * row - path.points[nearest, 1]
    cos, sin = np.cos(path.direction_rad[nearest]), np.sin(path.direction_rad[nearest])
    along, across = cos * offset_x + sin * offset_y, cos * offset_y - sin * offset_x
    within = np.abs(along) < 0.02  # beyond the ends of the pass nothing is printed
    return _Lateral(row[within], column[within], nearest[within], along[within], across[within])


def print_pass(
    rng: np.random.Generator, ground: Ground, path: Pass, tread: Tread, strength: Strength
) -> None:
    """Press one pass of a wheel into the ground (height and albedo are changed in place).

    The edges are those of the area that the contact patch sweeps. Bars lie along the wheel's axle, not
    across the path, one for each pitch of rim length: their distance on the ground shrinks as the wheel
    slips.
    """
    cells = _near(ground, path, 0.5 * tread.width_m + 0.09)
    if cells is None or cells.rows.size == 0:
        return
    shape, cell_m = ground.shape, ground.cell_m
    at = (cells.rows, cells.columns)
    edge_noise = octaves(rng, shape, cell_m, [(0.08, 0.0022), (0.025, 0.0018), (0.009, 0.001)])[at]
    clumps = np.clip(1.0 + octaves(rng, shape, cell_m, [(0.09, 0.35), (0.035, 0.3)])[at], 0.0, 2.2)
    lumps = octaves(rng, shape, cell_m, [(0.018, 0.6), (0.008, 0.6), (0.004, 0.4)])[at]
    vary = np.clip(1.0 + octaves(rng, shape, cell_m, [(0.5, 0.15), (0.15, 0.1)])[at], 0.4, 1.5)
    slip_angle = path.direction_rad[cells.nearest] - path.heading_rad[cells.nearest]
    half = 0.5 * tread.width_m * np.cos(slip_angle) + 0.5 * tread.contact_m * np.abs(np.sin(slip_angle))
    outside = np.abs(cells.across) - half - edge_noise * min(1.0, strength.depth_m / 0.006)
    soft = path.softness[cells.nearest] * vary * _begin(path, cells, tread)
    wall_m = max(0.0025, 0.5 * strength.depth_m)
    floor = np.clip(0.5 - outside / wall_m, 0.0, 1.0)
    floor = floor * floor * (3.0 - 2.0 * floor) * np.clip(soft, 0.0, 1.0)
    # A wheel that slides sideways pushes more soil to the side to which it slides.
    side = np.clip(1.0 + 2.5 * np.sin(slip_angle) * np.sign(cells.across), 0.15, 2.2)
    berm_width = 0.012 + 0.5 * strength.depth_m
    berm = np.exp(-(((outside - 0.7 * berm_width) / berm_width) ** 2)) * clumps * side * soft
    jitter = octaves(rng, shape, cell_m, [(0.05, 0.05), (0.015, 0.035)])[at]
    crumbled = np.clip(0.75 + octaves(rng, shape, cell_m, [(0.12, 0.25), (0.02, 0.25)])[at], 0.0, 1.2)
    bars = crumbled * _bars(path, cells, tread, slip_angle, jitter) ** rng.uniform(0.7, 3.0)
    height = ground.height[at]
    pressed = pressed_base(ground, tread.width_m)[at]
    flat = strength.smooth * pressed + (1.0 - strength.smooth) * height
    target = (
        flat - strength.depth_m * soft - strength.grouser_m * bars * soft + 0.35 * strength.lumps_m * lumps
    )
    height = height + floor * (target - height)
    ground.height[at] = height + strength.berm_m * berm + strength.lumps_m * lumps * np.clip(berm, 0.0, 1.0)
    change = strength.tone * floor * vary + strength.berm_tone * np.clip(berm, 0.0, 1.2)
    ground.albedo[at] = np.clip(ground.albedo[at] * np.exp(change)[:, None], 0.01, 0.9)


def _begin(path: Pass, cells: _Lateral, tread: Tread) -> Points:
    """Return how deep the wheel stands near the start of its way, 0 to 1: it is round."""
    way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path.points, axis=0).T))))
    depth = (way[cells.nearest] + cells.along + 0.3 * tread.contact_m) / (0.6 * tread.contact_m)
    return np.asarray(np.clip(depth, 0.0, 1.0), np.float64)


def _bars(path: Pass, cells: _Lateral, tread: Tread, slip_angle: Points, jitter: Points) -> Points:
    """Return the depth of the grouser grooves, 0 to 1, at each cell; `jitter` is in parts of a pitch."""
    gaps = np.maximum(np.hypot(*np.diff(path.points, axis=0).T), 1e-6)
    rim_per_m = np.append(np.diff(path.rim_m) / gaps, 1.0)
    slant = np.where(cells.across > 0, 1.0, -1.0 if tread.chevron else 1.0) * np.tan(tread.slant_rad)
    # The bar that covers this cell was pressed when the axle's line passed over it.
    along = cells.along - cells.across * (np.tan(slip_angle) - slant)
    phase = (path.rim_m[cells.nearest] + rim_per_m[cells.nearest] * along) / tread.pitch_m
    return np.asarray(0.5 + 0.5 * np.cos(2 * np.pi * (phase + jitter)), np.float64)


def weathered(rng: np.random.Generator, ground: Ground, before: Image, age: float) -> None:
    """Let a printed height field return towards the height `before` it was printed; `age` from 0 to 1."""
    if age <= 0.0:
        return
    keep = image(
        np.clip(1.0 - age * (1.0 + octaves(rng, ground.shape, ground.cell_m, [(0.1, 0.4)])), 0.0, 1.0)
    )
    change = cv2.GaussianBlur(ground.height - before, (0, 0), 0.2 + 4.0 * age * 0.0015 / ground.cell_m)
    ground.height[:] = before + keep * image(change)
