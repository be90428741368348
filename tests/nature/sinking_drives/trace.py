"""The trace pressed into the ground behind a rear wheel, and what the camera sees of it."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .camera import HIGH, WIDE, Rig
from .grounds import CELL
from .motion import HALF_BASE, HALF_TRACK, LUGS, RADIUS, REAR_LEFT, WIDTH, Motion

F64 = NDArray[np.float64]
F32 = NDArray[Any]  # of float32

PATH_STEP = 0.0005  # metres between the path points that are kept
BAND = 0.1  # metres to each side of the wheel's path that the wheel changes


def contact_path(motion: Motion, side: float) -> F64:
    """Return where a rear wheel touches the ground over time."""
    c, s = np.cos(motion.psi), np.sin(motion.psi)
    a, b = -HALF_BASE, side * HALF_TRACK
    return np.stack([motion.x + a * c - b * s, motion.y + a * s + b * c], 1)


def press(
    rng: np.random.Generator,
    height: F32,
    albedo: F32,
    x0: float,
    y0: float,
    motion: Motion,
    until: float,
) -> None:
    """Press the traces of both rear wheels into a map, in place."""
    turned = np.concatenate([[0], np.cumsum(np.abs(motion.wheel[1:]) * np.diff(motion.t))])
    pitch = 2 * np.pi * RADIUS / LUGS
    rows, cols = height.shape[0] // 2, height.shape[1] // 2
    for side in (1.0, -1.0):
        path = contact_path(motion, side)
        gone = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
        keep = (motion.t <= until) & np.append(True, np.diff(gone // PATH_STEP) > 0)
        path = path[keep]
        mask = np.zeros((rows, cols), np.uint8)
        pixels = np.round((path - [x0, y0]) / (2 * CELL)).astype(np.int32)
        cv2.polylines(mask, [pixels], False, 255, int(2 * BAND / (2 * CELL)))
        v, u = np.nonzero(mask)
        if len(v) == 0:
            continue
        points = np.stack([x0 + 2 * CELL * u, y0 + 2 * CELL * v], 1)
        _, near = cKDTree(path).query(points)
        along = np.array([np.cos(motion.psi[keep]), np.sin(motion.psi[keep])]).T[near]
        gap = points - path[near]
        across = gap[:, 1] * along[:, 0] - gap[:, 0] * along[:, 1]
        ahead = np.sum(gap * along, 1)
        slip = np.clip(motion.slip[keep][near], 0, 1)
        sink = motion.sink[keep][near]
        spacing = np.maximum(pitch * (1 - slip), 1e-4)
        phase = turned[keep][near] / pitch + ahead / spacing
        rut = 1 / (1 + np.exp((np.abs(across) - WIDTH / 2) / 0.003))
        lug = (phase + 4 * across**2 / pitch) % 1.0
        print_depth = 0.006 * np.clip((spacing - 0.003) / 0.006, 0, 1)
        bars = print_depth * (np.exp(-(((lug - 0.5) / 0.18) ** 2)) - 0.3)
        berm = 0.35 * sink * np.exp(-(((np.abs(across) - WIDTH / 2 - 0.016) / 0.011) ** 2))
        fields = []
        for values in (rut, -rut * sink + rut * bars + berm):
            full = np.zeros((rows, cols), np.float32)
            full[v, u] = values
            fields.append(cv2.resize(full, height.shape[::-1], interpolation=cv2.INTER_CUBIC))
        weight, change = fields
        churn = cv2.GaussianBlur(rng.standard_normal(height.shape, dtype=np.float32), (0, 0), 2.5)
        smooth = cv2.GaussianBlur(height, (0, 0), 6.0)
        height += np.float32(0.6) * weight * (smooth - height) + change
        height += weight * np.float32(0.0005 / churn.std()) * churn
        albedo += weight * (
            np.float32(0.9) + np.float32(0.05 / churn.std()) * churn + np.float32(0.4) * (albedo - 1) - albedo
        )


def describe(motion: Motion, rig: Rig, t: float, last_theta: float) -> tuple[float, float, float, float]:
    """Return visible length, tangent angle, distance of the tangent, and chord angle (degrees).

    The tangent is the direction of the rear left contact's ground velocity in the vehicle
    frame; its distance is signed, from the origin; the chord joins the ends of what is seen.
    """
    rotation, place = motion.pose(t)
    side = float(motion.at("sideways", t)) + float(motion.at("rate", t)) * REAR_LEFT[0]
    forward = float(motion.at("forward", t)) - float(motion.at("rate", t)) * REAR_LEFT[1]
    theta = np.degrees(np.arctan(side / forward)) if abs(forward) > 1e-3 else last_theta
    rad = np.radians(theta)
    distance = REAR_LEFT[1] * np.cos(rad) - REAR_LEFT[0] * np.sin(rad)
    path = contact_path(motion, 1.0)[motion.t <= t][::-1]
    step = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    if step[-1] < 0.01:  # it never moved, so there is no trace
        return 0.0, theta, distance, theta
    grid = np.arange(0, min(1.5, step[-1]), 0.002)
    grow = np.concatenate([[True], np.diff(step) > 0])
    path = np.stack([np.interp(grid, step[grow], path[grow, i]) for i in (0, 1)], 1)
    points = np.column_stack([path, np.full(len(path), place[2])])
    local = (points - place) @ rotation
    inside = (local - rig.place) @ rig.rotation
    ahead = inside[:, 2] > 0.05
    pixels, _ = cv2.projectPoints(
        inside.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), rig.matrix, rig.distortion
    )
    pixels = pixels[:, 0]
    seen = ahead & (pixels >= 0).all(1) & (pixels[:, 0] < WIDE) & (pixels[:, 1] < HIGH)
    if seen.sum() < 2:
        return 0.0, theta, distance, theta
    first, last = np.flatnonzero(seen)[[0, -1]]
    chord = local[first] - local[last]
    angle = np.degrees(np.arctan2(chord[1], chord[0]))
    return float(seen.sum() * 0.002), theta, distance, float(angle)
