"""Rear-looking camera: its rig file, its rays, and what sensor and compression do to the picture."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from tests.nature.ground_drives.noise import Bytes, Image, Points, image

WIDTH, HEIGHT = 640, 480


@dataclass(frozen=True)
class Rig:
    """Camera and wheels as in the rig file; lengths in m in the rover's frame (x forward, y left, z up)."""

    matrix: Points
    distortion: Points
    rotation: Points
    position: Points
    half_length_m: float
    half_track_m: float
    wheel_radius_m: float
    wheel_width_m: float
    grouser_m: float
    lugs: int
    frames_per_s: float
    speed_mps: float

    @property
    def contact(self) -> tuple[float, float]:
        """Contact point of the observed wheel, the rear left one."""
        return -self.half_length_m, self.half_track_m

    def wheels(self) -> dict[str, tuple[float, float]]:
        """Return the contact point of each wheel by name."""
        b, w = self.half_length_m, self.half_track_m
        return {"front_left": (b, w), "front_right": (b, -w), "rear_left": (-b, w), "rear_right": (-b, -w)}

    def rays(self, columns: Points, rows: Points) -> Points:
        """Return the directions, in the rover's frame, in which the pixels look; (n, 3), not normalised."""
        pixels = np.column_stack((columns, rows)).reshape(-1, 1, 2).astype(np.float64)
        flat = np.asarray(cv2.undistortPoints(pixels, self.matrix, self.distortion), np.float64).reshape(
            -1, 2
        )
        return np.asarray(np.column_stack((flat, np.ones(len(flat)))) @ self.rotation.T, np.float64)

    def pixels(self, points: Points) -> tuple[Points, np.ndarray]:
        """Return the pixels (n, 2) of points of the rover's frame, and whether each lies in the picture."""
        seen = (points - self.position) @ self.rotation
        ahead = (seen[:, 2] > 0.05) & (np.hypot(seen[:, 0], seen[:, 1]) < 0.8 * np.maximum(seen[:, 2], 1e-6))
        flat = np.where(ahead[:, None], seen, (0.0, 0.0, 1.0))
        pixel = np.asarray(
            cv2.projectPoints(flat.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), self.matrix, self.distortion)[
                0
            ]
        ).reshape(-1, 2)
        inside = (pixel >= 0).all(axis=1) & (pixel[:, 0] <= WIDTH - 1) & (pixel[:, 1] <= HEIGHT - 1)
        return np.asarray(pixel, np.float64), ahead & inside

    def corners_on_ground(self) -> Points:
        """Return where the border of the picture meets the plane of the contacts, (n, 2) in m."""
        columns = np.concatenate(
            (np.linspace(0, WIDTH - 1, 9), np.linspace(0, WIDTH - 1, 9), np.zeros(7), np.full(7, 639.0))
        )
        sides = np.linspace(60, 420, 7)
        rows = np.concatenate((np.zeros(9), np.full(9, HEIGHT - 1.0), sides, sides))
        rays = self.rays(columns, rows)
        return np.asarray(self.position[:2] + rays[:, :2] * (self.position[2] / -rays[:, 2:]), np.float64)

    def as_file(self) -> dict[str, Any]:
        """Return the content of `rig.json`, schema `rear-camera-rig/1`."""
        wheels = self.wheels()
        observed = wheels.pop("rear_left")
        far = -float(self.corners_on_ground()[:, 0].min()) - self.half_length_m
        return {
            "schema": "rear-camera-rig/1",
            "image": {
                "width": WIDTH,
                "height": HEIGHT,
                "fps": self.frames_per_s,
                "format": "jpeg, 8-bit BGR",
            },
            "camera_matrix": self.matrix.tolist(),
            "dist_coeffs": {"model": "opencv_brown_k1k2p1p2k3", "values": self.distortion.tolist()},
            "vehicle_frame": "origin = projection of G on the wheel-contact plane, X forward, "
            "Y left, Z up, metres; angles ccw positive",
            "R_vehicle_camera": self.rotation.tolist(),
            "t_vehicle_camera": self.position.tolist(),
            "wheel": {
                "name": "rear_left",
                "contact_point": [*observed, 0.0],
                "radius_m": self.wheel_radius_m,
                "width_m": self.wheel_width_m,
                "grouser_height_m": self.grouser_m,
                "lug_count": self.lugs,
                "steer_deg": 0.0,
            },
            "other_wheels": [
                {"name": name, "contact_point": [*point, 0.0]} for name, point in wheels.items()
            ],
            "b_m": self.half_length_m,
            "nominal_speed_mps": self.speed_mps,
            "ground_view_m": {"behind_contact": round(far + 0.02, 2), "lateral_about_contact": 0.8},
            "max_slip_angle_deg": 35.0,
        }


def draw_rig(rng: np.random.Generator, speed_mps: float) -> Rig:
    """Return a rig whose camera sees ground behind the rear wheels only, and no part of a wheel."""
    while True:
        focal = rng.uniform(720.0, 800.0)
        centre = (319.5 + rng.normal(0, 5), 239.5 + rng.normal(0, 4))
        matrix = np.asarray(
            ((focal, 0, centre[0]), (0, focal * rng.normal(1.0, 0.002), centre[1]), (0, 0, 1))
        )
        k1 = rng.uniform(-0.23, -0.15)
        distortion = np.asarray((k1, 0.9 * k1 * k1, rng.normal(0, 6e-4), rng.normal(0, 6e-4), 0.0))
        tilt, yaw, roll = np.radians((rng.uniform(19.0, 25.0), rng.normal(0.0, 1.5), rng.normal(0.0, 0.8)))
        level = np.asarray(((0, np.cos(tilt), -np.sin(tilt)), (1, 0, 0), (0, -np.sin(tilt), -np.cos(tilt))))
        about_z = np.asarray(((np.cos(yaw), -np.sin(yaw), 0), (np.sin(yaw), np.cos(yaw), 0), (0, 0, 1)))
        about_axis = np.asarray(
            ((np.cos(roll), -np.sin(roll), 0), (np.sin(roll), np.cos(roll), 0), (0, 0, 1))
        )
        half_length, half_track = rng.uniform(0.30, 0.34), rng.uniform(0.20, 0.24)
        position = np.asarray(
            (
                -half_length - rng.uniform(0.04, 0.08),
                half_track + rng.normal(0.0, 0.025),
                rng.uniform(0.75, 0.9),
            )
        )
        rig = Rig(
            matrix,
            distortion,
            about_z @ level @ about_axis,
            position,
            round(half_length, 3),
            round(half_track, 3),
            round(rng.uniform(0.08, 0.10), 3),
            round(rng.uniform(0.09, 0.125), 3),
            0.01,
            int(rng.integers(20, 29)),
            5.0,
            speed_mps,
        )
        ground = rig.corners_on_ground()
        nearest, farthest = ground[:, 0].max() + half_length, ground[:, 0].min() + half_length
        if nearest < -rig.wheel_radius_m - 0.005 and -0.85 < farthest < -0.6 and ground[:, 1].max() < 1.0:
            return rig


@dataclass(frozen=True)
class Sensor:
    """Exposure, noise and compression.

    `target` is the mean of the linear picture that the automatic exposure aims at (1 is saturation); each
    frame it corrects the share `rate` of the error it saw `delay` frames ago, so that a high rate with a
    delay hunts. `blur_s` is the exposure time. `read` and `shot` give the noise: variance read^2 + shot^2 x
    linear value.
    """

    target: float
    rate: float
    delay: int
    blur_s: float
    read: float
    shot: float
    vignetting: float
    softness_px: float
    jpeg_quality: int
    tint: Points


class Imager:
    """Turns linear light into pictures, frame after frame; exposure and noise have a memory."""

    def __init__(self, rng: np.random.Generator, sensor: Sensor) -> None:
        self._rng = rng
        self._sensor = sensor
        self._log_gain: float | None = None
        self._errors: list[float] = []
        bank = rng.standard_normal((HEIGHT + 160, WIDTH + 160, 3), dtype=np.float32)
        self._bank = image(0.8 * bank + 0.6 * cv2.GaussianBlur(bank, (0, 0), 0.8) / 0.35)
        column, row = np.meshgrid(np.linspace(-1, 1, WIDTH), np.linspace(-0.75, 0.75, HEIGHT))
        self._vignette = image(
            (1.0 - sensor.vignetting * (column**2 + row**2) / 1.56)[..., None] * sensor.tint
        )
        linear = np.arange(4096) / 4095.0
        curve = np.where(
            linear < 0.0031, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
        )
        self._curve = np.round(255.0 * curve).astype(np.uint8)

    def expose(self, light: Image, smear_px: Points) -> Bytes:
        """Return the 8-bit picture before compression; `smear_px` is (columns, rows) of motion blur."""
        sensor = self._sensor
        mean = float(light[::8, ::8].mean())
        if self._log_gain is None:
            self._log_gain = float(np.log(sensor.target / mean))
        gain = float(np.exp(self._log_gain))
        picture = _smear(light, smear_px)
        if sensor.softness_px > 0.2:
            picture = image(cv2.GaussianBlur(picture, (0, 0), sensor.softness_px))
        picture = picture * (self._vignette * np.float32(gain))
        top, left = self._rng.integers(0, 160, 2)
        noise = self._bank[top : top + HEIGHT, left : left + WIDTH]
        if self._rng.uniform() < 0.5:
            noise = noise[::-1]
        np.minimum(picture, 1.6, out=picture)
        picture += noise * np.sqrt(np.float32(sensor.read**2) + np.float32(sensor.shot**2) * picture)
        self._errors.append(
            float(np.log(sensor.target / max(float(np.clip(picture[::8, ::8], 0, 1).mean()), 1e-3)))
        )
        if len(self._errors) > sensor.delay:
            self._log_gain += sensor.rate * self._errors[-1 - sensor.delay]
        index = np.clip(picture * np.float32(4095.0), 0, 4095).astype(np.uint16)
        return np.asarray(self._curve[index], np.uint8)

    def compress(self, picture: Bytes) -> bytes:
        """Return the JPEG file of a picture."""
        return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, self._sensor.jpeg_quality])[1])


def _smear(light: Image, smear_px: Points) -> Image:
    length = float(np.hypot(*smear_px))
    if length < 0.7:
        return light
    size = 2 * int(np.ceil(0.5 * length)) + 1
    kernel = np.zeros((size, size), np.float32)
    middle = 0.5 * (size - 1)
    for part in np.linspace(-0.5, 0.5, 8 * size):
        column, row = middle + part * smear_px[0], middle + part * smear_px[1]
        kernel[round(float(np.clip(row, 0, size - 1))), round(float(np.clip(column, 0, size - 1)))] += 1.0
    return image(cv2.filter2D(light, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE))
