"""Read a drive, and its true path, from one of our own logs."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from controllers.motion.rover_geometry import has_four_wheels, track_of
from controllers.slip.scomp.parameters import RoverGeometry
from drivers.errors import LogError
from rover_hil.config import Config
from rover_hil.drives.arrays import Array, Flags
from rover_hil.drives.drive import Drive
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.scomp.drive import TruePath

NAMES = ("position_rad", "heading_rad", "gyro_z_rad_s", "pitch_rad", "roll_rad", "trace_rad", "steering_rad")
STANDSTILL_RAD = 0.02


def log_columns(drive: Drive) -> tuple[dict[str, Array], RoverGeometry]:
    """Return a log as columns in the units of the CSV files, a row per position of the first wheel.

    The heading is that of the first heading device, the rate that of the gyro. Raised nose and left side are
    positive. The trace angles are those that the run found in its frames, the steering angle is the mean of
    the wheels.

    Raises:
        LogError: The log is of another kind of rover, or lacks wheel positions.
    """
    path, rover = drive.log.path, geometry_of(drive.config, drive.log.path)
    if len(drive.channels["position1_rad"]) < 2:
        raise LogError(f"log {path} holds no positions of the first wheel: give the log of a drive")
    return drive.table(NAMES), rover


def geometry_of(config: Config, path: Path) -> RoverGeometry:
    """Return the rover of a log.

    Raises:
        LogError: It has no four wheels.
    """
    rover = config.rover
    if not has_four_wheels(rover):
        raise LogError(
            f"{path} is of a rover of the kind {rover.kinematics}: sComp needs four wheels: front left, "
            "front right, rear left, rear right"
        )
    return RoverGeometry(wheel_radius_m=rover.wheel_radius_m, track_m=track_of(rover))


def log_truth(drive: Drive) -> tuple[TruePath, str]:
    """Return the true path in a log, and in words what measured it.

    Pose fixes are on the floor of their camera; they are turned into the frame of the pose at start, the mean
    of those before the first wheel turns, or the first one.

    Raises:
        LogError: There is no true path, or its times do not rise.
    """
    true = drive.true_poses()
    t_s, x_m, y_m, yaw_rad = drive.seconds(true.t_ns), true.x_m, true.y_m, true.yaw_rad
    if len(t_s) < 2 or not (np.diff(t_s) > 0.0).all():
        raise LogError(
            f"log {drive.log.path}: the times of its {true.source} do not rise, or there are too few"
        )
    if true.is_exact:
        return TruePath(t_s=t_s, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad), true.source
    at_start = _at_start(drive, true)
    moved_m, start_rad = _from_start_m(true, at_start)
    path = TruePath(t_s=t_s, x_m=moved_m.real, y_m=moved_m.imag, yaw_rad=yaw_rad - start_rad)
    return path, true.source


def _at_start(drive: Drive, poses: TruePoses) -> Flags:
    """Return which poses are from before the first wheel turns; the first one in any case."""
    wheel = drive.channels["position1_rad"]
    turned = np.abs(wheel.value - wheel.value[0]) > STANDSTILL_RAD
    at_start: Flags = poses.t_ns < (wheel.t_ns[np.argmax(turned)] if turned.any() else wheel.t_ns[-1])
    at_start[0] = True
    return at_start


def _from_start_m(poses: TruePoses, at_start: Flags) -> tuple[NDArray[np.complex128], float]:
    """Return positions in the frame of the pose at start, x as real part, and the yaw at start."""
    x_m, y_m = poses.x_m, poses.y_m
    start_rad = float(poses.yaw_rad[at_start].mean())
    moved_m = (x_m - x_m[at_start].mean() + 1j * (y_m - y_m[at_start].mean())) * np.exp(-1j * start_rad)
    return moved_m, start_rad
