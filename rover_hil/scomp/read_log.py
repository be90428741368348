"""Read a drive from one of our own logs."""

from pathlib import Path

from controllers.motion.rover_geometry import SkidSteerRoverSettings
from controllers.slip.scomp.parameters import RoverGeometry
from drivers.errors import LogError
from rover_hil.datasets.arrays import Array
from rover_hil.datasets.log import read_drive

NAMES = ("enc_rad", "heading_rad", "gyro_z_rad_s", "pitch_rad", "roll_rad", "trace_rad")


def read_log_columns(path: Path) -> tuple[dict[str, Array], RoverGeometry]:
    """Return a log as columns in the units of the CSV files, a row per position of the first wheel.

    The heading is that of the first heading device, the rate that of the gyro. Nose and left side up are
    positive. The trace angles are those that the run itself found in its frames.

    Raises:
        LogError: The log is damaged, of another kind of rover, or lacks wheel positions.
    """
    drive = read_drive(path, with_traces=True)
    rover = drive.config.rover
    if not isinstance(rover, SkidSteerRoverSettings):
        msg = f"{path} is of a {rover.kinematics} rover: sComp needs four wheels that do not steer"
        raise LogError(msg)
    if len(drive.rows["enc1_rad"]) < 2:
        msg = f"log {path} holds no positions of the first wheel: give the log of a drive"
        raise LogError(msg)
    return drive.table(NAMES), RoverGeometry(wheel_radius_m=rover.wheel_radius_m, track_m=rover.track_m)
