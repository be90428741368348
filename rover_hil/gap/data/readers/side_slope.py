"""Measured side-slope traverses: a folder with summary.csv, one row per run, and paths.csv.

The bend of the path, the turn of its direction over the last 70 % of the distance, is computed from
paths.csv; the start of the rover is excluded.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from rover_hil.drives.files.csv_table import CsvTable, read_csv
from rover_hil.gap.data.columns import Reader
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Array, Run
from sim_backends.models.side_slope.model import BEND, START_SHARE

CONDITIONS = ("slope_deg", "roll_deg", "mass_kg")
LABELS = ("condition", "rep", "romega_mm_s")
MEASURED = ("slip", "slip_angle_deg", "sinkage_up_mm", "sinkage_down_mm", "torque_up_Nm", "torque_down_Nm")
PATH_COLUMNS = ("t_s", "x_mm", "y_mm")


def read_side_slope(path: Path) -> list[Run]:
    """Return the runs in a folder, or in a summary file with paths.csv in the same folder.

    Slips, angles, sinkages (mm) and torques (N m) are those of summary.csv; `path_bend_deg_m` is added where
    paths.csv holds the run. Labels (`condition`, `rep`, `romega_mm_s`) are kept as conditions that the model
    does not use.

    Raises:
        ConfigError: A file cannot be read, a column is missing, or a cell holds no number.
    """
    summary = path / "summary.csv" if path.is_dir() else path
    table = _read(summary, CONDITIONS)
    present = [name for name in MEASURED if name in table.names]
    if not present:
        raise ConfigError(f"{summary} has none of the columns {', '.join(MEASURED)}")
    paths = summary.parent / "paths.csv"
    bends = _bends(paths) if paths.exists() else {}
    conditions = {name: table.numbers(name) for name in (*CONDITIONS, *LABELS) if name in table.names}
    measured = {name: table.numbers(name) for name in present}
    return [
        Run(
            name=name,
            conditions={key: float(values[row]) for key, values in conditions.items()},
            measured={key: values[[row]] for key, values in measured.items()}
            | ({BEND: np.array([bends[name]])} if name in bends else {}),
        )
        for row, name in enumerate(table.text("run"))
    ]


def _read(path: Path, needed: Sequence[str]) -> CsvTable:
    table = read_csv(path, ConfigError)
    table.require(("run", *needed), "a header line and one row per run are needed")
    return table


def _bends(path: Path) -> dict[str, float]:
    table = _read(path, PATH_COLUMNS)
    points = np.column_stack([table.numbers(name) for name in PATH_COLUMNS])
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(table.text("run")):
        rows.setdefault(name, []).append(row)
    bends = {name: path_bend_deg_m(points[members]) for name, members in rows.items()}
    return {name: bend for name, bend in bends.items() if math.isfinite(bend)}


def path_bend_deg_m(points: Array) -> float:
    """Return the turn of a path to the left per distance after the start, deg/m; NaN for short paths.

    Args:
        points: Rows of t (s), x (mm) and y (mm).
    """
    points = points[np.isfinite(points).all(axis=1)]
    late = points[points[:, 1] > START_SHARE * points[:, 1].max(initial=0.0)]
    if len(late) < DATA.readers.least_points:
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
