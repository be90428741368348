"""`rover-hil scomp`: slip-compensated odometry of a recorded drive."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from controllers.slip.scomp.parameters import ScompParameters
from controllers.slip.scomp.settings import ScompSettings
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import DriveArgument, ForceOption, JsonOption, out_option
from rover_hil.console.steps import show_progress
from rover_hil.pages.atomic_write import check_file, write_file
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.scomp.files import geometry_of, read_parameters, read_rows, track_text
from rover_hil.scomp.odometry import Result, estimate_track, sensor_noise
from rover_hil.scomp.replayed import replay_track
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
    given = None if params is None else read_parameters(params)
    if log.suffix == ".mcap":
        result, notes = _replay(LogReader(log), given, online=online)
    else:
        result, notes = _by_columns(log, given, online=online)
    write_file(out, track_text(result.track))
    notes += result.notes
    summary = summary_of(result)
    if as_json:
        print_json({**summary, "notes": notes, "out": str(out)})
    else:
        _print(summary, notes)
    return EXIT_OK


def _replay(log: LogReader, given: ScompParameters | None, *, online: bool) -> tuple[Result, list[str]]:
    """Return the path of a log, replayed with sComp, and notes."""
    with restore_config(log) as logged:
        config, notes, parameters, rover = logged, list[str](), given, geometry_of(logged, log.path)
        if parameters is None and logged.scomp is None:
            parameters = ScompParameters(rover=rover)
            notes.append("no --params: lunar soil simulant is assumed")
        if parameters is None:
            notes.append("no --params: those of [scomp] and [filter] in the log are used")
        else:
            scomp = (logged.scomp or ScompSettings()).model_copy(update={"parameters": parameters})
            config = logged.model_copy(update={"scomp": scomp, "filter": sensor_noise(parameters)})
        with show_progress() as progress:
            task = progress.add_task("replaying", total=log.path.stat().st_size)
            update = partial(progress.update, task)
            result = replay_track(log, config, lambda: update(completed=log.bytes_read), online=online)
        return result, notes


def _by_columns(table: Path, given: ScompParameters | None, *, online: bool) -> tuple[Result, list[str]]:
    """Return the path of a table by its columns, and notes."""
    rows, notes = read_rows(table)
    if given is None:
        notes.append("no --params: lunar soil simulant and the rover of the paper are assumed")
    with show_progress() as progress:
        task = progress.add_task("estimating", total=len(rows.t_s))
        result = estimate_track(
            rows,
            given or ScompParameters(),
            lambda count: progress.update(task, completed=count),
            online=online,
        )
    return result, notes


def _print(summary: Mapping[str, float], notes: Sequence[str]) -> None:
    console = Terminal()
    console.print(
        f"end x {summary['x_m']:.3f} m, y {summary['y_m']:.3f} m, sigma {summary['sigma_x_m']:.3f} and "
        f"{summary['sigma_y_m']:.3f} m; distance {summary['way_m']:.2f} m; "
        f"mean slip {summary['mean_slip']:.3f}"
    )
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)
