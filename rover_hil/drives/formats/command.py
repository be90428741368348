"""`rover-hil import robotino`: a measured run becomes a log."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from rover_hil.config import load_config
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.options import ForceOption, out_option
from rover_hil.console.steps import show_progress
from rover_hil.drives.formats.files import without_estimate
from rover_hil.drives.formats.limits import EstimateOption, LimitSettings, MemoryOption, TimeOption
from rover_hil.drives.formats.reading_process import Report, read_in_child
from rover_hil.drives.formats.robotino_csv import read_run
from rover_hil.drives.formats.to_log import observing_config, write_run_as_log
from rover_hil.pages.atomic_write import check_new_file, unfinished
from rover_hil.terminal import Terminal


def import_run(
    file: Annotated[Path, typer.Argument(help="A measured run, .csv or .csv.gz.")],
    *,
    out: Annotated[Path, out_option("The log to write.")],
    millimetres_per_pixel: Annotated[
        float, typer.Option(help="Scale of the overhead camera; the data set's own file states 1.84.")
    ] = 1.84,
    config_name: Annotated[str, typer.Option("--config", help="The rover it was measured on.")] = "robotino",
    force: ForceOption = False,
    most_memory_gb: MemoryOption = None,
    most_minutes: TimeOption = None,
    no_estimate: EstimateOption = False,
) -> int:
    """Turn a measured Robotino run into a log, through the board's own byte frames.

    Example: `rover-hil import robotino exp00.csv -o exp00.mcap`

    Data: `rover-hil sample robotino` writes a simulated drive in this format; measured ones are in
    github.com/BrOleg5/research-wheel-slippage, `datasets/one_surface_type/gray_surface`.
    """
    check_new_file(out, force=force)
    config = observing_config(load_config(config_name))
    limits = LimitSettings(most_memory_gb, most_minutes).of(file)
    with unfinished(out) as part:

        def work(report: Report[tuple[int, int]]) -> int:
            rows = read_run(file, millimetres_per_pixel)
            for count in write_run_as_log(rows, file.name, config, part, with_estimate=not no_estimate):
                report((count, len(rows)))
            return len(rows)

        rows = read_in_child(file, limits, work, _show_rows())
    if no_estimate:
        Terminal().print(without_estimate(out), soft_wrap=True)
    Terminal().print(f"{rows} rows at {millimetres_per_pixel:g} mm per pixel: {out}", soft_wrap=True)
    return EXIT_OK


@contextmanager
def _show_rows() -> Iterator[Report[tuple[int, int]]]:
    """Give the function that shows how many of the rows are done."""
    with show_progress() as progress:
        task = progress.add_task("importing", total=None)
        yield lambda rows: progress.update(task, completed=rows[0], total=rows[1])
