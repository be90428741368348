"""Recorded drives in windows of equal length, and cut into stretches."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivers.errors import ConfigError
from rover_hil.drives.channels import POSE
from rover_hil.drives.windows import Windows, body_rates
from rover_hil.gap.data.columns import Columns, check_times, missing_values, need, whole_rows
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Array, Run

MOTION = ("forward_m_s", "left_m_s", "turn_rad_s")
OVERLAP = (2, 1)
"""Values at the start and end of a stretch that overlap with its neighbours."""


def windows_over(first_s: float, last_s: float, where: str) -> Windows:
    """Return windows over a drive: of 0.2 s, narrower for short drives and wider for long ones.

    Raises:
        ConfigError: The drive is too short.
    """
    duration_s = last_s - first_s
    if duration_s < DATA.windows.least_duration_s:
        raise ConfigError(
            f"{where} lasts {duration_s:.1f} s: {DATA.windows.least_duration_s:g} s or more are needed"
        )
    count = min(max(math.floor(duration_s / DATA.windows.window_s), DATA.windows.least), DATA.windows.most)
    return Windows(np.linspace(first_s, last_s, count + 1))


def known_poses(truth: Columns) -> tuple[Array, Array, Array, Array]:
    """Return times, x, y and unwrapped yaw of the rows with a pose."""
    known = np.isfinite(np.stack([truth[one] for one in POSE])).all(axis=0)
    t_s, x_m, y_m, yaw_rad = (truth[one][known] for one in ("t_s", *POSE))
    return t_s, x_m, y_m, np.unwrap(yaw_rad)


def windows_of_drive(
    name: str, columns: Columns, truth: Columns, wheels: Sequence[int], optional: Sequence[str]
) -> tuple[Windows, Run]:
    """Return a drive in windows: their edges, and a run with the speeds of its wheels and its motion.

    Args:
        name: Of the drive.
        columns: With the angle of each wheel.
        truth: With the pose; may be the same.
        wheels: Their numbers.
        optional: Other columns whose missing values count.

    Raises:
        ConfigError: A column is missing, times do not rise, or the drive is too short.
    """
    turned = [f"position{wheel}_rad" for wheel in wheels]
    need(columns, ("t_s", *turned), name, "odometry needs the wheels")
    need(truth, ("t_s", *POSE), f"truth of {name}", "odometry is compared with the true pose")
    t_s = columns["t_s"]
    check_times(t_s, name)
    check_times(truth["t_s"], f"truth of {name}")
    true_s, *pose = known_poses(truth)
    if true_s.size < DATA.windows.least:
        raise ConfigError(f"truth of {name} has {true_s.size} poses: {DATA.windows.least} or more are needed")
    rows = whole_rows(columns, turned)
    recorded = {one: values[rows] for one, values in columns.items()}
    missing = missing_values(recorded, (*turned, *optional), name)
    first_s, last_s = max(recorded["t_s"][0], true_s[0]), min(recorded["t_s"][-1], true_s[-1])
    windows = windows_over(float(first_s), float(last_s), name)
    inputs = {f"wheel_{wheel}_rad_s": windows.rate(t_s, columns[f"position{wheel}_rad"]) for wheel in wheels}
    moved = dict(zip(MOTION, body_rates(windows, true_s, *pose), strict=True))
    return windows, Run(
        name=name, inputs={"t_s": windows.middle_s, **inputs}, measured=moved, conditions={}, missing=missing
    )


def stretches(run: Run) -> list[Run]:
    """Return a run of windows cut into four or more of at least 64; itself where it is too short.

    Delays reach over a cut from both sides: values at both ends of each stretch are left out. Missing values
    of the drive are counted with its first stretch.
    """
    size = run.inputs["t_s"].size
    count = size // DATA.windows.least_stretch
    if count < DATA.windows.least_stretches:
        return [run]
    cuts = np.linspace(0, size, count + 1).astype(int)
    parts = []
    for number, (first, last) in enumerate(itertools.pairwise(cuts.tolist()), start=1):
        measured = {name: values[first:last].copy() for name, values in run.measured.items()}
        for values in measured.values():
            values[: OVERLAP[0]] = values[-OVERLAP[1] :] = np.nan
        inputs = {name: values[first:last] for name, values in run.inputs.items()}
        missing = run.missing if number == 1 else {}
        part = replace(run, inputs=inputs, measured=measured, overlap=OVERLAP, missing=missing)
        parts.append(replace(part, name=f"{run.name} part {number}"))
    return parts
