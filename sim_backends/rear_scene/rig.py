"""Geometry of the rear camera: pose, lens and wheels."""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from sim_backends.arrays import Array

CLOSEST_DEPTH_M = 0.02


@dataclass(frozen=True, kw_only=True)
class Wheel:
    """A wheel and its contact point.

    Attributes:
        x_m: Forward of the vehicle's origin.
        y_m: To the left of it.
        radius_m: Radius of the rim, without the grousers.
    """

    name: str
    x_m: float
    y_m: float
    radius_m: float = 0.092
    width_m: float = 0.11
    grouser_height_m: float = 0.01
    lug_count: int = 18
    steer_deg: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Rig:
    """A calibrated rear camera on a four-wheeled rover; points in m in the vehicle frame.

    Attributes:
        camera_matrix: 3 x 3, pixels.
        distortion: k1, k2, p1, p2, k3 as OpenCV defines them.
        vehicle_from_camera: Rotation; its columns are the camera's right, down and forward.
        camera_m: Position of the lens.
        wheel: The wheel whose trace is in view.
        other_wheels: The other wheels; they also leave traces.
        leaves_traces: Whether the wheels leave traces and the watched one is drawn; otherwise it is only a
            point on the ground.
    """

    width: int
    height: int
    fps: float
    camera_matrix: Array
    distortion: Array
    vehicle_from_camera: Array
    camera_m: Array
    wheel: Wheel
    other_wheels: tuple[Wheel, ...]
    leaves_traces: bool = True

    @property
    def wheels(self) -> tuple[Wheel, ...]:
        """Every wheel that leaves a trace, the watched one last: its trace covers that of one ahead."""
        return (*self.other_wheels, self.wheel) if self.leaves_traces else ()

    def project(self, points_m: Array) -> Array:
        """Return (column, row) of points of the vehicle frame, shape (n, 3); NaN out of view."""
        in_camera = (points_m - self.camera_m) @ self.vehicle_from_camera
        image = self._pixels(in_camera)
        outside = np.linalg.norm(in_camera[:, :2], axis=1) > self._widest_ray * in_camera[:, 2]
        image[outside | (in_camera[:, 2] < CLOSEST_DEPTH_M)] = np.nan
        return image

    def rays(self) -> Array:
        """Return the direction through every pixel in the camera frame as (x / z, y / z), shape (h, w, 2)."""
        columns, rows = np.meshgrid(np.arange(self.width, dtype=float), np.arange(self.height, dtype=float))
        pixels = np.stack([columns.ravel(), rows.ravel()], axis=1)
        return self._unproject(pixels).reshape(self.height, self.width, 2)

    def _unproject(self, pixels: Array) -> Array:
        # The default stops after five steps, with errors of tenths of a pixel in the corners.
        enough = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-6)
        rays = cv2.undistortPoints(pixels[:, None, :], self.camera_matrix, self.distortion, criteria=enough)
        return np.asarray(rays, np.float64)[:, 0, :]

    def wheel_outline(self, body_to_vehicle: Array) -> Array | None:
        """Return the watched wheel's outline in the image, (column, row); None when it is not in view.

        `body_to_vehicle` rotates points of the body, to which the camera is fixed, into the vehicle frame.
        """
        if not self.leaves_traces:
            return None
        angles = np.linspace(0, 2 * np.pi, 36, endpoint=False)
        radius = self.wheel.radius_m + self.wheel.grouser_height_m
        forward = self.wheel.x_m + radius * np.cos(angles)
        up = self.wheel.radius_m + radius * np.sin(angles)
        left, right = (np.full(36, self.wheel.y_m + side * self.wheel.width_m) for side in (0.5, -0.5))
        rims = np.concatenate([np.stack([forward, y, up], axis=1) for y in (left, right)])
        in_camera = (rims @ body_to_vehicle - self.camera_m) @ self.vehicle_from_camera
        in_camera = in_camera[in_camera[:, 2] > CLOSEST_DEPTH_M]
        if len(in_camera) == 0:
            return None
        rays = in_camera[:, :2] / in_camera[:, 2:]
        # The lens polynomial is valid only in and near the image: limit rays that lie farther out.
        rays *= np.minimum(1.0, self._widest_ray / np.linalg.norm(rays, axis=1, keepdims=True))
        hull = cv2.convexHull(self._pixels(np.insert(rays, 2, 1.0, axis=1)).astype(np.float32))
        return np.asarray(hull, np.float64)[:, 0, :]

    @cached_property
    def _widest_ray(self) -> float:
        """Return a radius x / z, y / z a little beyond the corners of the image."""
        right, bottom = self.width - 1.0, self.height - 1.0
        return float(
            1.1
            * np.linalg.norm(
                self._unproject(np.array([[0, 0], [right, 0], [0, bottom], [right, bottom]])), axis=1
            ).max()
        )

    def _pixels(self, in_camera: Array) -> Array:
        zero = np.zeros(3)
        pixels, _ = cv2.projectPoints(in_camera[:, None, :], zero, zero, self.camera_matrix, self.distortion)
        return np.asarray(pixels, np.float64)[:, 0, :]


def looking_back(tilt_deg: float, pan_deg: float = 0.0, bank_deg: float = 0.0) -> Array:
    """Return vehicle_from_camera of a camera that looks backwards and down.

    Args:
        tilt_deg: Angle of the optical axis below the horizontal.
        pan_deg: Angle of the optical axis about the vertical, counter-clockwise from straight back.
        bank_deg: Angle of the image about the optical axis.
    """
    tilt, pan, bank = map(math.radians, (tilt_deg, pan_deg, bank_deg))
    # Looking back, the vehicle's left is the image's right.
    right, forward = np.array([0.0, 1.0, 0.0]), np.array([-math.cos(tilt), 0.0, -math.sin(tilt)])
    level = np.stack([right, np.cross(forward, right), forward], axis=1)
    about_z = np.array([[math.cos(pan), -math.sin(pan), 0], [math.sin(pan), math.cos(pan), 0], [0, 0, 1]])
    about_axis = np.array(
        [[math.cos(bank), -math.sin(bank), 0], [math.sin(bank), math.cos(bank), 0], [0, 0, 1]]
    )
    return np.asarray(about_z @ level @ about_axis)
