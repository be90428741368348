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

from drivers.errors import ConfigError
from rover_hil.drives.windows import Windows, body_rates
from rover_hil.gap.data.columns import (
    Columns,
    DriveLog,
    Reader,
    check_times,
    missing_values,
    need,
    read_columns,
    table_files,
    whole_rows,
)
from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.stretches import stretches, windows_between
from sim_backends.models.four_wheel_drive.model import WHEELS
from sim_backends.models.interface import Array, Run

POSE = ("x_m", "y_m", "yaw_rad")
LABELS = ("wheel_radius_m", "track_m")


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


def four_wheel_runs_of_log(log: DriveLog) -> list[Run]:
    """Return the run in a log.

    Raises:
        ConfigError: It is of another kind of rover, or lacks wheels or the true pose.
    """
    if log.kind not in ("", "skid_steer_4"):
        raise ConfigError(
            f"{log.name} is of a rover of the kind {log.kind}: use the log of four wheels that do not steer"
        )
    # Sensors of a log have times of their own; before and after them nothing is missing.
    return [replace(four_wheel_run(log.name, log.columns, log.columns, log.facts), missing={})]


def four_wheel_run(name: str, columns: Columns, truth: Columns, facts: Mapping[str, float]) -> Run:
    """Return a log with its truth as a run.

    Raises:
        ConfigError: A column is missing, or times do not rise.
    """
    turned = [f"position{wheel}_rad" for wheel in WHEELS]
    need(columns, ("t_s", *turned), name, "odometry needs the wheels")
    need(truth, ("t_s", *POSE), f"truth of {name}", "odometry is compared with the true pose")
    t_s, true_s = columns["t_s"], truth["t_s"]
    check_times(t_s, name)
    check_times(true_s, f"truth of {name}")
    has_pose = np.isfinite(np.stack([truth[one] for one in POSE])).all(axis=0)
    if has_pose.sum() < DATA.windows.least:
        raise ConfigError(
            f"truth of {name} has {int(has_pose.sum())} poses: {DATA.windows.least} or more are needed"
        )
    rows = whole_rows(columns, turned)
    recorded = {one: values[rows] for one, values in columns.items()}
    gaps = missing_values(recorded, (*turned, "yaw_rate_deg_s", "pitch_deg", "roll_deg"), name)
    windows = windows_between(t_s[rows], true_s[has_pose], name)
    x_m, y_m, yaw_rad = (truth[one][has_pose] for one in POSE)
    heading = np.unwrap(yaw_rad)
    forward, left, turn = body_rates(windows, true_s[has_pose], x_m, y_m, heading)
    inputs = {f"wheel_{wheel}_rad_s": windows.rate(t_s, columns[f"position{wheel}_rad"]) for wheel in WHEELS}
    inputs |= {f"{one}_rad": _tilt(windows, columns, one) for one in ("pitch", "roll")}
    inputs["heading_rad"] = np.interp(windows.middle_s, true_s[has_pose], heading)
    inputs["true_turn_rad_s"] = turn
    measured = {"forward_m_s": forward, "left_m_s": left}
    if _are_sides_apart(inputs):
        measured["turn_rad_s"] = turn
    return Run(
        name=name,
        conditions=_conditions(inputs, forward) | {key: facts[key] for key in LABELS if key in facts},
        inputs={"t_s": windows.middle_s, **inputs},
        measured=measured | _sensors(windows, columns, true_s[has_pose], heading),
        missing=gaps,
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
