"""Drives that others recorded with ground truth: how far off the estimate ends, and what it says of that."""

import gzip
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from benchmarks.datasets.planted_faults import runs_of
from rover_hil.drives.arrays import Array
from rover_hil.drives.formats.table.columns import read_columns, rover_of
from rover_hil.drives.formats.table.to_log import write_table_as_log
from rover_hil.recording.reader import LogReader

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "vehicles"
"""Where the recordings are; see its README."""
COLUMNS = Path(__file__).parents[1] / "datasets"
RATE_HZ = 5
"""Cycles of the mower's drive: as many as it has rows."""


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """A drive to estimate.

    Attributes:
        columns: Name of its file of columns in `benchmarks/datasets`.
        by_gyro: Whether its turns are called those of a gyro.
        bias_rad_s: Planted in its turns.
    """

    columns: str
    by_gyro: bool = False
    bias_rad_s: float = 0.0


DRIVES: Mapping[str, RecordedDrive] = {
    "mower, increments": RecordedDrive("mower"),
    "mower, turn by gyro": RecordedDrive("mower", by_gyro=True),
    "mower, gyro with a bias of 0.005 rad/s": RecordedDrive("mower", by_gyro=True, bias_rad_s=0.005),
    "OptiOdom, two wheels": RecordedDrive("diff"),
    "OptiOdom, three omnidirectional wheels": RecordedDrive("omni3"),
    "OptiOdom, tricycle": RecordedDrive("tricycle"),
}


def missing() -> str:
    """Return why the drives cannot be measured; empty where they can."""
    return "" if FOLDER.is_dir() else f"{FOLDER} is missing: put the recordings there"


def measure_drive(name: str) -> dict[str, float]:
    """Return distance and turn between estimate and ground truth at the end, and the mean NEES.

    Returns:
        `end m`, `yaw deg`, both from the first true pose, and `NEES` of the place over its two dimensions.
    """
    drive = DRIVES[name]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        table, columns = folder / "drive.csv", folder / "columns.toml"
        text = (COLUMNS / f"{drive.columns}.toml").read_text("utf-8")
        if drive.columns == "mower":
            text = f"rate_hz = {RATE_HZ}\n{text}"
            source = FOLDER / "mower" / "increments.csv.gz"
            (folder / "truth.csv.gz").write_bytes((FOLDER / "mower" / "truth.csv.gz").read_bytes())
        else:
            kind = "tricyc" if drive.columns == "tricycle" else drive.columns
            source = runs_of(FOLDER, kind)[0]
        if drive.by_gyro:
            text = text.replace("[increments]\n", "[increments]\nturn_by_gyro = true\n")
        lines = gzip.decompress(source.read_bytes()).decode("utf-8").splitlines()
        if drive.bias_rad_s:
            lines = _with_bias(lines, drive.bias_rad_s)
        table.write_text("\n".join(lines) + "\n", "utf-8")
        columns.write_text(text, "utf-8")
        read = read_columns(columns)
        log = folder / "drive.mcap"
        for _ in write_table_as_log(table, read, rover_of(read, columns), log):
            pass
        return _errors(log)


def _with_bias(lines: Sequence[str], bias_rad_s: float) -> list[str]:
    head, *rows = lines
    numbers = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    numbers[:, 2] += bias_rad_s * np.diff(numbers[:, 0], prepend=numbers[0, 0])
    return [head, *(",".join(map(repr, row)) for row in numbers.tolist())]


def _errors(log: Path) -> dict[str, float]:
    poses: list[tuple[float, ...]] = []
    truth: list[tuple[float, ...]] = []
    for message in LogReader(log).messages():
        if message.topic not in ("/estimate", "/truth"):
            continue
        record = cast("dict[str, Any]", message.json())
        is_true = message.topic == "/truth"
        pose = record if is_true else record["estimate"]
        place = (float(message.t_ns), pose["x_m"], pose["y_m"], pose["yaw_rad"])
        if is_true:
            truth.append(place)
        else:
            xx, xy, _, yy, _, _ = pose["covariance"]
            poses.append((*place, xx, xy, yy))
    estimated, true = np.array(poses), np.array(truth)
    true = true[(true[:, 0] >= estimated[0, 0]) & (true[:, 0] <= estimated[-1, 0])]
    x, y, yaw, xx, xy, yy = (_at(true[:, 0], estimated, column) for column in range(1, 7))
    way = _from_first(x + 1j * y, yaw) - _from_first(true[:, 1] + 1j * true[:, 2], true[:, 3])
    turn = yaw - yaw[0] - (true[:, 3] - true[0, 3])
    # The covariance is that in the frame of the estimate, whose first yaw is 0.
    along, left = way.real, way.imag
    determinant = np.maximum(xx * yy - xy * xy, 1e-18)
    nees = (yy * along**2 - 2.0 * xy * along * left + xx * left**2) / determinant
    known = xx + yy > 1e-6
    return {
        "end m": float(abs(way[-1])),
        "yaw deg": abs(math.degrees(math.remainder(float(turn[-1]), math.tau))),
        "NEES": float(nees[known].mean()) / 2.0,
    }


def _at(t_ns: Array, rows: Array, column: int) -> Array:
    values = np.unwrap(rows[:, 3]) if column == 3 else rows[:, column]
    interpolated: Array = np.interp(t_ns, rows[:, 0], values)
    return interpolated


def _from_first(place: NDArray[np.complex128], yaw: Array) -> NDArray[np.complex128]:
    """Return positions relative to the first pose."""
    relative: NDArray[np.complex128] = (place - place[0]) * np.exp(-1j * yaw[0])
    return relative
