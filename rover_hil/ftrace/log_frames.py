"""Frames of a rear camera in a log of a run, with the telemetry of each."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from controllers.ground_motion.rig import RigFile
from controllers.motion.kinematics import make_kinematics
from drivers.camera.settings import CameraSettings
from drivers.errors import LogError
from rover_hil.config import Config
from rover_hil.drives.arrays import Array, Times
from rover_hil.drives.channels import Channels
from rover_hil.drives.drive import Drive, picture_time_ns
from rover_hil.ftrace.frames import FrameFile
from rover_hil.ftrace.telemetry import TelemetryRow
from rover_hil.recording.images import decode_image

SPEED_WINDOW_S = 0.1
"""The wheel speed at a frame is the mean over this time before it."""
RATES = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")


class LogFrames:
    """The frames of the camera in `roles.camera`, or of the only camera, in the order of the log.

    Frames count from 0. One that is not newer than the frame before it is left out, as in the run itself.

    Args:
        path: A log.

    Attributes:
        count: Number of frames.
        rig: Calibration of the camera in the log's configuration; None without one.
        ground: How the motion over the ground is measured; None without [ground_motion].
        skids_in_rotations: Whether fixed wheels of the rover must slip sideways in every rotation.
        telemetry: What was measured at each frame, by its number; times are in s since the start of the log.

    Raises:
        LogError: The log cannot be read, or holds no frames.
    """

    def __init__(self, path: Path) -> None:
        self._drive = Drive(path)
        config = self._drive.config
        self._camera = _camera_of(config, path)
        frames_ns: list[int] = []
        self._numbers: list[int | None] = []
        for message in self._drive.read().raw(self._camera):
            t_ns = picture_time_ns(message)
            is_newer = not frames_ns or t_ns > frames_ns[-1]
            self._numbers.append(len(frames_ns) if is_newer else None)
            if is_newer:
                frames_ns.append(t_ns)
        if not frames_ns:
            raise LogError(_no_frames(path))
        self.count = len(frames_ns)
        self.ground = config.ground_motion
        self.skids_in_rotations = make_kinematics(config.rover).skids_in_rotations
        rig = None if config.ground_motion is None else config.ground_motion.rig
        self.rig: RigFile | None = rig if config.scomp is None else config.scomp.rig
        self.telemetry = self._telemetry(np.array(frames_ns, np.int64))

    def __iter__(self) -> Iterator[FrameFile]:
        """Yield the frames.

        Raises:
            LogError: One of them cannot be decoded.
        """
        numbers = iter(self._numbers)
        for message in self._drive.raw(self._camera):
            number = next(numbers)
            if number is not None:
                yield FrameFile(number, decode_image(message.data).image)

    def _telemetry(self, t_ns: Times) -> dict[int, TelemetryRow]:
        t_s, rows = self._drive.seconds(t_ns), self._drive.channels
        speeds_m_s = _wheel_speeds_m_s(self._drive.config.rover.wheel_radius_m, rows, t_ns)
        rates = [_newest(rows, name, t_ns) for name in RATES]
        rows_by_stamp: dict[int, TelemetryRow] = {}
        for number, (time_s, speed_m_s, x, y, z) in enumerate(
            zip(t_s.tolist(), speeds_m_s.tolist(), *(rate.tolist() for rate in rates), strict=True)
        ):
            known_rates = (x, y, z) if np.isfinite(x + y + z) else None
            rows_by_stamp[number] = TelemetryRow(
                time_s, speed_m_s if np.isfinite(speed_m_s) else None, known_rates
            )
        return rows_by_stamp


def _camera_of(config: Config, path: Path) -> str:
    cameras = [name for name, device in config.devices.items() if isinstance(device, CameraSettings)]
    if config.roles.camera is not None:
        return config.roles.camera
    if len(cameras) != 1:
        raise LogError(_no_frames(path))
    return cameras[0]


def _no_frames(path: Path) -> str:
    return (
        f"log {path} holds no frames of a rear camera: give the log of a rover with roles.camera, a folder "
        "of pictures, or a video"
    )


def _wheel_speeds_m_s(radius_m: float, rows: Channels, t_ns: Times) -> Array:
    """Return the mean speed of the rims before each time; NaN where it is not known."""
    window_ns = SPEED_WINDOW_S * 1e9
    turned = []
    for name in rows.names():
        if name.startswith("position"):
            readings = rows[name]
            order = np.argsort(readings.t_ns, kind="stable")
            times, angles = readings.t_ns[order], readings.value[order]
            now, before = (np.interp(t, times, angles, left=np.nan) for t in (t_ns, t_ns - window_ns))
            turned.append(now - before)
    if not turned:
        return np.full(len(t_ns), np.nan)
    speeds: Array = radius_m * np.mean(turned, axis=0) / SPEED_WINDOW_S
    return speeds


def _newest(rows: Channels, name: str, t_ns: Times) -> Array:
    """Return the newest reading at each time; NaN before the first."""
    readings = rows[name]
    order = np.argsort(readings.t_ns, kind="stable")
    place = np.searchsorted(readings.t_ns[order], t_ns, side="right") - 1
    values = np.append(readings.value[order], np.nan)
    newest: Array = values[place]
    return newest
