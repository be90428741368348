"""Measured drives of a Robotino under an overhead camera, as runs of windows.

- Robotino 2 runs (BrOleg5/research-wheel-slippage): ticks and current per motor, pose of a marker in pixels.
  The camera repeats some poses; such rows are left out.
- Averages of the paper (BrOleg5/Slippage-compensation): one row per half second, motor speeds in rpm, steps
  of the camera in mm; rows of one direction of drive, joined, are a run.
- Tables: `t_s`, `position1_rad..position3_rad` at the wheels, `x_m`, `y_m`, `yaw_rad`, perhaps
  `current1_a..`, `yaw_rate_deg_s`, `surface` and `run`. Logs of drives have the same columns.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d

from drivers.errors import ConfigError
from drivers.robotino_board.robotino_2 import ROBOTINO_BOARD
from rover_hil.drives.robotino_csv import (
    AVERAGE_S,
    AVERAGES_BEGIN,
    CAMERA_UNITS,
    COMMANDS,
    CURRENTS,
    IS_RECORD,
    SPEEDS,
    STEPS,
    camera_poses,
)
from rover_hil.drives.windows import Windows, body_rates
from rover_hil.gap.data.columns import (
    Columns,
    DriveLog,
    Reader,
    check_times,
    missing_values,
    need,
    read_columns,
    read_runs_by_name,
    table_files,
    whole_rows,
)
from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.stretches import stretches, windows_between, windows_over
from sim_backends.models.interface import Array, Run
from sim_backends.models.robotino_drive.model import RADIUS_M, TO_BODY, WHEELS

TICKS_PER_RAD = ROBOTINO_BOARD.ticks_per_motor_turn * ROBOTINO_BOARD.gear_ratio / math.tau
NOMINAL_M_PER_PX = 1.84e-3
"""Scale of the camera's image by its calibration; the model fits it."""
MIDDLE_M = (1.45, -1.04)
"""Approximate middle of the paths in the picture."""
RPM_TO_WHEEL = math.tau / 60.0 / ROBOTINO_BOARD.gear_ratio
"""Speed of a wheel in rad/s per rpm of its motor."""
LABELS = ("wheel_radius_m", "base_radius_m", "is_averaged")


def read_drive_runs(path: Path) -> list[Run]:
    """Return the runs in a file or in a folder and those below it; each folder of runs is a surface.

    Raises:
        ConfigError: A file cannot be read, a column is missing, a drive is too short or times do not rise.
    """
    files = table_files(path)
    surfaces = {
        folder: index for index, folder in enumerate(sorted({file.parent for file in files}), start=1)
    }
    runs: list[Run] = []
    for file in files:
        surface = float(surfaces[file.parent])
        columns = read_columns(file)
        prefix = f"{file.parent.name} " if len(surfaces) > 1 else ""
        if AVERAGES_BEGIN in columns:
            runs += _averages(file, columns)
        elif "m1pos" in columns:
            runs.append(_pixels(file, prefix, surface, columns))
        else:
            runs += [
                _posed(f"{prefix}{name}", surface, one, {}) for name, one in read_runs_by_name(file).items()
            ]
    return runs


def drive_runs_of_log(log: DriveLog) -> list[Run]:
    """Return the run in a log.

    Raises:
        ConfigError: It is of another kind of rover, or lacks wheels or the true pose.
    """
    if log.kind not in ("", "omni3"):
        raise ConfigError(
            f"{log.name} is of a rover of the kind {log.kind}: use the log of three omnidirectional wheels"
        )
    # Sensors of a log have times of their own; before and after them nothing is missing.
    return [replace(_posed(log.name, 1.0, log.columns, log.facts), missing={})]


def _pixels(path: Path, prefix: str, surface: float, columns: Columns) -> Run:
    names = [f"m{wheel}{kind}" for wheel in WHEELS for kind in ("pos", "cur")]
    need(columns, ("t", *CAMERA_UNITS, *names), str(path), IS_RECORD)
    gaps = missing_values(columns, (*CAMERA_UNITS, *names), str(path))
    t_s = columns["t"] / 1000.0
    check_times(t_s, str(path))
    x_px, y_px, yaw_rad, has_pose = camera_poses(columns)
    x_m, y_m = NOMINAL_M_PER_PX * x_px, NOMINAL_M_PER_PX * y_px
    windows = windows_over(float(t_s[0]), float(t_s[has_pose][-1]), str(path))
    turned = [columns[f"m{wheel}pos"] / TICKS_PER_RAD for wheel in WHEELS]
    current = [columns[f"m{wheel}cur"] for wheel in WHEELS]
    name = prefix + path.name.split(".csv")[0]
    pose = body_rates(windows, t_s[has_pose], x_m[has_pose], y_m[has_pose], yaw_rad[has_pose])
    inputs = _wheels(windows, t_s, turned, current)
    inputs["image_x_m"] = windows.mean(t_s, x_m) - MIDDLE_M[0]
    inputs["image_y_m"] = windows.mean(t_s, y_m) - MIDDLE_M[1]
    return replace(_run(name, surface, windows, inputs, _named(pose), {}), missing=gaps)


def _posed(name: str, surface: float, columns: Columns, facts: Mapping[str, float]) -> Run:
    turned_names = [f"position{wheel}_rad" for wheel in WHEELS]
    need(columns, ("t_s", *turned_names), name, "odometry needs the wheels")
    need(columns, ("x_m", "y_m", "yaw_rad"), name, "odometry is compared with the true pose")
    t_s = columns["t_s"]
    check_times(t_s, name)
    has_pose = np.isfinite(columns["x_m"]) & np.isfinite(columns["y_m"]) & np.isfinite(columns["yaw_rad"])
    if has_pose.sum() < DATA.windows.least:
        raise ConfigError(
            f"{name} has {int(has_pose.sum())} true poses: record one with a camera above the rover"
        )
    rows = whole_rows(columns, turned_names)
    optional = (*(f"current{wheel}_a" for wheel in WHEELS), "yaw_rate_deg_s")
    recorded = {one: values[rows] for one, values in columns.items()}
    gaps = missing_values(recorded, (*turned_names, *optional), name)
    windows = windows_between(t_s[rows], t_s[has_pose], name)
    currents = [np.abs(columns.get(f"current{wheel}_a", np.zeros(t_s.size))) for wheel in WHEELS]
    wheels = _wheels(windows, t_s, [columns[one] for one in turned_names], currents)
    pose = body_rates(windows, t_s[has_pose], *(columns[one][has_pose] for one in ("x_m", "y_m", "yaw_rad")))
    measured = _named(pose)
    if "yaw_rate_deg_s" in columns:
        measured["gyro_rad_s"] = windows.mean(t_s, np.radians(columns["yaw_rate_deg_s"]))
    if "surface" in columns:
        surface = float(columns["surface"][0])
    return replace(_run(name, surface, windows, wheels, measured, facts), missing=gaps)


def _wheels(windows: Windows, t_s: Array, turned: list[Array], current: list[Array]) -> dict[str, Array]:
    inputs = {f"wheel_{wheel}_rad_s": windows.rate(t_s, turned[wheel - 1]) for wheel in WHEELS}
    for wheel in WHEELS:
        # Noise in an input makes effects that depend on it look smaller.
        mean = windows.mean(t_s, current[wheel - 1])
        inputs[f"current_{wheel}_a"] = uniform_filter1d(mean, DATA.readers.current_windows, mode="nearest")
    return inputs


def _named(pose: tuple[Array, Array, Array]) -> dict[str, Array]:
    return dict(zip(("forward_m_s", "left_m_s", "turn_rad_s"), pose, strict=True))


def _run(
    name: str,
    surface: float,
    windows: Windows,
    inputs: Mapping[str, Array],
    measured: Mapping[str, Array],
    facts: Mapping[str, float],
) -> Run:
    speeds = np.stack([inputs[f"wheel_{wheel}_rad_s"] for wheel in WHEELS])
    forward, left, _ = TO_BODY @ speeds * facts.get("wheel_radius_m", RADIUS_M)
    direction = math.degrees(math.atan2(float(left.mean()), float(forward.mean())))
    rounded = DATA.readers.direction_step_deg * round(direction / DATA.readers.direction_step_deg) % 360.0
    nowhere = np.zeros(windows.middle_s.size)
    labels = {key: facts[key] for key in LABELS if key in facts}
    return Run(
        name=name,
        conditions={
            "direction_deg": rounded,
            "speed_m_s": round(float(np.hypot(forward, left).mean()), 2),
            "surface": surface,
            **labels,
        },
        inputs={"t_s": windows.middle_s, "image_x_m": nowhere, "image_y_m": nowhere, **inputs},
        measured=measured,
    )


def _averages(path: Path, columns: Columns) -> list[Run]:
    needed = (*SPEEDS, *CURRENTS, *STEPS, *COMMANDS)
    need(columns, needed, str(path), "give the file of averages as published")
    along, across, turning = (columns[name] for name in COMMANDS)
    key = np.where(turning != 0.0, -1.0, np.round(np.degrees(np.arctan2(across, along))) % 360.0)
    runs = []
    for value in np.unique(key):
        rows = np.flatnonzero(key == value)
        if rows.size < DATA.windows.least:
            continue
        windows = Windows(AVERAGE_S * np.arange(rows.size + 1, dtype=np.float64))
        inputs = {f"wheel_{w}_rad_s": columns[SPEEDS[w - 1]][rows] * RPM_TO_WHEEL for w in WHEELS}
        inputs |= {f"current_{w}_a": np.abs(columns[CURRENTS[w - 1]][rows]) for w in WHEELS}
        pose = (
            columns[STEPS[0]][rows] / 1000.0 / AVERAGE_S,
            columns[STEPS[1]][rows] / 1000.0 / AVERAGE_S,
            np.radians(columns[STEPS[2]][rows]) / AVERAGE_S,
        )
        name = f"{path.stem} {'turns' if value < 0.0 else f'{value:.0f} deg'}"
        runs.append(_run(name, 1.0, windows, inputs, _named(pose), {"is_averaged": 1.0}))
    return runs


READER = Reader(read=read_drive_runs, runs_of_log=drive_runs_of_log, cut=stretches)
