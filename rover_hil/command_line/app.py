"""The `rover-hil` command: arguments, help and exit codes; each command's work is in its own module.

Heavy modules are imported inside the commands, so that `--help` answers at once.
"""

import sys
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import RoverHilError

EXIT_OK = 0
EXIT_NO = 1
EXIT_BAD_INPUT = 2

app = typer.Typer(
    help="Drive a slipping rover and know where it really is.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)

ConfigArgument = Annotated[
    str, typer.Argument(help="A TOML file, or a shipped configuration: `robotino`, `el-dorado`.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]


@app.command()
def run(
    config: ConfigArgument,
    virtual: Annotated[bool, typer.Option("--virtual", help="Drive the embedded simulated rover.")] = False,
    duration: Annotated[
        float | None, typer.Option(min=0.1, help="End after this many seconds instead of with the mission.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for log, summary and report [default: runs/NAME-DATE].")
    ] = None,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Use the SCHED_FIFO scheduler; needs the right to.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Run the loop, on real devices or on the simulated rover, and write log, summary and report.

    Exit code 1: the mission was not finished.

    Example: `rover-hil run robotino --virtual`
    """
    from rover_hil.command_line.run import run_rover

    sys.exit(
        run_rover(config, virtual=virtual, duration_s=duration, out=out, realtime=realtime, as_json=json)
    )


@app.command()
def simulate(
    config: ConfigArgument,
    duration: Annotated[float | None, typer.Option(min=0.1, help="End after this many seconds.")] = None,
) -> None:
    """Serve the simulated rover on the ports that the configuration names, until ctrl-C.

    Example: `rover-hil simulate robotino`, and in another terminal `rover-hil run robotino`
    """
    from rover_hil.command_line.simulate import simulate as simulate_rover

    sys.exit(simulate_rover(config, duration))


@app.command()
def replay(
    log: Annotated[Path, typer.Argument(help="A log written by `run` or `import`.")],
    out: Annotated[Path | None, typer.Option(help="Also write summary and report into this folder.")] = None,
    json: JsonOption = False,
) -> None:
    """Run a log again and compare every output.

    Exit code 1: something came out different; the fields are listed.

    Example: `rover-hil replay runs/first/run.mcap`
    """
    from rover_hil.command_line.replay import replay_log

    sys.exit(replay_log(log, out=out, as_json=json))


@app.command()
def doctor(config: ConfigArgument, json: JsonOption = False) -> None:
    """Check devices, permissions, rates, clocks and calibration; say cause and fix.

    Exit code 1: something needs a fix.

    Example: `rover-hil doctor robotino`
    """
    from rover_hil.command_line.doctor import examine

    sys.exit(examine(config, as_json=json))


import_app = typer.Typer(no_args_is_help=True, help="Turn measured data of others into logs.")
app.add_typer(import_app, name="import")


@import_app.command("robotino")
def import_robotino(
    file: Annotated[Path, typer.Argument(help="A measured run, .csv or .csv.gz.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The log to write.")],
    millimetres_per_pixel: Annotated[
        float, typer.Option(help="Scale of the overhead camera; the data set's own file says 1.84.")
    ] = 1.84,
    config: Annotated[str, typer.Option(help="The rover it was measured on.")] = "robotino",
) -> None:
    """Turn a measured Robotino run into a log, through the board's own byte frames.

    Example: `rover-hil import robotino exp00.csv.gz -o exp00.mcap`
    """
    from rover_hil.command_line.import_robotino import import_run

    sys.exit(import_run(file, out=out, millimetres_per_pixel=millimetres_per_pixel, config_name=config))


def main() -> None:
    """Run the command line; our own errors become one sentence and exit code 2."""
    try:
        app()
    except RoverHilError as error:
        print(f"rover-hil: {error}", file=sys.stderr)  # noqa: T201 - the one place that reports errors
        sys.exit(EXIT_BAD_INPUT)
