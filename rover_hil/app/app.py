"""The `rover-hil` command: the list of all commands and where they stand, and how the program ends.

A new command is a function in its own room and a line here.
"""

import os
import sys
from importlib.metadata import version
from typing import Annotated, NoReturn

import typer

from drivers.errors import RoverHilError
from rover_hil.app.arguments import understood
from rover_hil.app.lazy_group import MARKUP, ROOT, Entries, LazyGroup, Place, Room
from rover_hil.console.error_message import check_name_lengths, readable
from rover_hil.console.exit_codes import EXIT_BAD_INPUT
from rover_hil.console.memory import prepare_linear_algebra, require_loading_memory, sentence_of
from rover_hil.console.output import end_output, open_missing_streams, output_problem, tell

GAP = "rover_hil.gap.command.commands"
SOLVE = "rover_hil.terrain.commands.solve"
COMMANDS: Entries = {
    "run": Place("rover_hil.drive.run", "run_rover"),
    "simulate": Place("rover_hil.drive.simulate", "simulate"),
    "replay": Place("rover_hil.drive.replay", "replay_log"),
    "sample": Place("rover_hil.sample.command", "sample"),
    "diagnose": Place("rover_hil.diagnose.command", "diagnose_drives"),
    "compare": Place("rover_hil.report.compare.command", "compare_logs"),
    "export": Place("rover_hil.exporting.command", "export_log"),
    "init": Place("rover_hil.ready.set_up.command", "init"),
    "check": Place("rover_hil.ready.check", "check_config"),
    "commission": Place("rover_hil.ready.commission.procedure", "commission"),
    "bench": Place("rover_hil.bench.command", "serve_bench"),
    "doctor": Place("rover_hil.ready.doctor", "examine"),
    "tune": Room(
        "Search for better gains or filter noise, and compare with the old; `gains` may be left out.",
        {
            "gains": Place("rover_hil.tune.command", "tune"),
            "logs": Place("rover_hil.tune.logs.command", "tune_by_logs"),
        },
        has_default=True,
    ),
    "scomp": Place("rover_hil.scomp.command", "run_scomp"),
    "ftrace": Place("rover_hil.ftrace.command", "trace_angles"),
    "ground": Place("rover_hil.ground.command", "ground_motion"),
    "gap": Room(
        "Find where a simulation and measured runs disagree; `find` may be left out.",
        {
            "find": Place(GAP, "gap_find"),
            "rover": Place(GAP, "gap_rover"),
            "check": Place(GAP, "gap_check"),
        },
        has_default=True,
    ),
    "terrain": Room(
        "Wheels and rovers on soil: forces, slopes, soil numbers.",
        {
            **{name: Place(SOLVE, name) for name in ("wheel", "traverse", "climb", "papers")},
            "fit": Place("rover_hil.terrain.commands.fit", "fit"),
        },
    ),
    "identify": Room(
        "Fit models from logs or measured data.",
        {
            name: Place(f"rover_hil.identify.{name}.command", f"identify_{name}")
            for name in ("slip", "motor", "scomp")
        },
    ),
    "calibrate": Room(
        "Calibrate sensors.",
        {
            path.parent.name: Place(f"rover_hil.ready.{path.parent.name}.calibration", "calibrate")
            for path in sorted(ROOT.glob("rover_hil/ready/*/calibration.py"))
        },
    ),
    "import": Room(
        "Turn measured data of others into logs.",
        {
            "robotino": Place("rover_hil.drives.formats.command", "import_run"),
            "rosbag": Place("rover_hil.drives.formats.rosbag.command", "import_bag"),
            "can": Place("rover_hil.drives.formats.can.command", "import_can_logs"),
            "table": Place("rover_hil.drives.formats.table.command", "import_tables"),
        },
    ),
}
LIGHT = ("compare", "export", "sample", "terrain")
"""Commands that do not load what a drive needs."""


class Program(LazyGroup):
    """All commands."""

    entries = COMMANDS


app = typer.Typer(
    help="Drive a slipping rover and know where it really is.",
    cls=Program,
    pretty_exceptions_enable=False,
    rich_markup_mode=MARKUP,
)


def _print_version(is_wanted: bool) -> None:
    if is_wanted:
        typer.echo(f"rover-hil {version('rover-hil')}")
        raise typer.Exit


@app.callback()
def common(
    context: typer.Context,
    show_version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Drive a slipping rover and know where it really is."""
    if context.invoked_subcommand not in LIGHT:
        require_loading_memory()
    prepare_linear_algebra()


def main() -> None:
    """Run the command line; our own errors become one sentence and exit code 2.

    So do an output that cannot be written, and too little memory.
    """
    # Our matrices are small: more threads of numpy's linear algebra only spin, and take the loop's processor.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    open_missing_streams()
    try:
        check_name_lengths(sys.argv[1:])
        app(understood(sys.argv[1:]), prog_name="rover-hil")
    except SystemExit:
        if problem := end_output():
            _end(problem)
        raise
    except RoverHilError as error:
        _end(str(error))
    except Exception as error:
        if problem := output_problem(error) or sentence_of(error):
            _end(problem)
        raise


def _end(problem: str) -> NoReturn:
    tell(readable(f"rover-hil: {problem}"))
    sys.exit(EXIT_BAD_INPUT)
