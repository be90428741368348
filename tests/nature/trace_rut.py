"""What wheels leave on the ground: distances to their ways, and the looks of the ruts, for `trace_scene`."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tests.nature.trace_drive import POINT_M, REMEMBERED_M, Flags, Floats

Layer = NDArray[np.float32]
View = tuple[slice, slice]

LOOKS = ("dark", "light", "relief", "bars", "chevrons", "smooth", "soft")
COARSE = 8
"""Distances to ways and shadows are found for every so many pixels, and interpolated."""
FAR_M = 0.25


@dataclass(frozen=True, kw_only=True)
class RutLook:
    """How the ground looks where a wheel went.

    Attributes:
        tone: Logarithm of the floor's brightness against the ground's.
        depth_m: Of the floor below the ground; `berm_m` is the height of the berms.
        wall: Share of half the width that the wall takes.
        blur: How much of the ground's texture is gone from the floor, 0 to 1.
        bar_tone: Logarithm of the brightness of the grousers' prints, `bar_m` their depth.
        chevron: How far the prints run ahead in the middle, per distance from it.
        ragged_m: How far the edges waver.
    """

    tone: float = 0.0
    depth_m: float = 0.006
    berm_m: float = 0.002
    wall: float = 0.2
    blur: float = 0.3
    bar_tone: float = 0.0
    bar_m: float = 0.0
    chevron: float = 0.0
    ragged_m: float = 0.002


@dataclass(frozen=True, kw_only=True)
class Way:
    """Where a wheel went: world points, way so far, wheel angle, and what it left."""

    points_m: Floats
    way_m: Floats
    theta_rad: Floats
    takes_rut: Flags
    width_m: float
    pitch_m: float
    look: RutLook


def draw_look(name: str, rng: np.random.Generator) -> RutLook:
    """Return a rut of the named look."""
    ragged = float(rng.uniform(0.0005, 0.003))
    wall = float(rng.uniform(0.1, 0.35))

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    if name == "dark":
        bars = between(0, 0.06)
        return RutLook(tone=between(-0.4, -0.15), wall=wall, bar_tone=-bars, bar_m=0.001, ragged_m=ragged)
    if name == "light":
        bars = between(0, 0.06)
        return RutLook(tone=between(0.12, 0.3), wall=wall, bar_tone=bars, bar_m=0.001, ragged_m=ragged)
    if name == "relief":
        depth, berm = between(0.008, 0.016), between(0.002, 0.007)
        return RutLook(depth_m=depth, berm_m=berm, wall=between(0.2, 0.4), blur=0.0, ragged_m=ragged)
    if name == "smooth":
        return RutLook(
            tone=between(-0.05, 0.05), depth_m=0.003, berm_m=0.001, blur=between(0.7, 0.95), ragged_m=ragged
        )
    if name == "soft":
        return RutLook(tone=between(-0.3, -0.12), depth_m=0.008, wall=between(0.5, 0.8), blur=0.2)
    return RutLook(
        tone=between(-0.1, 0.05),
        depth_m=between(0.003, 0.008),
        wall=wall,
        bar_tone=float(rng.choice([-1, 1])) * between(0.12, 0.3),
        bar_m=between(0.001, 0.003),
        chevron=between(0.4, 0.9) if name == "chevrons" else 0.0,
        ragged_m=ragged,
    )


def beside(
    way: Way, until: int | None, coarse: tuple[Layer, Layer], sun_m: tuple[float, float]
) -> tuple[View, list[Layer]] | None:
    """Return for places: way along the trace, distance left of it, and how a step sunwards changes both.

    Only for the part of the picture that shows the trace; None where none does. Ahead of the wheel, and
    where the ground took no rut, the distance is large.
    """
    last = len(way.way_m) - 1 if until is None else until
    ways = np.arange(
        way.way_m[last], max(way.way_m[last] - REMEMBERED_M - 2.0 * (until is None), 0.0), -POINT_M
    )
    if len(ways) < 3:
        return None
    when = np.interp(ways, way.way_m[: last + 1], np.arange(last + 1.0))
    points = np.stack(
        [np.interp(when, np.arange(last + 1.0), way.points_m[: last + 1, k]) for k in (0, 1)], 1
    )
    course = np.gradient(points, axis=0)
    course /= -np.linalg.norm(course, axis=1)[:, None]
    places = np.stack([layer.ravel() for layer in coarse], axis=1).astype(np.float64)
    nearest = cKDTree(points).query(places, distance_upper_bound=FAR_M)[1]
    found = nearest < len(points)
    if not found.any():
        return None
    nearest = np.where(found, nearest, 0)
    from_point, ahead = places - points[nearest], course[nearest]
    further = (from_point * ahead).sum(axis=1)
    along = ways[nearest] + further
    aside = from_point[:, 1] * ahead[:, 0] - from_point[:, 0] * ahead[:, 1]
    none = ~found | ((nearest == 0) & (further > 0)) | ((nearest == len(points) - 1) & (further < 0))
    none |= ~way.takes_rut[np.round(when).astype(int)][nearest]
    aside = np.where(none, np.copysign(FAR_M, aside), aside)
    along_sun = ahead[:, 0] * sun_m[0] + ahead[:, 1] * sun_m[1]
    aside_sun = ahead[:, 0] * sun_m[1] - ahead[:, 1] * sun_m[0]
    shape = coarse[0].shape
    layers = [np.asarray(v.reshape(shape), np.float32) for v in (along, aside, along_sun, aside_sun)]
    return _cropped(layers, np.abs(layers[1]) < way.width_m)


def _cropped(layers: list[Layer], shown: Flags) -> tuple[View, list[Layer]] | None:
    """Return the part of the picture with something to show, and the layers for each of its pixels."""
    if not shown.any():
        return None
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    top, left = max(rows[0] - 1, 0), max(columns[0] - 1, 0)
    bottom, right = min(rows[-1] + 2, shown.shape[0]), min(columns[-1] + 2, shown.shape[1])
    view = np.s_[top * COARSE : (bottom - 1) * COARSE, left * COARSE : (right - 1) * COARSE]
    return view, [enlarged(layer[top:bottom, left:right]) for layer in layers]


def profile(way: Way, along: Layer, aside: Layer) -> tuple[Layer, Layer, Layer]:
    """Return how much a trace decides at places beside its way, its height in m, and its tone."""
    look, half = way.look, way.width_m / 2
    off = np.abs(aside) / np.float32(half)
    floor = smooth((1 - off) / np.float32(look.wall))
    theta = np.interp(along, way.way_m[::20], way.theta_rad[::20]).astype(np.float32) if look.bar_m else 0.0
    phase = (along - aside * np.tan(theta) - np.float32(look.chevron) * np.abs(aside)) / np.float32(
        way.pitch_m
    )
    bar = smooth(np.float32(4.0) * np.cos(2 * np.pi * phase) - np.float32(1.5)) * floor
    berm = np.exp(-(((off - 1.15) / 0.12) ** 2))
    height = -look.depth_m * floor - look.bar_m * bar + look.berm_m * berm
    here = np.where(off < 1.6, smooth((np.float32(1.55) - off) / np.float32(0.2)), 0)
    return (
        np.asarray(here, np.float32),
        np.asarray(height, np.float32),
        np.asarray(look.tone * floor + look.bar_tone * bar, np.float32),
    )


def smooth(value: Layer | Floats) -> Layer:
    """Return 0 to 1, with soft ends, where the value goes from -1 / 2 to 1 / 2."""
    t = np.clip(value + np.float32(0.5), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), np.float32)


def enlarged(layer: Layer) -> Layer:
    """Return a layer of every `COARSE`-th pixel for every pixel."""
    scale = np.array([[1 / COARSE, 0, 0], [0, 1 / COARSE, 0]])
    size = ((layer.shape[1] - 1) * COARSE, (layer.shape[0] - 1) * COARSE)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(layer, scale, size, flags=flags, borderMode=cv2.BORDER_REPLICATE))
