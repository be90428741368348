"""What a fit of a soil came to: as tables, as a soil file, and as pictures."""

import json
import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter, SymmetricalLogLocator

from rover_hil.pages.picture import Drawing
from rover_hil.terrain.figures import COLOURS, legend, plots
from rover_hil.terrain.fit import SoilFit
from rover_hil.terrain.fit_data import WheelTests
from rover_hil.terrain.table import Cell, Table, number
from rover_hil.terrain.wheel import NOT_BORNE
from sim_backends.terramechanics.soil.any_angle_wheel import any_angle_at_load
from sim_backends.terramechanics.soil.library import WheelSettings
from sim_backends.terramechanics.soil.pressure_sinkage import PlateTest, power_pressure_pa

FIT_COLUMNS = ("name", "value", "lower", "upper", "at_bound", "reason")
CELL_COLUMNS = (
    "cell",
    "load_n",
    "drawbar_n",
    "drawbar_fitted_n",
    "side_n",
    "side_fitted_n",
    "sinkage_m",
    "sinkage_fitted_m",
    "reason",
)

LINEAR_MM_S = 5.0
"""Below this rim speed the axis is linear."""


def fit_table(fit: SoilFit, start_name: str) -> Table:
    """Return the numbers of the soil: fitted ones with 95 % intervals, then those that are not of tests.

    Args:
        fit: The fit.
        start_name: The soil that the others are of.
    """
    rows: list[tuple[Cell, ...]] = [
        (name, interval.value, interval.lower, interval.upper, name in fit.at_bound, "")
        for name, interval in fit.intervals.items()
    ]
    rows += [
        (name, interval.value, interval.lower, interval.upper, False, "of the plates alone")
        for name, interval in fit.of_tests.items()
        if name not in fit.intervals
    ]
    rows += [
        (name, getattr(fit.soil, name), None, None, False, f"not fitted: the number of {start_name}")
        for name in not_fitted(fit)
    ]
    return Table("soil", "Numbers of the soil with 95 % confidence intervals", FIT_COLUMNS, rows)


def not_fitted(fit: SoilFit) -> tuple[str, ...]:
    """Return the keys of the soil whose numbers are not of tests."""
    fields = fit.soil.model_dump()
    return tuple(
        name for name, value in fields.items() if isinstance(value, float) and name not in fit.of_tests
    )


def cells_table(fit: SoilFit, wheel: WheelSettings, tests: WheelTests) -> Table:
    """Return measured and fitted forces and sinkage of each cell of the wheel tests."""
    means = tests.means()
    sinkage, forces = any_angle_at_load(wheel, fit.soil, means.motion, means.load_n)
    columns = (
        means.load_n,
        means.drawbar_n,
        forces.drawbar_n,
        means.side_n,
        forces.side_n,
        means.sinkage_m,
        sinkage,
    )
    rows: list[tuple[Cell, ...]] = [
        (str(cell), *map(number, row), NOT_BORNE if math.isnan(row[-1]) else "")
        for cell, row in zip(means.cell, np.stack(columns, axis=1), strict=True)
    ]
    return Table("cells", "Cells of the wheel tests, measured and fitted", CELL_COLUMNS, rows)


def soil_text(fit: SoilFit, source: str, start_name: str) -> str:
    """Return the soil as TOML, 95 % intervals as comments, and what is not of tests marked.

    Args:
        fit: The fit.
        source: Origin of the tests.
        start_name: The soil that the other numbers are of.
    """
    kept = not_fitted(fit)
    marks = {"source": source, "not_fitted": kept, "not_fitted_from": start_name if kept else ""}
    comments = {name: f"  # {each.lower:.4g} .. {each.upper:.4g}" for name, each in fit.of_tests.items()}
    comments |= dict.fromkeys(kept, f"  # not fitted: of {start_name}")
    lines = [
        f"{name} = {json.dumps(value)}{comments.get(name, '')}"
        for name, value in fit.soil.model_copy(update=marks).model_dump(mode="json").items()
    ]
    return "\n".join(lines) + "\n"


def plate_drawing(plates: Sequence[PlateTest], fit: SoilFit) -> Drawing:
    """Return the picture of pressure over sinkage."""
    return Drawing(
        "Plates",
        "See whether one power law (dashed) holds for all plates; sizes in mm.",
        lambda: _draw_plates(plates, fit),
    )


def cell_drawing(tests: WheelTests, cells: Table) -> Drawing:
    """Return the picture of measured and fitted forces over the rim speed."""
    return Drawing(
        "Forces of the wheel tests",
        "See where the fitted law (lines) misses the measured means (dots): one colour per slip angle. These "
        "cells were fitted, so this is no test of the law.",
        lambda: _draw_cells(tests, cells),
    )


def _draw_plates(plates: Sequence[PlateTest], fit: SoilFit) -> Figure:
    figure, (axes,) = plots(1, 1, 3.6)
    sizes = sorted({plate.diameter_m for plate in plates})
    for plate in plates:
        index = sizes.index(plate.diameter_m)
        name = f"{1000.0 * plate.diameter_m:.0f} mm"
        axes.plot(1000.0 * plate.sinkage_m, plate.pressure_pa / 1000.0, color=COLOURS[index], label=name)
    depth = np.linspace(0.0, max(float(plate.sinkage_m.max()) for plate in plates), 100)
    law = power_pressure_pa(depth, fit.plates.modulus_pa.value, fit.plates.exponent.value)
    axes.plot(1000.0 * depth, law / 1000.0, color="black", linestyle="--", label="power law")
    axes.set_xlabel("sinkage (mm)")
    axes.set_ylabel("pressure (kPa)")
    return legend(figure, axes)


def _draw_cells(tests: WheelTests, cells: Table) -> Figure:
    figure, panels = plots(1, 2, 3.4)
    means = tests.means()
    for index, angle in enumerate(np.unique(means.slip_angle_deg)):
        chosen = np.flatnonzero(means.slip_angle_deg == angle)
        chosen = chosen[np.argsort(means.rim_speed_mm_s[chosen])]
        speed, colour = means.rim_speed_mm_s[chosen], COLOURS[index % len(COLOURS)]
        for axes, column in ((panels[0], "drawbar"), (panels[1], "side")):
            measured, fitted = (_column(cells, f"{column}{kind}_n")[chosen] for kind in ("", "_fitted"))
            axes.plot(speed, measured, "o", color=colour, markersize=5)
            axes.plot(speed, fitted, color=colour, label=f"{angle:g}°")
    for axes, label in zip(panels, ("drawbar pull (N)", "side force (N)"), strict=True):
        axes.set_xscale("symlog", linthresh=LINEAR_MM_S)
        axes.xaxis.set_major_locator(
            SymmetricalLogLocator(base=10.0, linthresh=LINEAR_MM_S, subs=(1.0, 2.0, 5.0))
        )
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.set_xlabel("rim speed (mm/s)")
        axes.set_ylabel(label)
    return legend(figure, panels[0], 7)


def _column(table: Table, name: str) -> np.typing.NDArray[np.float64]:
    place = table.columns.index(name)
    return np.array([row[place] for row in table.rows], dtype=np.float64)
