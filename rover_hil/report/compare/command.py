"""`rover-hil compare`: runs side by side on one page."""

from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ConfigError
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ForceOption, JsonOption, check_inputs, log_at, out_option
from rover_hil.console.steps import show_steps
from rover_hil.pages.atomic_write import check_file, write_file
from rover_hil.report.compare.comparison import MOST_RUNS, compare_runs, render_comparison
from rover_hil.terminal import Terminal


def compare_logs(
    paths: Annotated[list[Path], typer.Argument(metavar="runs", help="Two to six logs, or folders of runs.")],
    *,
    out: Annotated[Path, out_option("Page to write.")] = Path("compare.html"),
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Put runs side by side: figures, differences of the configuration, paths in one picture.

    Example: `rover-hil compare runs/first runs/second --out compare.html`

    Data: `rover-hil sample runs` writes these runs; of your own, any runs with changes between them.
    """
    if not 2 <= len(paths) <= MOST_RUNS:
        raise ConfigError(f"{len(paths)} run given: give two to {MOST_RUNS}")
    check_inputs(*paths)
    check_file(out, force=force)
    logs = [log_at(path) for path in paths]
    with show_steps(f"reading {len(logs)} runs"):
        comparison = compare_runs(logs)
        page = render_comparison(comparison)
    write_file(out, page)
    cut_off = [run.name for run in comparison.runs if not run.data.is_complete]
    console = Terminal(soft_wrap=True)
    if as_json:
        tables = {
            name: {row.name: row.values for row in rows}
            for name, rows in (("figures", comparison.figures), ("settings", comparison.settings))
        }
        print_json({"runs": [run.name for run in comparison.runs], "cut_off": cut_off, **tables})
    else:
        count = len(comparison.settings)
        differences = f"{count} difference{'' if count == 1 else 's'} of the configuration"
        console.print(f"{len(logs)} runs, {differences}: {out}")
        for name in cut_off:
            console.print(f"the log of {name} was cut off; everything up to the cut is compared")
    return EXIT_OK
