"""Measured side-slope traverses: a folder with summary.csv, one row per run, and paths.csv.

The bend of the path, how fast its direction turns over the last 70 % of the way, is computed from paths.csv;
there the rover's start is over.
"""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from rover_hil.gap.data.columns import cell_number
from rover_hil.gap.data.reader import Reader
from sim_backends.models.interface import Array, Run
from sim_backends.models.side_slope.model import BEND, START_SHARE

LEAST_POINTS = 12
CONDITIONS = ("slope_deg", "roll_deg", "mass_kg")
LABELS = ("condition", "rep", "romega_mm_s")
MEASURED = ("slip", "slip_angle_deg", "sinkage_up_mm", "sinkage_down_mm", "torque_up_Nm", "torque_down_Nm")
PATH_COLUMNS = ("t_s", "x_mm", "y_mm")


def read_side_slope(path: Path) -> list[Run]:
    """Return the runs in a folder, or in a summary file beside which paths.csv may lie.

    Slips, angles, sinkages (mm) and torques (N m) are those of summary.csv; `path_bend_deg_m` is added where
    paths.csv holds the run. Labels (`condition`, `rep`, `romega_mm_s`) are kept as conditions that play no
    part in the model.

    Raises:
        ConfigError: A file cannot be read, a column is missing, or a cell holds no number.
    """
    summary = path / "summary.csv" if path.is_dir() else path
    rows = _rows(summary, ("run", *CONDITIONS))
    present = [name for name in MEASURED if name in rows[0]]
    if not present:
        raise ConfigError(f"{summary} has none of the columns {', '.join(MEASURED)}")
    paths = summary.parent / "paths.csv"
    bends = _bends(paths) if paths.exists() else {}
    runs = []
    for line, row in enumerate(rows, start=2):
        name = row["run"].strip()
        measured = {
            key: np.array([cell_number(row[key], f"{summary}, line {line}: {key}")]) for key in present
        }
        if name in bends:
            measured[BEND] = np.array([bends[name]])
        labels = [key for key in LABELS if key in row]
        conditions = {
            key: cell_number(row[key], f"{summary}, line {line}: {key}") for key in (*CONDITIONS, *labels)
        }
        runs.append(Run(name=name, conditions=conditions, measured=measured))
    return runs


def _rows(path: Path, needed: Sequence[str]) -> list[dict[str, str]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = [
                {key.strip(): value or "" for key, value in row.items() if key}
                for row in csv.DictReader(stream)
            ]
    except (OSError, UnicodeDecodeError, csv.Error, AttributeError) as error:
        raise ConfigError(f"cannot read {path} as a table: {error}") from error
    if not rows:
        raise ConfigError(f"{path} holds no runs: a header line and one row per run are needed")
    missing = [name for name in needed if name not in rows[0]]
    if missing:
        raise ConfigError(f"{path} has no column '{missing[0]}'")
    return rows


def _bends(path: Path) -> dict[str, float]:
    points: dict[str, list[list[float]]] = {}
    for line, row in enumerate(_rows(path, ("run", *PATH_COLUMNS)), start=2):
        point = [cell_number(row[key], f"{path}, line {line}: {key}") for key in PATH_COLUMNS]
        points.setdefault(row["run"].strip(), []).append(point)
    bends = {name: path_bend_deg_m(np.array(rows)) for name, rows in points.items()}
    return {name: bend for name, bend in bends.items() if math.isfinite(bend)}


def path_bend_deg_m(points: Array) -> float:
    """Return how fast the direction of a path turns to the left after the start, deg/m; NaN for short paths.

    Args:
        points: Rows of t (s), x (mm) and y (mm).
    """
    points = points[np.isfinite(points).all(axis=1)]
    late = points[points[:, 1] > START_SHARE * points[:, 1].max(initial=0.0)]
    if len(late) < LEAST_POINTS:
        return math.nan
    time, along, across = late[:, 0] - late[:, 0].mean(), late[:, 1], late[:, 2]
    forward = float(np.polyfit(time, along, 1)[0])
    if forward <= 0.0:
        return math.nan
    curve = np.polyfit(time, across, 2)
    tangent = float(curve[1]) / forward
    turn = 2.0 * float(curve[0]) / forward**2 * 1000.0
    return math.degrees(turn / (1.0 + tangent**2))


READER = Reader(read=read_side_slope)
