"""From an image of the marker to the pose of the rover on the floor.

Not detectable: a calibration of another camera position, a wrong mounting of the marker, a rover that tilts,
and a marker of the same number on another object of the same size.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from drivers.angles import wrap_rad
from drivers.camera.codec import CameraCodec
from drivers.clock import nanoseconds
from drivers.driver import Rejection
from drivers.errors import ConfigError
from drivers.heading_calibration import load_calibration
from drivers.link import CameraImage, Received
from drivers.overhead_camera.floor import Floor, FloorCalibration
from drivers.overhead_camera.markers import Corners, MarkerFinder
from drivers.overhead_camera.parameters import OverheadCameraParameters
from drivers.samples import FrameSample, Image, PoseFixSample

SQUARE = np.array([-1 + 1j, 1 + 1j, 1 - 1j, -1 - 1j])
"""A marker's corners in its own frame, x along the upper edge, for a side of two."""

# Chosen on rendered images so that accepted yaws have errors below half a degree.
SIZE_TOLERANCE = 0.1
SHAPE_TOLERANCE = 0.025
LEAST_MATCH = 0.9
LEAST_CELL_PX = 5.0
IDEAL_CELL_PX = 4


class OverheadCameraCodec:
    """Finds the rover's marker in each image.

    An image that is not a frame is rejected as by `CameraCodec`. Otherwise it is rejected when the marker is
    not in it ("no_marker"), is in it more than once ("ambiguous"), has less than 5 pixels per cell
    ("marker_small"), is not sharp ("blurred"), differs from its true size by more than 10 % ("marker_size")
    or from a square by more than 2.5 % ("marker_shape").

    Args:
        name: Name of the device.
        settings: Marker, mounting, calibration and noise.

    Raises:
        ConfigError: The calibration is missing or wrong, or does not fit the frames or the marker.
    """

    def __init__(self, name: str, settings: OverheadCameraParameters) -> None:
        self._name = name
        self._settings = settings
        self._frames = CameraCodec(name, settings.width, settings.height)
        self._finder = MarkerFinder(settings.dictionary)
        self._floor = _load_floor(name, settings)
        if settings.marker_id >= self._finder.marker_count:
            raise ConfigError(
                f"devices.{name}.marker_id: {settings.dictionary} has markers 0 to "
                f"{self._finder.marker_count - 1}: correct the number or the dictionary"
            )
        self._ideal = self._finder.draw(settings.marker_id, IDEAL_CELL_PX)
        self._cells = len(self._ideal) / IDEAL_CELL_PX
        self._mount_m = complex(settings.marker_x_m, settings.marker_y_m)
        self._mount_yaw_rad = math.radians(settings.marker_yaw_deg)

    def decode(self, item: Received[CameraImage]) -> Sequence[PoseFixSample | Rejection]:
        """Return the pose, or the reason for a rejection."""
        (frame,) = self._frames.decode(item)
        if isinstance(frame, Rejection):
            return (frame,)
        markers = self._finder.find(frame.image)
        corner_sets = [
            marker.corners_px for marker in markers if marker.marker_id == self._settings.marker_id
        ]
        if len(corner_sets) != 1:
            return (Rejection("ambiguous" if corner_sets else "no_marker"),)
        if _side_px(corner_sets[0]) < LEAST_CELL_PX * self._cells:
            return (Rejection("marker_small"),)
        if self._match(frame.image, corner_sets[0]) < LEAST_MATCH:
            return (Rejection("blurred"),)
        return (self._locate(frame, corner_sets[0]),)

    def reset(self) -> None:
        """Forget the newest stamp."""
        self._frames.reset()

    def _match(self, image: Image, corners_px: Corners) -> float:
        """Return the correlation of the marker in the image with an ideal one."""
        side = len(self._ideal)
        # Pixels are centred on whole numbers, so the image's edge is half a pixel outside.
        ideal_px = 0.5 * side * np.column_stack((1 + SQUARE.real, 1 - SQUARE.imag)) - 0.5
        to_ideal = cv2.getPerspectiveTransform(corners_px.astype(np.float32), ideal_px.astype(np.float32))
        seen = cv2.warpPerspective(image, to_ideal, (side, side))
        grey = cv2.cvtColor(seen, cv2.COLOR_BGR2GRAY) if seen.ndim == 3 else seen
        return float(cv2.matchTemplate(np.asarray(grey, np.uint8), self._ideal, cv2.TM_CCOEFF_NORMED)[0, 0])

    def _locate(self, frame: FrameSample, corners_px: Corners) -> PoseFixSample | Rejection:
        settings = self._settings
        points_m = self._floor.locate(corners_px, settings.marker_height_m)
        corners_m = points_m[:, 0] + 1j * points_m[:, 1]
        ideal_m = 0.5 * settings.marker_size_m * SQUARE
        centre_m = corners_m.mean()
        # Least squares of a turned and scaled square: its angle is the marker's, its length should be 1.
        turn = np.vdot(ideal_m, corners_m - centre_m) / np.vdot(ideal_m, ideal_m)
        if not abs(abs(turn) - 1.0) <= SIZE_TOLERANCE:
            return Rejection("marker_size")
        misshape_m = np.abs(corners_m - centre_m - turn * ideal_m).max()
        if not misshape_m <= SHAPE_TOLERANCE * settings.marker_size_m:
            return Rejection("marker_shape")
        yaw_rad = float(np.angle(turn)) - self._mount_yaw_rad
        origin_m = complex(centre_m) - self._mount_m * complex(math.cos(yaw_rad), math.sin(yaw_rad))
        corner_std_m = settings.corner_noise_px * settings.marker_size_m / _side_px(corners_px)
        # Of the mean of four corners, and of the angle of four arms half a diagonal long.
        yaw_std_rad = math.hypot(
            corner_std_m / (math.sqrt(2.0) * settings.marker_size_m), math.radians(settings.yaw_noise_deg)
        )
        position_std_m = math.hypot(
            0.5 * corner_std_m, settings.position_noise_m, abs(self._mount_m) * yaw_std_rad
        )
        t_capture_ns = frame.t_capture_ns
        return PoseFixSample(
            device=self._name,
            t_ns=frame.t_ns,
            x_m=origin_m.real,
            y_m=origin_m.imag,
            yaw_rad=wrap_rad(yaw_rad),
            position_std_m=position_std_m,
            yaw_std_rad=yaw_std_rad,
            t_capture_ns=frame.t_ns - nanoseconds(settings.latency_s)
            if t_capture_ns is None
            else min(t_capture_ns, frame.t_ns),
        )


def _side_px(corners_px: Corners) -> float:
    return float(np.linalg.norm(corners_px - np.roll(corners_px, 1, axis=0), axis=1).mean())


def _load_floor(name: str, settings: OverheadCameraParameters) -> Floor:
    calibration = load_calibration(settings.calibration_file, FloorCalibration)
    if (calibration.width, calibration.height) != (settings.width, settings.height):
        raise ConfigError(
            f"devices.{name}.calibration: {settings.calibration} is for images of {calibration.width} x "
            f"{calibration.height} pixels, not {settings.width} x {settings.height}: calibrate anew"
        )
    floor = Floor(calibration)
    camera_m = floor.camera_m
    if settings.marker_height_m > 0.0 and (camera_m is None or camera_m[2] <= settings.marker_height_m):
        raise ConfigError(
            f"devices.{name}.calibration: {settings.calibration} must place the camera above the "
            f"marker's height of {settings.marker_height_m:g} m: add or correct camera_m"
        )
    return floor
