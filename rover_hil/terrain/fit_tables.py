"""Reads plate and wheel tests of any test bed from two tables."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.terrain.fit_data import WheelTests
from sim_backends.terramechanics.soil.any_angle_wheel import Motion
from sim_backends.terramechanics.soil.pressure_sinkage import PlateTest

PLATE_TABLE = "plates.csv"
WHEEL_TABLE = "wheel.csv"
PLATE_COLUMNS = ("diameter_m", "sinkage_m", "load_n")
WHEEL_COLUMNS = (
    "slip_angle_deg",
    "speed_m_s",
    "rim_speed_m_s",
    "load_n",
    "drawbar_n",
    "side_n",
    "sinkage_m",
)
RANGES: dict[str, tuple[float, float]] = {
    "diameter_m": (0.005, 2.0),
    "load_n": (0.0, 1e6),
    "slip_angle_deg": (-90.0, 90.0),
    "speed_m_s": (0.0, 20.0),
    "rim_speed_m_s": (0.0, 20.0),
    "drawbar_n": (-1e6, 1e6),
    "side_n": (-1e6, 1e6),
    "sinkage_m": (-0.01, 2.0),
}
"""Least and greatest value of each column, so that mm or kN for m or N are noticed where they can be."""


def read_plate_table(path: Path) -> list[PlateTest]:
    """Return the plate tests of a table; samples at or above the surface are left out.

    Args:
        path: CSV with the columns `test,diameter_m,sinkage_m,load_n`, one row per sample; rows of equal
            `test` are one test, of one round plate.

    Raises:
        LogError: The file cannot be read, lacks a column, or a number is out of range; names the place.
    """
    names, table = _read(path, "test", PLATE_COLUMNS)
    rows_of: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        rows_of.setdefault(name, []).append(row)
    tests = []
    for name, places in rows_of.items():
        rows = np.array(places)
        diameters_m = np.unique(table["diameter_m"][rows])
        if len(diameters_m) > 1:
            raise LogError(
                f"{path}: test '{name}' has plates of {len(diameters_m)} diameters; one test, one plate."
            )
        used = rows[(table["sinkage_m"][rows] > 0.0) & (table["load_n"][rows] > 0.0)]
        area_m2 = math.pi / 4.0 * diameters_m[0] ** 2
        tests.append(
            PlateTest(name, float(diameters_m[0]), table["sinkage_m"][used], table["load_n"][used] / area_m2)
        )
    return tests


def read_wheel_table(path: Path) -> WheelTests:
    """Return the steady trials of a table.

    Args:
        path: CSV with the columns `cell` and `WHEEL_COLUMNS`, one row per trial; trials of one `cell` are
            replicates. The wheel moves with `speed_m_s` in a direction
            `slip_angle_deg` to the left of where it points; `side_n` to the left, so mostly negative then.

    Raises:
        LogError: The file cannot be read, lacks a column, or a number is out of range; names the place.
    """
    names, table = _read(path, "cell", WHEEL_COLUMNS)
    angle_rad, speed_m_s = np.radians(table["slip_angle_deg"]), table["speed_m_s"]
    return WheelTests(
        cell=np.array(names),
        slip_angle_deg=table["slip_angle_deg"],
        rim_speed_mm_s=1000.0 * table["rim_speed_m_s"],
        motion=Motion(table["rim_speed_m_s"], speed_m_s * np.cos(angle_rad), speed_m_s * np.sin(angle_rad)),
        load_n=table["load_n"],
        drawbar_n=table["drawbar_n"],
        side_n=table["side_n"],
        sinkage_m=table["sinkage_m"],
    )


def _read(path: Path, label: str, columns: Sequence[str]) -> tuple[list[str], dict[str, Array]]:
    cells = read_csv(path)
    cells.require((label, *columns), "give one row per sample under that header")
    table = {name: cells.numbers(name) for name in columns}
    for name, values in table.items():
        lower, upper = RANGES[name]
        wrong = np.flatnonzero(~((values >= lower) & (values <= upper)))
        if wrong.size:
            text, where = cells.text(name)[wrong[0]], cells.where(int(wrong[0]))
            raise LogError(f"{where}: {name} is '{text}', not a number in {lower:g} .. {upper:g}.")
    return cells.text(label), table
