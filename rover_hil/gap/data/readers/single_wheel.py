"""Steady trials of a single-wheel test bed, as the table of the CMU bed (`smooth_wheel_steady_state.csv`).

Trials with one commanded slip angle and rim speed are replicates; their loads differ a little, so
forces are scaled to the mean load of the group; sinkages are not changed.

Source: GitHub robomechanics/3d-terramechanics @ 55a6e92 (MIT-style licence).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.gap.data.columns import Reader
from sim_backends.models.interface import Run

COLUMNS = (
    "beta_deg",
    "Vry_cmd_mm_s",
    "V_mm_s",
    "r_omega_mm_s",
    "Fx_tractive_N",
    "Fy_lateral_N",
    "Fz_load_N",
    "sinkage_mm",
)
FILE = "smooth_wheel_steady_state.csv"
Row = Mapping[str, float]


def read_single_wheel(path: Path) -> list[Run]:
    """Return the trials in a table, or in a folder that holds `smooth_wheel_steady_state.csv`.

    Raises:
        ConfigError: The file cannot be read, a column is missing, or a cell holds no number.
    """
    file = path / FILE if path.is_dir() else path
    table = read_csv(file, ConfigError)
    table.require(COLUMNS, "a header line and one row per trial are needed")
    columns = [table.numbers(name).tolist() for name in COLUMNS]
    rows = [dict(zip(COLUMNS, values, strict=True)) for values in zip(*columns, strict=True)]
    groups: dict[tuple[float, float], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["beta_deg"], row["Vry_cmd_mm_s"]), []).append(row)
    return [run for key, members in groups.items() for run in _runs(key, members)]


def _runs(key: tuple[float, float], members: Sequence[Row]) -> list[Run]:
    angle, speed = key
    load = float(np.mean([row["Fz_load_N"] for row in members]))
    conditions = {
        "rim_speed_mm_s": float(np.mean([row["r_omega_mm_s"] for row in members])),
        "travel_speed_mm_s": float(np.mean([row["V_mm_s"] for row in members])),
        "slip_angle_deg": angle,
        "load_N": load,
        "commanded_mm_s": speed,
    }
    return [
        Run(
            name=f"beta{angle:g}_v{speed:g}_{trial}",
            conditions=conditions,
            measured={
                "drawbar_N": np.array([row["Fx_tractive_N"] * load / row["Fz_load_N"]]),
                "side_N": np.array([row["Fy_lateral_N"] * load / row["Fz_load_N"]]),
                "sinkage_mm": np.array([row["sinkage_mm"]]),
            },
        )
        for trial, row in enumerate(members, start=1)
    ]


READER = Reader(read=read_single_wheel)
