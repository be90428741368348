"""A pinhole camera upon a vehicle: the ray of every pixel, and the pixel of every point."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.nature.ambiguous_ground.picture import Numbers

WIDTH, HEIGHT = 320, 240
WHEEL_CONTACT = (-0.325, 0.225)
"""Where the watched wheel touches the ground, in the vehicle frame (X forward, Y left), m."""


def rotation_about_z(angle: float) -> Numbers:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Camera:
    """A camera that looks backward and down.

    Attributes:
        focal: focal length, px.
        centre: principal point, px.
        distortion: k1 and k2 of OpenCV's model; its other coefficients are 0.
        depression_deg: how far the optical axis points below the horizon.
        yaw_deg: turn of the camera about the vehicle's vertical axis, 0 looks straight back.
        roll_deg: turn about the optical axis.
        position: place of the camera in the vehicle frame, m.
    """

    focal: float
    centre: tuple[float, float]
    distortion: tuple[float, float]
    depression_deg: float
    yaw_deg: float
    roll_deg: float
    position: tuple[float, float, float]

    @property
    def rotation(self) -> Numbers:
        """Turns axes of the camera (x right, y down, z ahead) into those of the vehicle."""
        d = np.radians(self.depression_deg)
        back = np.array([[0.0, np.sin(d), -np.cos(d)], [1.0, 0.0, 0.0], [0.0, -np.cos(d), -np.sin(d)]])
        turned: Numbers = rotation_about_z(np.radians(self.yaw_deg)) @ back
        rolled: Numbers = turned @ rotation_about_z(np.radians(self.roll_deg))
        return rolled

    def project(self, points: Numbers) -> Numbers:
        """Pixels of points (N, 3) given in the vehicle frame."""
        seen = (points - np.array(self.position)) @ self.rotation
        xy = seen[:, :2] / seen[:, 2:]
        r2 = (xy**2).sum(axis=1, keepdims=True)
        bent = xy * (1.0 + self.distortion[0] * r2 + self.distortion[1] * r2**2)
        pixels: Numbers = bent * self.focal + np.array(self.centre)
        return pixels

    def rays(self, u: Numbers, v: Numbers) -> Numbers:
        """Directions (..., 3) in the vehicle frame in which pixels look."""
        bent = np.stack([(u - self.centre[0]) / self.focal, (v - self.centre[1]) / self.focal], axis=-1)
        straight = bent
        for _ in range(12):
            r2 = (straight**2).sum(axis=-1, keepdims=True)
            straight = bent / (1.0 + self.distortion[0] * r2 + self.distortion[1] * r2**2)
        ahead = np.concatenate([straight, np.ones((*straight.shape[:-1], 1))], axis=-1)
        directions: Numbers = ahead @ self.rotation.T
        return directions

    def on_plane(self, u: Numbers, v: Numbers, height: float = 0.0) -> Numbers:
        """Points (..., 2) at which pixels see the horizontal plane of this height."""
        rays = self.rays(u, v)
        if rays[..., 2].max() > -0.05:
            raise ValueError("the camera sees the horizon")
        far = (height - self.position[2]) / rays[..., 2:]
        points: Numbers = np.array(self.position[:2]) + rays[..., :2] * far
        return points

    def metres_per_pixel(self) -> float:
        """Width on the ground of the pixel in the middle of the picture, across the view."""
        u = np.array([WIDTH / 2, WIDTH / 2 + 1.0])
        ends = self.on_plane(u, np.full(2, HEIGHT / 2))
        return float(np.hypot(*(ends[1] - ends[0])))

    def rig(self, fps: float, speed: float) -> dict[str, Any]:
        """The rig file that describes this camera."""
        top = self.on_plane(np.array([WIDTH / 2]), np.array([0.0]))[0]
        sides = self.on_plane(np.array([0.0, WIDTH - 1.0]), np.array([HEIGHT / 2, HEIGHT / 2]))
        half = 0.5 * float(np.hypot(*(sides[1] - sides[0])))
        (x, y), (u, v) = WHEEL_CONTACT, self.centre
        others = {"front_left": (-x, y), "front_right": (-x, -y), "rear_right": (x, -y)}
        return {
            "schema": "rear-camera-rig/1",
            "image": {"width": WIDTH, "height": HEIGHT, "fps": fps, "format": "png, 8-bit grey"},
            "camera_matrix": [[self.focal, 0.0, u], [0.0, self.focal, v], [0.0, 0.0, 1.0]],
            "dist_coeffs": {
                "model": "opencv_brown_k1k2p1p2k3",
                "values": [*self.distortion, 0.0, 0.0, 0.0],
            },
            "vehicle_frame": "origin = projection of G on the wheel-contact plane, "
            "X forward, Y left, Z up, metres; angles ccw positive",
            "R_vehicle_camera": self.rotation.tolist(),
            "t_vehicle_camera": list(self.position),
            "wheel": {
                "name": "rear_left",
                "contact_point": [x, y, 0.0],
                "radius_m": 0.092,
                "width_m": 0.11,
                "grouser_height_m": 0.01,
                "lug_count": 24,
                "steer_deg": 0.0,
            },
            "other_wheels": [{"name": n, "contact_point": [*p, 0.0]} for n, p in others.items()],
            "b_m": -x,
            "nominal_speed_mps": round(speed, 4),
            "ground_view_m": {
                "behind_contact": round(min(max(float(x - top[0]), 0.2), 1.0), 2),
                "lateral_about_contact": round(min(half, 0.8), 2),
            },
            "max_slip_angle_deg": 35.0,
        }
