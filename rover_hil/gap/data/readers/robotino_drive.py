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

from controllers.motion.rover_geometry import OmniRoverSettings
from drivers.errors import ConfigError
from drivers.robotino_board.robotino_2 import ROBOTINO_BOARD
from rover_hil.drives.drive import Drive
from rover_hil.drives.robotino_csv import (
    AVERAGE_S,
    AVERAGES_BEGIN,
    CAMERA_UNITS,
    IS_RECORD,
    camera_poses,
    read_averages,
)
from rover_hil.drives.windows import Windows, body_rates
from rover_hil.gap.data.columns import (
    Columns,
    Reader,
    check_times,
    missing_values,
    need,
    read_columns,
    read_runs_by_name,
    table_files,
)
from rover_hil.gap.data.logs import log_columns
from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.stretches import MOTION, stretches, windows_of_drive, windows_over
from sim_backends.models.interface import Array, Run
from sim_backends.models.robotino_drive.model import RADIUS_M, TO_BODY, WHEELS

TICKS_PER_RAD = ROBOTINO_BOARD.ticks_per_motor_turn * ROBOTINO_BOARD.gear_ratio / math.tau
NOMINAL_M_PER_PX = 1.84e-3
"""Scale of the camera's image by its calibration; the model fits it."""
MIDDLE_M = (1.45, -1.04)
"""Approximate middle of the paths in the picture."""


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
            runs += _averages(file)
        elif "m1pos" in columns:
            runs.append(_pixels(file, prefix, surface, columns))
        else:
            runs += [
                _posed(f"{prefix}{name}", surface, one, {}) for name, one in read_runs_by_name(file).items()
            ]
    return runs


def drive_runs_of_log(drive: Drive) -> list[Run]:
    """Return the run in a log.

    Raises:
        ConfigError: It is of another kind of rover, or lacks wheels or the true pose.
    """
    rover = drive.config.rover
    if not isinstance(rover, OmniRoverSettings):
        raise ConfigError(
            f"{drive.name} is of a rover of the kind {rover.kinematics}: use the log of three "
            "omnidirectional wheels"
        )
    labels = {"wheel_radius_m": rover.wheel_radius_m, "base_radius_m": rover.base_radius_m}
    # Sensors of a log have times of their own; before and after them nothing is missing.
    return [replace(_posed(drive.name, 1.0, log_columns(drive), labels), missing={})]


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
    inputs = {f"wheel_{wheel}_rad_s": windows.rate(t_s, turned[wheel - 1]) for wheel in WHEELS}
    inputs |= _currents(windows, t_s, current)
    inputs["image_x_m"] = windows.mean(t_s, x_m) - MIDDLE_M[0]
    inputs["image_y_m"] = windows.mean(t_s, y_m) - MIDDLE_M[1]
    run = _run(name, surface, windows, inputs, dict(zip(MOTION, pose, strict=True)), {})
    return replace(run, missing=gaps)


def _posed(name: str, surface: float, columns: Columns, labels: Mapping[str, float]) -> Run:
    optional = (*(f"current{wheel}_a" for wheel in WHEELS), "yaw_rate_deg_s")
    windows, run = windows_of_drive(name, columns, columns, WHEELS, optional)
    t_s, measured = columns["t_s"], dict(run.measured)
    currents = [np.abs(columns.get(f"current{wheel}_a", np.zeros(t_s.size))) for wheel in WHEELS]
    if "yaw_rate_deg_s" in columns:
        measured["gyro_rad_s"] = windows.mean(t_s, np.radians(columns["yaw_rate_deg_s"]))
    if "surface" in columns:
        surface = float(columns["surface"][0])
    inputs = {**run.inputs, **_currents(windows, t_s, currents)}
    return replace(_run(name, surface, windows, inputs, measured, labels), missing=run.missing)


def _currents(windows: Windows, t_s: Array, current: list[Array]) -> dict[str, Array]:
    # Noise in an input makes effects that depend on it look smaller.
    means = [windows.mean(t_s, values) for values in current]
    smooth = [uniform_filter1d(mean, DATA.readers.current_windows, mode="nearest") for mean in means]
    return {f"current_{wheel}_a": values for wheel, values in zip(WHEELS, smooth, strict=True)}


def _run(
    name: str,
    surface: float,
    windows: Windows,
    inputs: Mapping[str, Array],
    measured: Mapping[str, Array],
    labels: Mapping[str, float],
) -> Run:
    speeds = np.stack([inputs[f"wheel_{wheel}_rad_s"] for wheel in WHEELS])
    forward, left, _ = TO_BODY @ speeds * labels.get("wheel_radius_m", RADIUS_M)
    direction = math.degrees(math.atan2(float(left.mean()), float(forward.mean())))
    rounded = DATA.readers.direction_step_deg * round(direction / DATA.readers.direction_step_deg) % 360.0
    nowhere = np.zeros(windows.middle_s.size)
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


def _averages(path: Path) -> list[Run]:
    means = read_averages(path, with_camera=True)
    along, across, turning = means.command.T
    key = np.where(turning != 0.0, -1.0, np.round(np.degrees(np.arctan2(across, along))) % 360.0)
    runs = []
    for value in np.unique(key):
        rows = np.flatnonzero(key == value)
        if rows.size < DATA.windows.least:
            continue
        windows = Windows(AVERAGE_S * np.arange(rows.size + 1, dtype=np.float64))
        inputs = {f"wheel_{w}_rad_s": means.wheel_rad_s[rows, w - 1] for w in WHEELS}
        inputs |= {f"current_{w}_a": means.current_a[rows, w - 1] for w in WHEELS}
        moved = dict(zip(MOTION, means.velocity[rows].T, strict=True))
        name = f"{path.stem} {'turns' if value < 0.0 else f'{value:.0f} deg'}"
        runs.append(_run(name, 1.0, windows, inputs, moved, {"is_averaged": 1.0}))
    return runs


READER = Reader(read=read_drive_runs, runs_of_log=drive_runs_of_log, cut=stretches)
