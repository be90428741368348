"""Reading of drives, ground truth and parameters, writing of parameters and paths."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from controllers.motion.rover_geometry import has_four_wheels, track_of
from controllers.slip.scomp.parameters import RoverGeometry, ScompParameters
from drivers.errors import LogError
from drivers.settings import read_toml
from rover_hil.config import Config, validated
from rover_hil.drives.arrays import Array
from rover_hil.drives.column_names import read_named_table
from rover_hil.drives.drive import Drive
from rover_hil.drives.ground_truth import TruePoses, exact_poses
from rover_hil.drives.toml_text import toml_text
from rover_hil.scomp.columns import KNOWN, drive_of
from rover_hil.scomp.drive import SensorRows, Track

DIGITS = 6
COLUMNS = ("t_s", "x_m", "y_m", "heading_rad", "slip", "slip_angle_rad", "sigma_x_m", "sigma_y_m")
TRUTH = ("t_s", "x_m", "y_m", "yaw_rad")
CHANNELS = (
    "position_rad", "heading_rad", "gyro_z_rad_s", "pitch_rad", "roll_rad", "trace_rad", "steering_rad",
)  # fmt: skip
STANDSTILL_RAD = 0.02
FIX, FIX_TRUTH = "write a number or leave the cell empty", "write a number or leave the row out"


def read_rows(path: Path) -> tuple[SensorRows, list[str]]:
    """Return the readings in a CSV file, and a sentence for each change to them.

    Raises:
        LogError: It cannot be read, has no wheels, or its time does not increase.
    """
    table = read_named_table(path)
    rows, notes = drive_of(
        {name: table.numbers(name, fix=FIX) for name in table.names if name in KNOWN}, str(path)
    )
    others = [name for name in table.names if name not in KNOWN]
    if others:
        notes.append(f"columns that are not used: {', '.join(others)}")
    return rows, notes


def log_rows(drive: Drive) -> tuple[SensorRows, list[str]]:
    """Return the readings in a log, a row per position of the first wheel, and a sentence for each change.

    The heading is that of the first heading device, the rate that of the gyro. Raised nose and left side are
    positive. The trace angles are those that the run found in its frames, the steering angle is the mean of
    the wheels.

    Args:
        drive: Read with traces.

    Raises:
        LogError: The log is of another kind of rover, or lacks wheel positions.
    """
    path = drive.log.path
    geometry_of(drive.config, path)
    if len(drive.channels["position1_rad"]) < 2:
        raise LogError(f"log {path} holds no positions of the first wheel: give the log of a drive")
    return drive_of(drive.table(CHANNELS), str(path))


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


def read_truth(path: Path) -> TruePoses:
    """Return the true path in a CSV file; columns beyond t_s, x_m, y_m, yaw_rad have no effect.

    Raises:
        LogError: The file cannot be read, a column or a cell is missing, or its time does not increase.
    """
    table = read_named_table(path)
    table.require(TRUTH, f"the true path needs {', '.join(TRUTH)}")
    columns = {name: table.numbers(name, fix=FIX_TRUTH, is_needed=True) for name in TRUTH}
    if not (np.diff(columns["t_s"]) > 0.0).all():
        raise LogError(f"{path}: the time does not increase: sort the rows")
    return truth_of(columns, path.name)


def truth_of(columns: Mapping[str, Array], source: str) -> TruePoses:
    """Return the true path in columns with the names `TRUTH`."""
    t_s, *pose = (columns[name] for name in TRUTH)
    return exact_poses(source, np.round(1e9 * t_s).astype(np.int64), *pose)


def log_truth(drive: Drive) -> TruePoses:
    """Return the true path in a log, with times since its start.

    Pose fixes are on the floor of their camera; they are turned into the frame of the pose at start, the mean
    of those before the first wheel turns, or the first one.

    Raises:
        LogError: There is no true path, or its times do not rise.
    """
    true = drive.true_poses()
    if len(true.t_ns) < 2 or not (np.diff(true.t_ns) > 0).all():
        raise LogError(
            f"log {drive.log.path}: the times of its {true.source} do not rise, or there are too few"
        )
    path = replace(true, t_ns=true.t_ns - drive.log.start_ns)
    if true.is_exact:
        return path
    wheel = drive.channels["position1_rad"]
    turned = np.abs(wheel.value - wheel.value[0]) > STANDSTILL_RAD
    at_start = true.t_ns < (wheel.t_ns[np.argmax(turned)] if turned.any() else wheel.t_ns[-1])
    at_start[0] = True
    x_m, y_m, start_rad = (float(values[at_start].mean()) for values in (true.x_m, true.y_m, true.yaw_rad))
    moved_m = (true.x_m - x_m + 1j * (true.y_m - y_m)) * np.exp(-1j * start_rad)
    return replace(path, x_m=moved_m.real, y_m=moved_m.imag, yaw_rad=true.yaw_rad - start_rad)


def read_parameters(path: Path) -> ScompParameters:
    """Return the parameters in a file.

    Raises:
        ConfigError: It cannot be read or has an invalid value; the message names the key.
    """
    table = read_toml(path, f"parameter file {path}", "correct the path or leave --params out")
    return validated(ScompParameters, table, str(path))


def parameters_text(parameters: ScompParameters) -> str:
    """Return parameters as the text of a file."""
    return toml_text(parameters.model_dump(by_alias=True, exclude_none=True), DIGITS)


def track_text(track: Track) -> str:
    """Return a path as the text of a CSV file."""
    columns = [getattr(track, name).tolist() for name in COLUMNS]
    lines = [
        f"{t_s!r}," + ",".join(f"{value:.6f}" for value in values)
        for t_s, *values in zip(*columns, strict=True)
    ]
    return "\n".join([",".join(COLUMNS), *lines]) + "\n"
