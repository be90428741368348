"""`rover-hil terrain fit`: a soil from plate and wheel tests."""

import math
from collections.abc import Sequence
from pathlib import Path

from rover_hil.report.write import write_all
from rover_hil.terrain.fit import SoilFit, fit_soil
from rover_hil.terrain.fit_data import WheelTests
from rover_hil.terrain.fit_files import read_cmu_plates, read_cmu_wheel
from rover_hil.terrain.setup import Output, waited_for
from rover_hil.terrain.soil_result import (
    cell_drawing,
    cells_table,
    fit_table,
    plate_drawing,
    soil_text,
)
from sim_backends.soil.any_angle_wheel import load_any_angle_soil
from sim_backends.soil.library import WheelSettings, load_wheel
from sim_backends.soil.pressure_sinkage import PlateTest

PLATE_FOLDER = "plate_penetration"
WHEEL_FILE = "smooth_wheel_steady_state.csv"
SOIL_FILE = "soil.toml"


def fit(data: Path, *, wheel_name: str, soil_name: str, free: str, plates_only: bool, output: Output) -> int:
    """Fit a soil to plate and wheel tests, print numbers with intervals; returns the exit code.

    Args:
        data: Folder of the CMU single-wheel test bed, or one with its plate tests alone.
        wheel_name: Wheel of the library or TOML file.
        soil_name: Start values: `cmu_sand_blind`, `cmu_sand`, or a TOML file.
        free: Numbers to be fitted to the wheel tests, separated by commas.
        plates_only: Leave out the wheel tests.
        output: Where results go; the soil goes there too, as TOML.

    Raises:
        ConfigError: No such wheel or soil, or the folder cannot be written to.
        LogError: The data cannot be read.
        ModelError: Too few tests, or a number is out of range.
    """
    start, wheel = load_any_angle_soil(soil_name), load_wheel(wheel_name)
    names = [name.strip() for name in free.split(",")]
    inner = data / PLATE_FOLDER
    plates = waited_for(lambda: read_cmu_plates(inner if inner.is_dir() else data), "reading plate tests")
    tests = None if plates_only else read_cmu_wheel(data / WHEEL_FILE)
    found = waited_for(lambda: fit_soil(plates, tests, wheel, start, names), "fitting")
    if output.folder is not None:
        _write(output.folder, f"{data.name}, wheel {wheel_name}", found, wheel, plates, tests)
    table = fit_table(found)
    residual = None if math.isnan(found.residual) else found.residual
    record = {"fitted": table.records(), "cells": found.cells, "weighted_residual": residual}
    output.show([table], record)
    return 0


def _write(
    folder: Path,
    source: str,
    found: SoilFit,
    wheel: WheelSettings,
    plates: Sequence[PlateTest],
    tests: WheelTests | None,
) -> None:
    from rover_hil.terrain.pages import write_page

    tables, drawings = [fit_table(found)], [plate_drawing(plates, found)]
    if tests is not None:
        cells = cells_table(found, wheel, tests)
        tables.append(cells)
        drawings.append(cell_drawing(tests, cells))
    facts = [("plate tests", str(len(plates))), ("cells of wheel tests", str(found.cells))]
    if tests is not None:
        facts.append(("misfit in stated errors, rms", f"{found.residual:.3g}"))
    write_page(folder, f"Soil fitted to {source}", facts, drawings, tables)
    write_all(folder, {SOIL_FILE: soil_text(found.soil, found, f"fitted to {source}")})
