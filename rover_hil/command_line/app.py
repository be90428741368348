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

    Exit code 1: the rover could not finish the mission, or drive until you or --duration ended the run.

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
    config: Annotated[
        str | None,
        typer.Option(help="Replay with rover, filter, limits, safety and mission of this configuration."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Also write summary and report of the recorded run into this folder.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Run a log again and compare every output.

    Exit code 1: something came out different; the fields are listed.

    Example: `rover-hil replay runs/first/run.mcap`
    """
    from rover_hil.command_line.replay import replay_log

    sys.exit(replay_log(log, config_name=config, out=out, as_json=json))


@app.command()
def doctor(config: ConfigArgument, json: JsonOption = False) -> None:
    """Check devices, permissions, rates, clocks and calibration; say cause and fix.

    Exit code 1: something needs a fix.

    Example: `rover-hil doctor robotino`
    """
    from rover_hil.command_line.doctor import examine

    sys.exit(examine(config, as_json=json))


@app.command()
def tune(
    config: ConfigArgument,
    study: Annotated[str, typer.Option(help="Name of the study; an existing one is continued.")],
    trials: Annotated[int, typer.Option(min=1, help="Trials in all, earlier sessions included.")] = 60,
    minutes: Annotated[float | None, typer.Option(min=0.01, help="End the search after this time.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the study [default: tuning/STUDY].")] = None,
    json: JsonOption = False,
) -> None:
    """Search for better gains on the simulated rover; compare them with the old on sites not searched.

    Exit code 1: no values were acceptable, the old ones included.

    Example: `rover-hil tune my_rover.toml --study gains`
    """
    from rover_hil.command_line.tune import tune as tune_rover

    sys.exit(tune_rover(config, study=study, trials=trials, minutes=minutes, out=out, as_json=json))


identify_app = typer.Typer(no_args_is_help=True, help="Fit models from logs or measured data.")
app.add_typer(identify_app, name="identify")


@identify_app.command("slip")
def identify_slip(
    train: Annotated[list[Path], typer.Argument(help="Logs, measured CSV files or folders to learn from.")],
    test: Annotated[list[Path] | None, typer.Option(help="Logs, files or folders to test on.")] = None,
    out: Annotated[Path | None, typer.Option(help="Write the best map to this TOML file.")] = None,
    json: JsonOption = False,
) -> None:
    """Fit slip maps, how much each wheel slips for the effort it takes, and compare them.

    Example: `rover-hil identify slip one_surface_type --test two_surface_types --out textiles.toml`
    """
    from rover_hil.command_line.identify_slip import identify_slip as identify

    sys.exit(identify(train, test=test or [], as_json=json, out=out))


@identify_app.command("motor")
def identify_motor(
    logs: Annotated[list[Path], typer.Argument(help="Logs, measured CSV files or folders.")],
    out: Annotated[Path | None, typer.Option(help="Write the parameters to this TOML file.")] = None,
    json: JsonOption = False,
) -> None:
    """Fit motor, friction and speed loop, with intervals, and say what the data cannot determine.

    Exit code 1: nothing was determined.

    Example: `rover-hil identify motor data_for_identification_without_integral.csv.gz`
    """
    from rover_hil.command_line.identify_motor import identify_motor as identify

    sys.exit(identify(logs, out=out, as_json=json))


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


def _spread(arguments: list[str], option: str) -> list[str]:
    """Let `--test A B` stand for `--test A --test B`, which is all that the library understands."""
    spread: list[str] = []
    is_open = False
    for argument in arguments:
        if is_open and not argument.startswith("-") and spread[-1] != option:
            spread.append(option)
        if argument.startswith("-"):
            is_open = argument == option
        spread.append(argument)
    return spread


def main() -> None:
    """Run the command line; our own errors become one sentence and exit code 2."""
    try:
        app(_spread(sys.argv[1:], "--test"))
    except RoverHilError as error:
        print(f"rover-hil: {error}", file=sys.stderr)  # noqa: T201 - the one place that reports errors
        sys.exit(EXIT_BAD_INPUT)
