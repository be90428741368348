"""`rover-hil terrain fit`: a soil from plate and wheel tests."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import LogError
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.options import ClusterOption, ForceOption, JsonOption
from rover_hil.parallel.calls import open_calls
from rover_hil.terrain.fit import SoilFit, fit_soil
from rover_hil.terrain.fit_data import WheelTests
from rover_hil.terrain.fit_files import read_cmu_plates, read_cmu_wheel
from rover_hil.terrain.fit_tables import PLATE_TABLE, WHEEL_TABLE, read_plate_table, read_wheel_table
from rover_hil.terrain.setup import Output, ReportOption, waited_for
from rover_hil.terrain.soil_result import (
    cell_drawing,
    cells_table,
    fit_table,
    not_fitted,
    plate_drawing,
    soil_text,
)
from sim_backends.terramechanics.soil.any_angle_wheel import load_any_angle_soil
from sim_backends.terramechanics.soil.library import WheelSettings, load_wheel
from sim_backends.terramechanics.soil.pressure_sinkage import PlateTest

PLATE_FOLDER = "plate_penetration"
PLATE_FILES = "force-displacement_*"
WHEEL_FILES = "*_wheel_steady_state.csv"
SOIL_FILE = "soil.toml"


def fit(
    data: Annotated[
        Path,
        typer.Argument(help="Folder of plate and wheel tests; docs/reference/terrain.md names the files."),
    ],
    wheel_name: Annotated[str, typer.Option("--wheel", help="The wheel of the tests.")] = "cmu_smooth",
    soil_name: Annotated[
        str, typer.Option("--soil", help="Start values: a soil file, or its name.")
    ] = "cmu_sand_blind",
    free: Annotated[str, typer.Option(help="Numbers to fit to the wheel tests, `a,b,c`.")] = (
        "shear_modulus_m,exit_share,slide_number,push_number,wake_rate,wall_number,sideways_exponent,wall_drag"
    ),
    plates_only: Annotated[bool, typer.Option("--plates-only", help="Leave out the wheel tests.")] = False,
    cluster: ClusterOption = None,
    out: ReportOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Fit a soil to plate and wheel tests, with 95 % confidence intervals.

    Example: `rover-hil terrain fit test_bed --out sand`

    Data: `rover-hil sample test_bed` writes this folder; for plates.csv and wheel.csv of your test bed,
    docs/reference/terrain.md names the columns.
    """
    output = Output(out, as_json, force)
    output.refuse_overwrite("soil", "cells", others=[SOIL_FILE])
    if not data.is_dir():
        raise LogError(
            f"no folder {data}: give one with plate and wheel tests; docs/reference/terrain.md names them"
        )
    start, wheel = load_any_angle_soil(soil_name), load_wheel(wheel_name)
    names = [name.strip() for name in free.split(",")]
    plates = waited_for(lambda: _plates(data), "reading plate tests")
    tests = None if plates_only else _wheel_tests(data, wheel_name)
    with open_calls(cluster) as calls:
        fitted_soil = waited_for(lambda: fit_soil(plates, tests, wheel, start, names, calls), "fitting")
    if output.folder is not None:
        _write(
            output.folder, f"{data.name}, wheel {wheel_name}", fitted_soil, wheel, plates, tests, soil_name
        )
    table = fit_table(fitted_soil, soil_name)
    residual = None if math.isnan(fitted_soil.residual) else fitted_soil.residual
    rows = table.records()
    record = {
        "fitted": [row for row in rows if row["name"] in fitted_soil.intervals],
        "not_fitted": [row for row in rows if row["name"] in not_fitted(fitted_soil)],
        "cells": fitted_soil.cells,
        "weighted_residual": residual,
    }
    output.show([table], record)
    return EXIT_OK


def _plates(data: Path) -> list[PlateTest]:
    if (data / PLATE_TABLE).exists():
        return read_plate_table(data / PLATE_TABLE)
    inner = data / PLATE_FOLDER
    folder = inner if inner.is_dir() else data
    if not any(folder.glob(PLATE_FILES)):
        raise LogError(f"{data} holds no {PLATE_TABLE}: docs/reference/terrain.md names its columns.")
    return read_cmu_plates(folder)


def _wheel_tests(data: Path, wheel_name: str) -> WheelTests:
    if (data / WHEEL_TABLE).exists():
        return read_wheel_table(data / WHEEL_TABLE)
    files = sorted(data.glob(WHEEL_FILES))
    fitting = [file for file in files if file.name.split("_")[0] in wheel_name] if len(files) > 1 else files
    if len(fitting) != 1:
        names = ", ".join(file.name for file in files) or "none"
        raise LogError(
            f"{data}: holds no {WHEEL_TABLE}, and not one {WHEEL_FILES} for wheel {wheel_name} "
            f"(found: {names}); give --wheel, or --plates-only."
        )
    return read_cmu_wheel(fitting[0])


def _write(
    folder: Path,
    source: str,
    soil_fit: SoilFit,
    wheel: WheelSettings,
    plates: Sequence[PlateTest],
    tests: WheelTests | None,
    soil_name: str,
) -> None:
    from rover_hil.terrain.pages import write_page

    tables, drawings = [fit_table(soil_fit, soil_name)], [plate_drawing(plates, soil_fit)]
    if tests is not None:
        cells = cells_table(soil_fit, wheel, tests)
        tables.append(cells)
        drawings.append(cell_drawing(tests, cells))
    facts = [("plate tests", str(len(plates))), ("cells of wheel tests", str(soil_fit.cells))]
    if tests is not None:
        facts.append(("misfit in stated errors, rms", f"{soil_fit.residual:.3g}"))
    soil = {SOIL_FILE: soil_text(soil_fit, f"fitted to {source}", soil_name)}
    write_page(folder, f"Soil fitted to {source}", facts, drawings, tables, soil)
