"""Recorded drives of a four-wheel rover with their true path, as runs of windows.

A log is a table `t_s,position1_rad..position4_rad,heading_deg,yaw_rate_deg_s,pitch_deg,roll_deg,...`;
encoders at the wheels in the order front left, front right, rear left, rear right; pitch nose up, roll left
side up. The truth is a second table `t_s,x_m,y_m,yaw_rad,...` in the same folder, with the name of the log
and `truth` in it, or the only one of the folder. The truth may also be in the same table; logs of this
software contain it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d

from controllers.motion.rover_geometry import SkidSteerRoverSettings
from drivers.errors import ConfigError
from rover_hil.drives.channels import POSE
from rover_hil.drives.drive import Drive
from rover_hil.drives.windows import Windows
from rover_hil.gap.data.columns import Columns, Reader, read_columns, table_files
from rover_hil.gap.data.logs import log_columns
from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.stretches import known_poses, stretches, windows_of_drive
from sim_backends.models.four_wheel_drive.model import WHEELS
from sim_backends.models.interface import Array, Run


def read_four_wheel_runs(path: Path) -> list[Run]:
    """Return one run per log in a file or folder.

    Raises:
        ConfigError: A file cannot be read, a log has no truth, a column is missing or the time does not rise.
    """
    among = table_files(path if path.is_dir() else path.parent)
    tables = {file: read_columns(file) for file in among}
    logs = [file for file in table_files(path) if "position1_rad" in tables[file]]
    if not logs:
        raise ConfigError(f"{path} holds no log: a table with t_s and position1_rad is needed")
    truths = [
        file
        for file, columns in tables.items()
        if "position1_rad" not in columns and set(POSE) <= set(columns)
    ]
    runs = []
    for file in logs:
        columns = tables[file]
        name = file.relative_to(path).as_posix() if path.is_dir() else file.name
        name = name.split(".csv")[0]
        truth = columns if set(POSE) <= set(columns) else tables[_truth_of(file, truths, logs)]
        runs.append(four_wheel_run(name, columns, truth, {}))
    return runs


def four_wheel_runs_of_log(drive: Drive) -> list[Run]:
    """Return the run in a log.

    Raises:
        ConfigError: It is of another kind of rover, or lacks wheels or the true pose.
    """
    rover = drive.config.rover
    if not isinstance(rover, SkidSteerRoverSettings):
        raise ConfigError(
            f"{drive.name} is of a rover of the kind {rover.kinematics}: use the log of four wheels that do "
            "not steer"
        )
    columns, labels = log_columns(drive), {"wheel_radius_m": rover.wheel_radius_m, "track_m": rover.track_m}
    # Sensors of a log have times of their own; before and after them nothing is missing.
    return [replace(four_wheel_run(drive.name, columns, columns, labels), missing={})]


def four_wheel_run(name: str, columns: Columns, truth: Columns, labels: Mapping[str, float]) -> Run:
    """Return a log with its truth as a run.

    Raises:
        ConfigError: A column is missing, or times do not rise.
    """
    windows, run = windows_of_drive(name, columns, truth, WHEELS, ("yaw_rate_deg_s", "pitch_deg", "roll_deg"))
    true_s, _, _, heading = known_poses(truth)
    measured = dict(run.measured)
    inputs = {**run.inputs, **{f"{one}_rad": _tilt(windows, columns, one) for one in ("pitch", "roll")}}
    inputs["heading_rad"] = np.interp(windows.middle_s, true_s, heading)
    inputs["true_turn_rad_s"] = measured["turn_rad_s"]
    if not _are_sides_apart(inputs):
        del measured["turn_rad_s"]
    return replace(
        run,
        conditions={**_conditions(inputs, measured["forward_m_s"]), **labels},
        inputs=inputs,
        measured=measured | _sensors(windows, columns, true_s, heading),
    )


def _are_sides_apart(inputs: Mapping[str, Array]) -> bool:
    left, right = (
        0.5 * (inputs[f"wheel_{a}_rad_s"] + inputs[f"wheel_{b}_rad_s"]) for a, b in ((1, 3), (2, 4))
    )
    level = float(np.sqrt(np.mean(np.square(left) + np.square(right)) / 2.0))
    return float(np.sqrt(np.mean(np.square(right - left)))) > DATA.readers.least_difference * level


def _truth_of(log: Path, truths: Sequence[Path], logs: Sequence[Path]) -> Path:
    stem = _plain(log)
    named = [one for one in truths if one.parent == log.parent and _plain(one) == stem]
    in_folder = [one for one in truths if one.parent == log.parent]
    if len(named) == 1:
        return named[0]
    if len(in_folder) == 1 and sum(1 for one in logs if one.parent == log.parent) == 1:
        return in_folder[0]
    raise ConfigError(
        f"{log} has no truth in its folder: add a table with t_s, x_m, y_m, yaw_rad, named "
        f"{log.name.split('.csv')[0]}_truth.csv"
    )


def _plain(path: Path) -> str:
    name = path.name.split(".csv")[0].lower()
    for word in ("truth", "log"):
        name = name.replace(word, "")
    return name.strip("_-. ")


def _tilt(windows: Windows, columns: Columns, name: str) -> Array:
    values = columns.get(f"{name}_deg")
    if values is None or not np.isfinite(values).any():
        return np.zeros(windows.middle_s.size)
    tilt = windows.mean(columns["t_s"], np.radians(values))
    smooth: Array = uniform_filter1d(tilt, DATA.readers.tilt_windows, mode="nearest")
    return smooth


def _conditions(inputs: Mapping[str, Array], forward: Array) -> dict[str, float]:
    return {
        "climb_deg": round(math.degrees(float(inputs["pitch_rad"].mean()))),
        "roll_deg": round(math.degrees(float(inputs["roll_rad"].mean()))),
        "speed_m_s": round(float(np.abs(forward).mean()), 2),
    }


def _sensors(windows: Windows, columns: Columns, true_s: Array, heading: Array) -> dict[str, Array]:
    """Return the readings of the gyro, and the error of the compass."""
    t_s, found = columns["t_s"], {}
    gyro = columns.get("yaw_rate_deg_s")
    if gyro is not None and np.isfinite(gyro).any():
        found["gyro_deg_s"] = windows.mean(t_s, gyro)
    compass = columns.get("heading_deg")
    if compass is not None and np.isfinite(compass).any():
        error = compass - np.degrees(np.interp(t_s, true_s, heading))
        wrapped = (error + 180.0) % 360.0 - 180.0
        good = np.isfinite(wrapped)
        smooth = np.full(wrapped.size, np.nan)
        smooth[good] = np.degrees(np.unwrap(np.radians(wrapped[good])))
        found["compass_error_deg"] = windows.mean(t_s, smooth)
    return found


READER = Reader(read=read_four_wheel_runs, runs_of_log=four_wheel_runs_of_log, cut=stretches)
