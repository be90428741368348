"""`rover-hil scomp`: slip-compensated odometry of a recorded drive."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from controllers.estimation.settings import FilterSettings
from controllers.slip.scomp.parameters import ScompParameters
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import DriveArgument, ForceOption, JsonOption, out_option
from rover_hil.console.steps import show_progress
from rover_hil.pages.atomic_write import check_file, write_file
from rover_hil.scomp.files import ReadDrive, read_drive, read_parameters, track_text
from rover_hil.scomp.odometry import estimate_track
from rover_hil.scomp.summary import summary_of
from rover_hil.terminal import Terminal


def run_scomp(
    log: DriveArgument,
    *,
    out: Annotated[Path, out_option("Write the path to this CSV file.")],
    params: Annotated[Path | None, typer.Option(help="Parameters by `identify scomp`.")] = None,
    online: Annotated[
        bool, typer.Option("--online", help="Each row as the rover knew it then, not by the whole drive.")
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Estimate the path of a slipping rover: slip-compensated odometry of a recorded drive.

    Example: `rover-hil scomp runs/sand/run.mcap --out path.csv`

    Data: `rover-hil sample sand` writes such a log; a whole run is
    `rover-hil run el-dorado --virtual --out runs/sand`.
    """
    check_file(out, force=force)
    source = read_drive(log)
    notes = list(source.notes)
    if params is not None:
        parameters, settings = read_parameters(params), None
    else:
        parameters, settings, note = _parameters_of(source)
        notes.append(f"no --params: {note}")
    with show_progress() as progress:
        task = progress.add_task("estimating", total=len(source.drive.t_s))
        result = estimate_track(
            source.drive,
            parameters,
            lambda rows: progress.update(task, completed=rows),
            settings=settings,
            online=online,
        )
    write_file(out, track_text(result.track))
    notes += result.notes
    summary = summary_of(result)
    if as_json:
        print_json({**summary, "notes": notes, "out": str(out)})
    else:
        _print(summary, notes)
    return EXIT_OK


def _parameters_of(source: ReadDrive) -> tuple[ScompParameters, FilterSettings | None, str]:
    """Return the parameters for a drive without any given, the noise of the filter, and what they are."""
    config = None if source.recorded is None else source.recorded.config
    if config is not None and config.scomp is not None:
        return config.scomp.parameters, config.filter, "those of [scomp] and [filter] in the log are used"
    parameters = ScompParameters()
    if source.rover is not None:
        parameters = parameters.model_copy(update={"rover": source.rover})
    return parameters, None, "lunar soil simulant and the rover of the paper are assumed"


def _print(summary: Mapping[str, float], notes: Sequence[str]) -> None:
    console = Terminal()
    console.print(
        f"end x {summary['x_m']:.3f} m, y {summary['y_m']:.3f} m, sigma {summary['sigma_x_m']:.3f} and "
        f"{summary['sigma_y_m']:.3f} m; distance {summary['way_m']:.2f} m; "
        f"mean slip {summary['mean_slip']:.3f}"
    )
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)
