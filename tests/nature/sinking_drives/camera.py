"""The camera: its rig, its rays, and what lens and sensor do to an image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .motion import RADIUS, REAR_LEFT

F64 = NDArray[np.float64]
F32 = NDArray[Any]  # of float32

WIDE, HIGH = 640, 480
ATTITUDE_ERROR_DEG, PLACE_ERROR = 0.2, 0.003  # given against true rig, rms per axis
FULL_WELL, READ_NOISE = 9000.0, 9.0  # electrons
GAMMA_TABLE = ((np.arange(4096) / 4095) ** (1 / 2.2) * 255 + 0.5).astype(np.uint8)  # 12-bit counts
JPEG_QUALITY = 85


@dataclass
class Rig:
    """Intrinsics and the place of the camera in the vehicle."""

    matrix: F64
    distortion: F64
    rotation: F64  # vehicle from camera
    place: F64

    def rays(self) -> F32:
        """Return the ray of each pixel in the camera frame, third component one."""
        u, v = np.meshgrid(np.arange(WIDE, dtype=float), np.arange(HIGH, dtype=float))
        stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-10)
        points = np.stack([u, v], -1).reshape(-1, 1, 2)
        flat = cv2.undistortPoints(points, self.matrix, self.distortion, criteria=stop)
        rays = np.ones((HIGH, WIDE, 3), np.float32)
        rays[..., :2] = flat.reshape(HIGH, WIDE, 2)
        return rays


def make_rig(rng: np.random.Generator, height: float, focal: float, lateral: float) -> Rig:
    """Put a camera at the rear, its nearest ray just behind the rear wheel."""
    matrix = np.array(
        [
            [focal, 0, WIDE / 2 + rng.normal(0, 4)],
            [0, focal * (1 + rng.normal(0, 0.001)), HIGH / 2 + rng.normal(0, 4)],
            [0, 0, 1],
        ]
    )
    distortion = np.array(
        [rng.uniform(-0.15, -0.02), rng.uniform(0, 0.04), rng.normal(0, 5e-4), rng.normal(0, 5e-4), 0.0]
    )
    place = np.array([REAR_LEFT[0] - 0.02, lateral, height])
    clear = np.degrees(np.arctan((RADIUS + 0.015) / height))
    tilt = np.radians(90 - clear - np.degrees(np.arctan(HIGH / 2 / focal)) - 1.0)
    axis = np.array([-np.cos(tilt), 0, -np.sin(tilt)])
    right = np.array([0.0, 1.0, 0.0])
    base = np.stack([right, np.cross(axis, right), axis], 1)
    turn = Rotation.from_euler("z", rng.uniform(-4, 4), degrees=True).as_matrix()
    twist = Rotation.from_euler("z", rng.uniform(-1.5, 1.5), degrees=True).as_matrix()
    return Rig(matrix, distortion, turn @ base @ twist, place)


def misjudge(rng: np.random.Generator, rig: Rig) -> Rig:
    """Return the given rig: the true one with errors of calibration."""
    error = Rotation.from_rotvec(rng.normal(0, np.radians(ATTITUDE_ERROR_DEG), 3)).as_matrix()
    place = rig.place + rng.normal(0, PLACE_ERROR, 3)
    return Rig(rig.matrix, rig.distortion, error @ rig.rotation, place)


@dataclass
class Dirt:
    """What sticks to the lens: a fraction of light lost, and a veil scattered in."""

    loss: F32
    veil: F32


def make_dirt(rng: np.random.Generator, kinds: tuple[str, ...]) -> Dirt:
    """Draw specks and smears, out of focus since they sit on the glass."""
    loss: F32 = np.zeros((HIGH, WIDE), np.float32)
    veil: F32 = np.zeros((HIGH, WIDE), np.float32)
    if "specks" in kinds:
        for _ in range(int(rng.integers(25, 60))):
            spot: F32 = np.zeros_like(loss)
            centre = (int(rng.uniform(0, WIDE)), int(rng.uniform(0, HIGH)))
            radius = float(np.clip(4 * np.exp(0.7 * rng.standard_normal()), 1.5, 22))
            axes = (max(1, int(radius)), max(1, int(radius * rng.uniform(0.5, 1))))
            cv2.ellipse(spot, centre, axes, rng.uniform(0, 180), 0, 360, 1.0, -1, cv2.LINE_AA)
            spot = cv2.GaussianBlur(spot, (0, 0), rng.uniform(0.8, 3.5))
            loss = 1 - (1 - loss) * (1 - np.float32(rng.uniform(0.06, 0.95)) * spot)
            veil += np.float32(rng.choice([0.0, 0.0, 0.15, 0.5])) * spot
    if "smears" in kinds:
        for _ in range(int(rng.integers(4, 8))):
            spot = np.zeros_like(loss)
            start = rng.uniform([0, 0], [WIDE, HIGH])
            turn, reach = rng.uniform(0, np.pi), rng.uniform(80, 300)
            bend = rng.normal(0, 0.004)
            steps = np.linspace(0, reach, 30)
            line = np.cumsum(np.stack([np.cos(turn + bend * steps), np.sin(turn + bend * steps)], 1), 0)
            points = np.round(start + line * reach / 30).astype(np.int32)
            cv2.polylines(spot, [points], False, 1.0, int(rng.integers(10, 50)), cv2.LINE_AA)
            spot = cv2.GaussianBlur(spot, (0, 0), rng.uniform(4, 14))
            streak = cv2.GaussianBlur(rng.standard_normal(spot.shape).astype(np.float32), (0, 0), 5)
            spot *= np.clip(0.75 + 0.5 * streak / streak.std() * 0.5, 0, 1.2)
            loss = 1 - (1 - loss) * (1 - np.float32(rng.uniform(0.15, 0.45)) * np.clip(spot, 0, 1))
            veil += np.float32(rng.uniform(0.05, 0.3)) * np.clip(spot, 0, 1)
    return Dirt(np.clip(loss, 0, 0.97), np.clip(veil, 0, 0.6))


def vignette() -> F32:
    """Return the light lost towards the corners, cos^4 of a 30-degree half field."""
    v, u = np.mgrid[0:HIGH, 0:WIDE].astype(np.float32)
    r2 = ((u - WIDE / 2) ** 2 + (v - HIGH / 2) ** 2) / np.float32(400.0**2)
    return np.asarray((1 + r2 * np.float32(np.tan(np.radians(25)) ** 2)) ** -2, np.float32)


def disk(radius: float) -> F32:
    """Return the blur kernel of a defocused lens."""
    n = int(np.ceil(radius))
    fine = np.linspace(-n - 0.5, n + 0.5, (2 * n + 1) * 8 + 1)[:-1] + 1 / 16
    inside = (fine[:, None] ** 2 + fine[None, :] ** 2 <= radius**2).astype(np.float32)
    kernel = inside.reshape(2 * n + 1, 8, 2 * n + 1, 8).mean((1, 3))
    return np.asarray(kernel / kernel.sum(), np.float32)


def expose(
    rng: np.random.Generator,
    light: F32,
    gain: float,
    full_well: float,
    dirt: Dirt | None,
    defocus: float,
    haze: float,
    fall_off: F32,
) -> NDArray[np.uint8]:
    """Turn scene light into an 8-bit image: lens, dirt, haze, shot and read noise, gamma."""
    if defocus > 0:
        light = cv2.filter2D(light, -1, disk(defocus), borderType=cv2.BORDER_REFLECT)
    mean = light.mean((0, 1))
    if haze > 0:
        light = light * np.float32(1 - haze) + np.float32(haze) * mean
    if dirt is not None:
        light = light * (1 - dirt.loss)[..., None] + dirt.veil[..., None] * mean
    signal = light * fall_off[..., None] * np.float32(gain * full_well)
    noise = rng.standard_normal(signal.shape, dtype=np.float32)
    signal += noise * np.sqrt(np.clip(signal, 0, None) + np.float32(READ_NOISE**2))
    counts = np.clip(signal * np.float32(4095 / full_well), 0, 4095).astype(np.uint16)
    return np.asarray(GAMMA_TABLE[counts])
