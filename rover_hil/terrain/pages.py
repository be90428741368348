"""The reports of the terrain commands: one page that needs nothing else, and the numbers as CSV."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from rover_hil.pages.add_page import add_page
from rover_hil.pages.atomic_write import write_files
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.terrain.climb import SlopeRow
from rover_hil.terrain.figures import draw_climbs, draw_forces, draw_paths, draw_slippage
from rover_hil.terrain.setup import REPORT_NAME
from rover_hil.terrain.slip_skid_figures import (
    draw_coefficients,
    draw_law,
    draw_measured,
    draw_skid_from_slip,
)
from rover_hil.terrain.table import Table, shown
from rover_hil.terrain.traverse import Traverse


def write_page(
    folder: Path,
    title: str,
    facts: Sequence[tuple[str, str]],
    drawings: Sequence[Drawing],
    tables: Sequence[Table],
    others: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write each table as CSV under its name into a folder, then `report.html`.

    Args:
        folder: Made if needed; files of these names are replaced.
        title: One sentence.
        facts: What was computed with, as pairs of name and value.
        drawings: Pictures, in order.
        tables: Tables, in order.
        others: Texts of further files, by name.

    Raises:
        ConfigError: The folder cannot be made or written to.
    """
    csv_texts = {f"{table.name}.csv": table.csv_text() for table in tables}
    write_files(folder, {**csv_texts, **others})
    add_page(
        folder / REPORT_NAME,
        lambda: render(
            "terrain/report.html",
            filters={"shown": shown},
            grade="plain",
            title=title,
            facts=facts,
            pictures=draw_pictures(drawings),
            tables=tables,
        ),
    )


def traverse_drawings(states: Sequence[Traverse]) -> list[Drawing]:
    """Return the pictures of traverses (paper 001, figures 11 and 12)."""
    return [
        Drawing(
            "Slip ratio and slip angle over the roll",
            "See how much slip a roll towards uphill saves; beyond the slope's own angle the model slides "
            "uphill. Hollow dots are boundary solutions: thrust to spare without slip. "
            "As in paper 001, figure 12.",
            lambda: draw_slippage(states),
        ),
        Drawing(
            "Paths in the surface",
            "See where the rover ends after one metre along the slope. As paper 001, figure 11.",
            lambda: draw_paths(states),
        ),
    ]


def wheel_drawings(table: Table) -> list[Drawing]:
    """Return the picture of a wheel's forces."""
    return [
        Drawing(
            "Forces at constant load",
            "See how thrust is lost to the side force: one line per slip angle.",
            lambda: draw_forces(table),
        )
    ]


def climb_drawings(rows: Sequence[SlopeRow], measured: Table) -> list[Drawing]:
    """Return the pictures of climbs, with those of paper 002 (figures 5 to 8)."""
    return [
        Drawing(
            "Slip over slope",
            "See how much slip a climb costs, and how much less a descent. Where a line ends, no steady "
            "state is left (measured lines: none within slip ratios of -1 to 1).",
            lambda: draw_climbs(rows, measured),
        ),
        *slip_skid_drawings(),
    ]


def slip_skid_drawings() -> list[Drawing]:
    """Return pictures as paper 002's figures 5 to 8."""
    return [
        Drawing(
            "Slip and skid, measured lines",
            "Wheels with lugs of 15 mm (Wh31), 10 mm (Wh32) and none (Wh34) at 85 N, by the lines fitted to "
            "measurements; Wh32 has no sinkage line. As paper 002, figures 5 and 7.",
            draw_measured,
        ),
        Drawing(
            "Coefficients",
            "See that traction changes its sign with slip and resistance does not. As paper 002, figure 6.",
            draw_coefficients,
        ),
        Drawing(
            "Law and measurement",
            "See what the wheel law of paper 001 makes of the smooth wheel with the soil's published "
            "numbers, nothing fitted. It knows only the shearing radius of lugs, so its results for the "
            "wheels hardly differ. With the lines of paper 002, figure 7.",
            draw_law,
        ),
        Drawing(
            "Skid from slip",
            "See that skid of a wheel with lugs follows from its slip. As paper 002, figure 8.",
            draw_skid_from_slip,
        ),
    ]
