"""`rover-hil scomp`: slip-compensated odometry of a recorded drive."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from controllers.slip.scomp.parameters import ScompParameters
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import DriveArgument, ForceOption, JsonOption, out_option
from rover_hil.console.steps import show_progress
from rover_hil.pages.atomic_write import check_file, write_file
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.scomp.files import ReadDrive, read_drive, read_parameters, track_text
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
    replayed = None if log.suffix != ".mcap" else _replay(LogReader(log), given, online=online)
    result, notes = replayed or _by_columns(log, given, online=online)
    write_file(out, track_text(result.track))
    notes += result.notes
    summary = summary_of(result)
    if as_json:
        print_json({**summary, "notes": notes, "out": str(out)})
    else:
        _print(summary, notes)
    return EXIT_OK


def _replay(
    log: LogReader, given: ScompParameters | None, *, online: bool
) -> tuple[Result, list[str]] | None:
    """Return the path of a log by the estimator that drove, and notes; None where that was without sComp."""
    with restore_config(log) as logged:
        if logged.scomp is None:
            return None
        config, notes = logged, []
        if given is None:
            notes.append("no --params: those of [scomp] and [filter] in the log are used")
        else:
            scomp = logged.scomp.model_copy(update={"parameters": given})
            config = logged.model_copy(update={"scomp": scomp, "filter": sensor_noise(given)})
        with show_progress() as progress:
            task = progress.add_task("replaying", total=log.path.stat().st_size)
            update = partial(progress.update, task)
            result = replay_track(log, config, lambda: update(completed=log.bytes_read), online=online)
        return result, notes


def _by_columns(log: Path, given: ScompParameters | None, *, online: bool) -> tuple[Result, list[str]]:
    """Return the path of a table, or of a log without sComp, by its columns; and notes."""
    source = read_drive(log)
    notes = list(source.notes)
    parameters = given
    if parameters is None:
        parameters, note = _parameters_of(source)
        notes.append(f"no --params: {note}")
    with show_progress() as progress:
        task = progress.add_task("estimating", total=len(source.drive.t_s))
        result = estimate_track(
            source.drive,
            parameters,
            lambda rows: progress.update(task, completed=rows),
            online=online,
        )
    return result, notes


def _parameters_of(source: ReadDrive) -> tuple[ScompParameters, str]:
    """Return the parameters for a drive without any given, and what they are."""
    parameters = ScompParameters()
    if source.rover is not None:
        parameters = parameters.model_copy(update={"rover": source.rover})
    return parameters, "lunar soil simulant and the rover of the paper are assumed"


def _print(summary: Mapping[str, float], notes: Sequence[str]) -> None:
    console = Terminal()
    console.print(
        f"end x {summary['x_m']:.3f} m, y {summary['y_m']:.3f} m, sigma {summary['sigma_x_m']:.3f} and "
        f"{summary['sigma_y_m']:.3f} m; distance {summary['way_m']:.2f} m; "
        f"mean slip {summary['mean_slip']:.3f}"
    )
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)
