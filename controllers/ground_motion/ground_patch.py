"""Rig calibration, and the rectified ground: a view from straight above.

Ground coordinates here are the vehicle frame of the rig: origin at the projection of the centre of mass on
the wheel-contact plane, x forward, y left, z up, metres. The ground is taken as the plane z = 0.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ground_motion.rig import LEAST_LOOK_DOWN, RigGeometry
from drivers.errors import ConfigError
from drivers.samples import Image

Floats = NDArray[np.float64]
Patch = NDArray[np.float32]
Mask = NDArray[np.bool_]

RESOLUTION_M = 0.004
"""Size of a pixel of the rectified ground behind a wheel; 25 of them are the width of a 10 cm wheel."""
VIEW_PIXELS = 35_000
"""Most pixels of the rectified ground of a camera that watches no wheel: as many as behind a wheel."""
LEAST_PIXEL = 0.7
"""Least size of a pixel of the rectified ground, over what the camera's own covers along its ray."""
MOST_BEHIND_M, MOST_LATERAL_M = 0.8, 0.4
"""Ground further away than this from the contact adds time, not accuracy."""
LEAST_VISIBLE = 0.25
"""Least share of the ground view that the image must show."""
ORTHONORMAL_TOLERANCE = 1e-3


class GroundPatch:
    """Rectified ground behind the wheel, in the wheel's axes; without a wheel all ground in view.

    Row i is `(i + 0.5) * pixel_m` behind the contact along the wheel's axis; column j lies
    `(j - centre) * pixel_m` to the left of it. Without a wheel the front end of the view is the contact.

    Args:
        rig: The calibration.

    Attributes:
        shape: Rows and columns.
        pixel_m: Size of a pixel; `RESOLUTION_M` with a wheel.
        is_coarse: The camera's own pixels limit the size: its rays are flat.
        centre: Column of the contact.
        visible: Pixels that the camera sees and the wheel does not hide.

    Raises:
        ConfigError: The camera does not see the ground behind the wheel: not a rotation, above the horizon,
            turned away.
    """

    def __init__(self, rig: RigGeometry) -> None:
        self.rig = rig
        _require_rotation(rig.rotation)
        length_m, half_m = rig.behind_m, rig.lateral_m
        if rig.watches_wheel:
            reach = rig.behind_m * np.tan(rig.max_slip_rad) + 2.0 * rig.wheel_width_m
            length_m, half_m = min(length_m, MOST_BEHIND_M), min(half_m, reach, MOST_LATERAL_M)
            self.pixel_m, self.is_coarse = RESOLUTION_M, False
        else:
            if min(length_m, half_m) <= 0.0:
                raise ConfigError(
                    "the rig's camera sees no ground: "
                    "check R_vehicle_camera (camera to vehicle) and t_vehicle_camera"
                )
            fine_m = float(np.sqrt(2 * half_m * length_m / VIEW_PIXELS))
            coarse_m = self._ray_pixel_m()
            self.pixel_m, self.is_coarse = max(fine_m, coarse_m), coarse_m > fine_m
        half = round(half_m / self.pixel_m)
        self.shape = (round(length_m / self.pixel_m), 2 * half + 1)
        self.centre = half
        rows, columns = np.indices(self.shape)
        back = np.asarray((rows + 0.5) * self.pixel_m, np.float64)
        left = np.asarray((columns - half) * self.pixel_m, np.float64)
        pixels, ahead = project(rig, self.to_vehicle(back, left).reshape(-1, 3))
        self._halved = _ground_pixel_m(pixels.reshape(*self.shape, 2), self.pixel_m) < 0.7 * self.pixel_m
        inside = (pixels > 1).all(1) & (pixels < (rig.width - 2, rig.height - 2)).all(1) & ahead
        self.visible: Mask = inside.reshape(self.shape) & ~self._wheel_shadow()
        if self.visible.mean() < LEAST_VISIBLE:
            raise ConfigError(
                f"the rig's camera sees {100 * self.visible.mean():.0f} % of the ground to use "
                "(at least 25 % needed): check R_vehicle_camera (camera to vehicle), "
                "t_vehicle_camera and contact_point"
            )
        source = (pixels - 0.5) / 2 if self._halved else pixels
        grid = np.where(ahead[:, None], source, -1e4).reshape(*self.shape, 2).astype(np.float32)
        self._maps = cv2.convertMaps(grid, np.empty(0, np.float32), cv2.CV_16SC2)

    def _ray_pixel_m(self) -> float:
        """Return `LEAST_PIXEL` of what a pixel of the camera covers along its ray, mid-view."""
        rig = self.rig
        middle = rig.contact_m - np.array([rig.behind_m / 2, 0.0, 0.0])
        square = float(((middle - rig.position_m) ** 2).sum())
        return LEAST_PIXEL * square / float(rig.position_m[2] * rig.camera_matrix[1, 1])

    def rectify(self, image: Image) -> Image:
        """Return the ground as grey pixels, 0 where the camera does not see it.

        Args:
            image: Grey frame of the rig's size.
        """
        if self._halved:
            image = np.asarray(
                cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8
            )
        patch = cv2.remap(image, self._maps[0], self._maps[1], cv2.INTER_LINEAR)
        return np.asarray(patch, np.uint8)

    def to_vehicle(self, back_m: Floats, left_m: Floats) -> Floats:
        """Return points of the ground (last axis x, y, z) that far behind and left of the contact."""
        cos, sin = np.cos(self.rig.steer_rad), np.sin(self.rig.steer_rad)
        x = self.rig.contact_m[0] - cos * back_m - sin * left_m
        y = self.rig.contact_m[1] - sin * back_m + cos * left_m
        return np.stack([x, y, np.zeros_like(x)], axis=-1)

    def to_patch(self, points: Floats) -> Floats:
        """Return (back, left) in metres of points in the vehicle frame (x, y, ...)."""
        cos, sin = np.cos(self.rig.steer_rad), np.sin(self.rig.steer_rad)
        dx, dy = points[:, 0] - self.rig.contact_m[0], points[:, 1] - self.rig.contact_m[1]
        return np.stack([-cos * dx - sin * dy, -sin * dx + cos * dy], axis=1)

    def _wheel_shadow(self) -> Mask:
        """Return what the wheel, a cylinder standing on the contact, hides from the camera."""
        rig = self.rig
        mask = np.zeros(self.shape, np.uint8)
        if not rig.watches_wheel:
            return mask > 0
        angle = np.linspace(0, 2 * np.pi, 36, endpoint=False)
        back, up = rig.wheel_radius_m * np.cos(angle), rig.wheel_radius_m * (1 + np.sin(angle))
        rim = []
        for side in (-0.5, 0.5):
            points = self.to_vehicle(back, np.full_like(back, side * rig.wheel_width_m))
            points[:, 2] = up
            rim.append(points)
        ray = np.concatenate(rim) - rig.position_m
        below = ray[:, 2] < -LEAST_LOOK_DOWN * np.linalg.norm(ray, axis=1)
        if below.all():
            ground = rig.position_m - ray * (rig.position_m[2] / ray[:, 2])[:, None]
            local = self.to_patch(ground) / self.pixel_m
            outline = np.stack([local[:, 1] + self.centre, local[:, 0] - 0.5], axis=1)
            cv2.fillConvexPoly(mask, cv2.convexHull(np.round(outline).astype(np.int32)), 1)
        return mask > 0


def project(rig: RigGeometry, points: Floats) -> tuple[Floats, Mask]:
    """Return pixels of points in the vehicle frame (n x 3), and which of them the camera has ahead of it.

    Points further from the optical axis than the distortion model bends back are not ahead.
    """
    local = (points - rig.position_m) @ rig.rotation
    ahead = local[:, 2] > LEAST_LOOK_DOWN
    safe = np.where(ahead[:, None], local, (0.0, 0.0, 1.0))
    projected, _ = cv2.projectPoints(safe, np.zeros(3), np.zeros(3), rig.camera_matrix, rig.distortion)
    pixels = np.asarray(projected, np.float64).reshape(-1, 2)
    plain = safe[:, :2] / safe[:, 2:]
    focal = (rig.camera_matrix[0, 0], rig.camera_matrix[1, 1])
    middle = (rig.camera_matrix[0, 2], rig.camera_matrix[1, 2])
    undistorted = plain * focal + middle
    near = np.linalg.norm(pixels - undistorted, axis=1) < 0.5 * max(rig.width, rig.height)
    return pixels, np.asarray(ahead & near, np.bool_)


def _ground_pixel_m(pixels: Floats, pixel_m: float) -> float:
    """Return the median size of an image pixel on the ground."""
    step = np.linalg.norm(np.diff(pixels, axis=1), axis=2)
    return float(pixel_m / max(np.median(step), 1e-6))


def _require_rotation(rotation: Floats) -> None:
    error = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if error > ORTHONORMAL_TOLERANCE or np.linalg.det(rotation) < 0:
        raise ConfigError(
            "R_vehicle_camera is not a rotation: its rows must be orthonormal and its determinant +1"
        )
