"""Read a drive, and its true path, from one of our own logs."""

import numpy as np

from controllers.motion.rover_geometry import has_four_wheels, track_of
from controllers.slip.scomp.parameters import RoverGeometry
from drivers.errors import LogError
from rover_hil.datasets.arrays import Array
from rover_hil.datasets.log import RecordedDrive
from rover_hil.scomp.drive import TruePath

NAMES = ("enc_rad", "heading_rad", "gyro_z_rad_s", "pitch_rad", "roll_rad", "trace_rad", "steering_rad")
STANDSTILL_RAD = 0.02


def log_columns(drive: RecordedDrive) -> tuple[dict[str, Array], RoverGeometry]:
    """Return a log as columns in the units of the CSV files, a row per position of the first wheel.

    The heading is that of the first heading device, the rate that of the gyro. Raised nose and left side are
    positive. The trace angles are those that the run found in its frames, the steering angle is the mean of
    the wheels.

    Raises:
        LogError: The log is of another kind of rover, or lacks wheel positions.
    """
    path, rover = drive.log.path, drive.config.rover
    if not has_four_wheels(rover):
        raise LogError(
            f"{path} is of a {rover.kinematics} rover: sComp needs four wheels: front left, front right, "
            "rear left, rear right"
        )
    if len(drive.rows["enc1_rad"]) < 2:
        raise LogError(f"log {path} holds no positions of the first wheel: give the log of a drive")
    return drive.table(NAMES), RoverGeometry(wheel_radius_m=rover.wheel_radius_m, track_m=track_of(rover))


def log_truth(drive: RecordedDrive) -> tuple[TruePath, str]:
    """Return the true path in a log, and in words what measured it.

    Pose fixes are on the floor of their camera; they are turned into the frame of the pose at start, the mean
    of those before the first wheel turns, or the first one.

    Raises:
        LogError: There is no true path, or its times do not rise.
    """
    true = drive.true_poses()
    t_s, x_m, y_m, psi_rad = drive.seconds(true.t_ns), true.x_m, true.y_m, true.yaw_rad
    if len(t_s) < 2 or not (np.diff(t_s) > 0.0).all():
        raise LogError(
            f"log {drive.log.path}: the times of its {true.source} do not rise, or there are too few"
        )
    if true.is_exact:
        return TruePath(t_s=t_s, x_m=x_m, y_m=y_m, psi_rad=psi_rad), true.source
    wheel = drive.rows["enc1_rad"]
    turned = np.abs(wheel.value - wheel.value[0]) > STANDSTILL_RAD
    at_start = true.t_ns < (wheel.t_ns[np.argmax(turned)] if turned.any() else wheel.t_ns[-1])
    at_start[0] = True
    start_rad = float(psi_rad[at_start].mean())
    moved_m = (x_m - x_m[at_start].mean() + 1j * (y_m - y_m[at_start].mean())) * np.exp(-1j * start_rad)
    path = TruePath(t_s=t_s, x_m=moved_m.real, y_m=moved_m.imag, psi_rad=psi_rad - start_rad)
    return path, true.source
