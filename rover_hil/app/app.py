"""The `rover-hil` command: arguments, help and exit codes; each command's work is in its own module.

Heavy modules are imported inside the commands, so that `--help` answers at once.
"""

import os
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from drivers.errors import ConfigError, RoverHilError
from rover_hil.app.error_message import check_name_lengths, readable
from rover_hil.app.gap.commands import gap_app
from rover_hil.app.identify.commands import identify_app
from rover_hil.app.memory import prepare_linear_algebra, require_loading_memory, sentence_of
from rover_hil.app.terrain.commands import terrain_app
from rover_hil.console.exit_codes import EXIT_BAD_INPUT
from rover_hil.console.options import (
    LIVE_PORT,
    LONGEST_S,
    ClusterOption,
    ConfigArgument,
    DriveOption,
    ForceOption,
    Group,
    JsonOption,
    LiveOption,
    LivePortOption,
    number_option,
    out_option,
)
from rover_hil.console.output import end_output, open_missing_streams, output_problem, tell
from rover_hil.ready.commands import calibrate_app
from rover_hil.run.end_signals import held_signals

app = typer.Typer(
    help="Drive a slipping rover and know where it really is.",
    cls=Group,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)

PlantModelOption = Annotated[
    Path | None,
    typer.Option("--model", help="Give the simulated Robotino the effects in this model.toml of `gap`."),
]


def _print_version(is_wanted: bool) -> None:
    if is_wanted:
        typer.echo(f"rover-hil {version('rover-hil')}")
        raise typer.Exit


LIGHT = ("compare", "export", "sample", "terrain")
"""Commands that do not load what a drive needs."""


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


@app.command()
def run(
    config: ConfigArgument,
    virtual: Annotated[
        bool,
        typer.Option(
            "--virtual",
            help="Drive the embedded simulated rover, in step with simulated time: no watchdog is needed.",
        ),
    ] = False,
    duration: Annotated[
        float | None,
        number_option("End after this many seconds instead of with the mission.", "s", 0.1, LONGEST_S),
    ] = None,
    out: Annotated[
        Path | None, out_option("Folder for log, summary and report [default: runs/NAME-DATE].")
    ] = None,
    realtime: Annotated[
        bool,
        typer.Option(
            "--realtime",
            help="Use the SCHED_FIFO scheduler; needs the right to. With --virtual: simulated time passes "
            "like real time, so that other programs can take part.",
        ),
    ] = False,
    model: PlantModelOption = None,
    live: LiveOption = False,
    live_port: LivePortOption = LIVE_PORT,
    odometry_to: Annotated[
        str | None,
        typer.Option(
            "--odometry-to",
            metavar="HOST:PORT",
            help="Send pose, velocity and state of each cycle there, as a line of JSON over UDP.",
        ),
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Run the loop, on real devices or on the simulated rover, and write log, summary and report.

    Exit code 1: the rover could not finish the mission, or drive until you or --duration ended the run.

    Example: `rover-hil run robotino --virtual`
    """
    with held_signals():
        from rover_hil.app.run import run_rover

    sys.exit(
        run_rover(
            config,
            virtual=virtual,
            duration_s=duration,
            out=out,
            realtime=realtime,
            force=force,
            as_json=json,
            model=model,
            live_port=live_port if live else None,
            odometry_to=odometry_to,
        )
    )


@app.command()
def simulate(
    config: ConfigArgument,
    duration: Annotated[
        float | None, number_option("End after this many seconds.", "s", 0.1, LONGEST_S)
    ] = None,
    model: PlantModelOption = None,
) -> None:
    """Serve the simulated rover on the ports that the configuration names, until ctrl-C.

    Example: `rover-hil simulate robotino`, and in another terminal `rover-hil run robotino`
    """
    with held_signals():
        from rover_hil.app.simulate import simulate as simulate_rover

    sys.exit(simulate_rover(config, duration, model))


@app.command()
def replay(
    log: Annotated[Path, typer.Argument(help="A log written by `run` or `import`, or the folder of a run.")],
    config: Annotated[
        str | None,
        typer.Option(
            help="Replay with rover, filter, limits, safety, slip and mission of this configuration."
        ),
    ] = None,
    out: Annotated[
        Path | None, out_option("Also write summary and report of the recorded run into this folder.")
    ] = None,
    live: LiveOption = False,
    live_port: LivePortOption = LIVE_PORT,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Run a log again and compare every output.

    Exit code 1: something came out different; the fields are listed.

    Example: `rover-hil replay runs/first/run.mcap`

    Data: `rover-hil sample runs` writes such a log; a whole run is
    `rover-hil run robotino --virtual --out runs/first`.
    """
    with held_signals():
        from rover_hil.app.replay import replay_log

    sys.exit(
        replay_log(
            log,
            config_name=config,
            out=out,
            force=force,
            as_json=json,
            live_port=live_port if live else None,
        )
    )


@app.command()
def sample(
    name: Annotated[str | None, typer.Argument(help="The sample; without it, their list.")] = None,
    out: Annotated[Path, out_option("Folder to write into.")] = Path(),
    force: ForceOption = False,
) -> None:
    """Write small data for the examples, made by the simulators of this program, or list the samples.

    The examples of README and `--help` name the sample that they need.

    Example: `rover-hil sample runs`
    """
    with held_signals():
        from rover_hil.app.sample.command import list_samples, write_sample

    sys.exit(list_samples() if name is None else write_sample(name, out=out, force=force))


@app.command()
def compare(
    runs: Annotated[list[Path], typer.Argument(help="Two to six logs, or folders of runs.")],
    out: Annotated[Path, out_option("Page to write.")] = Path("compare.html"),
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Put runs side by side: figures, differences of the configuration, paths in one picture.

    Example: `rover-hil compare runs/first runs/second --out compare.html`

    Data: `rover-hil sample runs` writes these runs; of your own, any runs with changes between them.
    """
    with held_signals():
        from rover_hil.app.compare import compare_logs

    sys.exit(compare_logs(runs, out=out, force=force, as_json=json))


@app.command()
def export(
    log: Annotated[Path, typer.Argument(help="A log written by `run` or `import`, or the folder of a run.")],
    csv: Annotated[bool, typer.Option("--csv", help="Tables as CSV files.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Tables as Parquet files.")] = False,
    rosbag2: Annotated[bool, typer.Option("--rosbag2", help="A ROS 2 bag.")] = False,
    can: Annotated[
        bool, typer.Option("--can", help="Frames of its CAN buses; --out ends in .log, .asc, .blf or .trc.")
    ] = False,
    out: Annotated[
        Path | None,
        out_option("Folder to write [default: LOG_FORMAT]; a file with --can."),
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Write a log for other programs: tables with units in the names of columns, a ROS 2 bag, CAN frames.

    Example: `rover-hil export runs/first/run.mcap --csv`

    Data: `rover-hil sample runs` writes such a log; a whole run is
    `rover-hil run robotino --virtual --out runs/first`.
    """
    with held_signals():
        from rover_hil.app.export import export_log

    wanted = {"csv": csv, "parquet": parquet, "rosbag2": rosbag2, "can": can}
    formats = [name for name, is_wanted in wanted.items() if is_wanted]
    sys.exit(export_log(log, formats=formats, out=out, force=force, as_json=json))


@app.command()
def init(
    out: Annotated[Path, typer.Argument(help="The configuration to write, TOML.")],
    dbc: Annotated[Path | None, typer.Option(help="DBC file of the drives on the CAN bus.")] = None,
    can: Annotated[
        Path | None,
        typer.Option(help="Log of the CAN bus while the rover drove, in place of connected devices."),
    ] = None,
    ports: Annotated[
        Path | None,
        typer.Option(help="Also look into this folder, e.g. the `ports` that `rover-hil simulate` serves."),
    ] = None,
    drive: Annotated[
        bool,
        typer.Option("--drive", help="Let answers that do not come from a terminal, too, turn the wheels."),
    ] = False,
    force: ForceOption = False,
) -> None:
    """Set a rover up: find its devices, ask what cannot be found, write a configuration.

    Looks at serial ports, CAN interfaces and cameras, listens to what they send, and proposes devices and
    settings. After an explicit question (wheels lifted) it turns each wheel a little, to find order and
    sign. Answers come from the standard input. Exit code 1: no drive was found, or the configuration has
    mistakes.

    Example: `rover-hil init my_rover.toml`

    Data: the devices of your rover, connected; docs/how-to/set_a_rover_up.md shows it with emulated ones.
    """
    with held_signals():
        from rover_hil.app.init import init as set_up

    sys.exit(set_up(out, ports=ports, can=can, dbc=dbc, may_drive=drive, force=force))


@app.command()
def check(
    config: ConfigArgument,
    schema: Annotated[
        Path | None,
        typer.Option(help="Also write the JSON schema of configurations to this file, for your editor."),
    ] = None,
    preview: Annotated[
        Path | None, typer.Option(help="Also write a page with the picture of the mission to this file.")
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Check a configuration: print every mistake at once, or which commands it is ready for.

    No port is opened; `doctor` also checks the devices. Exit code 1: the configuration has mistakes.

    Example: `rover-hil check robotino`
    """
    with held_signals():
        from rover_hil.app.check import check_config

    sys.exit(check_config(config, schema=schema, preview=preview, force=force, as_json=json))


@app.command()
def commission(
    config: ConfigArgument,
    out: Annotated[Path, out_option("Folder for logs, marks and report.")] = Path("commissioning"),
    virtual: Annotated[bool, typer.Option("--virtual", help="Drive the simulated rover.")] = False,
    drive: DriveOption = False,
    side: Annotated[
        float, number_option("Side of the squares, length of the line, m.", "m", 0.4, 20.0)
    ] = 1.0,
    laps: Annotated[int, number_option("Squares in each sense.", "squares", 1, 20)] = 3,
    tape_sd: Annotated[
        float, number_option("Accuracy of a measured position, standard deviation, m.", "m", 0.0005, 0.5)
    ] = 0.005,
    again: Annotated[
        bool, typer.Option("--again", help="Drive nothing: use the logs and marks in the folder.")
    ] = False,
    enter: Annotated[
        bool,
        typer.Option("--enter", help="Allow the yaw excitation in the configuration, where it has passed."),
    ] = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Find out what odometry, slip estimator and covariance are worth on a ground, without a camera.

    The rover drives a line and closed squares in both senses, and stops at marks that you measure by hand.
    After each drive the command asks for them. Exit code 1: the slip estimator did not pass; the report says
    why.

    Example: `rover-hil commission robotino --virtual`

    Data: your rover, chalk and a tape measure; docs/how-to/commission_a_rover.md.
    """
    with held_signals():
        from rover_hil.ready.commission.procedure import Plan
        from rover_hil.ready.commission.procedure import commission as commission_rover

    plan = Plan(side_m=side, laps=laps, tape_sd_m=tape_sd)
    sys.exit(
        commission_rover(
            config,
            plan=plan,
            virtual=virtual,
            drive=drive,
            again=again,
            enter=enter,
            out=out,
            as_json=json,
            force=force,
        )
    )


@app.command()
def bench(
    config: ConfigArgument,
    port: Annotated[int, number_option("Port of the page; 0 for any free one.", "", 0, 65535)] = 8484,
    out: Annotated[Path, out_option("Folder of the runs.")] = Path("runs"),
) -> None:
    """Serve a page to start and stop runs, look at them, drive by hand and move gains, until ctrl-C.

    Only browsers on this computer reach it; docs/how-to/use_the_bench.md shows how over ssh.

    Example: `rover-hil bench robotino`, then open `http://localhost:8484` in a browser
    """
    with held_signals():
        from rover_hil.app.bench import serve_bench

    sys.exit(serve_bench(config, port, out))


@app.command()
def doctor(config: ConfigArgument, json: JsonOption = False) -> None:
    """Check devices, permissions, rates, clocks and calibration; print cause and fix.

    Exit code 1: something needs a fix.

    Example: `rover-hil doctor robotino`
    """
    with held_signals():
        from rover_hil.app.doctor import examine

    sys.exit(examine(config, as_json=json))


@app.command()
def tune(
    config: ConfigArgument,
    study: Annotated[str, typer.Option(help="Name of the study; an existing one is continued.")],
    logs: Annotated[
        list[Path] | None,
        typer.Option(help="Tune filter noise by replay of these logs, without simulation.", metavar="LOG..."),
    ] = None,
    held_out: Annotated[
        list[Path] | None,
        typer.Option(
            help="Compare on these logs [default: every third of --logs, not searched].", metavar="LOG..."
        ),
    ] = None,
    trials: Annotated[int, number_option("Trials in all, earlier sessions included.", "trials", 1, 1e6)] = 60,
    minutes: Annotated[
        float | None, number_option("End the search after this time.", "min", 0.01, 1e5)
    ] = None,
    out: Annotated[Path | None, out_option("Folder of the study [default: tuning/STUDY].")] = None,
    cluster: ClusterOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Search for better gains on the simulated rover, or for filter noise in logs; compare with the old.

    The comparison is on sites or logs that the search did not use. Exit code 1: no values were acceptable,
    the old ones included.

    Example: `rover-hil tune my_rover.toml --study gains`

    Data: `rover-hil sample rover` writes this configuration; yours needs `[tune]`;
    docs/how-to/bench_tuning.md. For logs `rover-hil sample noise`; docs/how-to/tune_from_logs.md.
    """
    if logs is not None or held_out is not None:
        with held_signals():
            from rover_hil.app.tune_logs import tune_by_logs

        sys.exit(
            tune_by_logs(
                config,
                logs=logs or [],
                held_out=held_out or [],
                study=study,
                trials=trials,
                minutes=minutes,
                out=out,
                force=force,
                as_json=json,
                cluster=cluster,
            )
        )
    with held_signals():
        from rover_hil.app.tune import tune as tune_rover

    sys.exit(
        tune_rover(
            config,
            study=study,
            trials=trials,
            minutes=minutes,
            out=out,
            force=force,
            as_json=json,
            cluster=cluster,
        )
    )


@app.command()
def scomp(
    log: Annotated[
        Path, typer.Argument(help="A log written by `run`, or a CSV file; see docs/reference/scomp_files.md.")
    ],
    out: Annotated[Path, out_option("Write the path to this CSV file.")],
    params: Annotated[Path | None, typer.Option(help="Parameters by `identify scomp`.")] = None,
    online: Annotated[
        bool, typer.Option("--online", help="Each row as the rover knew it then, not by the whole drive.")
    ] = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Estimate the path of a slipping rover: slip-compensated odometry of a recorded drive.

    Example: `rover-hil scomp runs/sand/run.mcap --out path.csv`

    Data: `rover-hil sample sand` writes such a log; a whole run is
    `rover-hil run el-dorado --virtual --out runs/sand`.
    """
    with held_signals():
        from rover_hil.app.scomp import run_scomp

    sys.exit(run_scomp(log, params=params, out=out, online=online, force=force, as_json=json))


@app.command()
def ftrace(
    frames: Annotated[
        Path,
        typer.Argument(help="A folder of pictures, a video, or a log of a rover with a rear camera (.mcap)."),
    ],
    out: Annotated[Path, out_option("CSV file to write: one row per frame.")],
    rig: Annotated[
        Path | None,
        typer.Option(help="Rig file, JSON, schema rear-camera-rig/1; a log holds that of its configuration."),
    ] = None,
    telemetry: Annotated[
        Path | None,
        typer.Option(
            help="CSV file: frame, t, wheel speed, compass, gyro; see docs/reference/ftrace_files.md. A log "
            "holds its own."
        ),
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(help="Also draw the trace: a video (.mp4, .avi) or a folder.")
    ] = None,
    method: Annotated[
        str,
        typer.Option(help="`fused`, the best one, or `hough`, the paper's.", metavar="[fused|hough]"),
    ] = "fused",
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Measure the slip angle from the trace that a rear wheel leaves, seen by a rearward camera.

    Example: `rover-hil ftrace frames/ --rig rig.json --telemetry telemetry.csv --out angles.csv`, or of a
    log: `rover-hil ftrace runs/sand/run.mcap --out angles.csv`

    Data: `rover-hil sample frames` writes the files, `rover-hil sample sand` the log; of your own:
    docs/how-to/measure_a_wheel_trace.md.
    """
    with held_signals():
        from rover_hil.app.ftrace import trace_angles

    sys.exit(
        trace_angles(
            frames,
            rig_path=rig,
            telemetry_path=telemetry,
            out=out,
            overlay=overlay,
            method=method,
            force=force,
            as_json=json,
        )
    )


app.add_typer(gap_app, name="gap")
app.add_typer(terrain_app, name="terrain")

app.add_typer(identify_app, name="identify")
app.add_typer(calibrate_app, name="calibrate")

import_app = typer.Typer(cls=Group, help="Turn measured data of others into logs.")
app.add_typer(import_app, name="import")


@import_app.command("robotino")
def import_robotino(
    file: Annotated[Path, typer.Argument(help="A measured run, .csv or .csv.gz.")],
    out: Annotated[Path, out_option("The log to write.")],
    millimetres_per_pixel: Annotated[
        float, typer.Option(help="Scale of the overhead camera; the data set's own file states 1.84.")
    ] = 1.84,
    config: Annotated[str, typer.Option(help="The rover it was measured on.")] = "robotino",
    force: ForceOption = False,
) -> None:
    """Turn a measured Robotino run into a log, through the board's own byte frames.

    Example: `rover-hil import robotino exp00.csv -o exp00.mcap`

    Data: `rover-hil sample robotino` writes a simulated drive in this format; measured ones are in
    github.com/BrOleg5/research-wheel-slippage, `datasets/one_surface_type/gray_surface`.
    """
    with held_signals():
        from rover_hil.app.import_robotino import import_run

    sys.exit(
        import_run(
            file, out=out, millimetres_per_pixel=millimetres_per_pixel, config_name=config, force=force
        )
    )


@import_app.command("rosbag")
def import_rosbag(
    bag: Annotated[
        Path, typer.Argument(help="A bag of ROS 1 (.bag) or ROS 2 (a folder, .mcap, .db3) of any rover.")
    ],
    topics: Annotated[Path, typer.Option(help="TOML file: which topic holds what.")],
    out: Annotated[Path, out_option("The log to write.")],
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Turn a bag of ROS 1 or ROS 2 into a log, which replays exactly.

    Wheels or odometry, angular rates, currents, true poses and compressed pictures are used.

    Example: `rover-hil import rosbag first_rosbag2 --topics topics.toml --out first.mcap`

    Data: `rover-hil sample bag` writes the bag and the file of topics; for yours,
    docs/how-to/import_a_bag.md names the keys.
    """
    with held_signals():
        from rover_hil.app.import_rosbag import import_bag

    sys.exit(import_bag(bag, topics_path=topics, out=out, force=force, as_json=json))


@import_app.command("can")
def import_can(
    logs: Annotated[
        list[Path],
        typer.Argument(
            help="Logs of a CAN bus, one per drive: .log of candump, .asc, .blf, .trc, .csv, .mf4."
        ),
    ],
    config: Annotated[
        str | None,
        typer.Option(help="Configuration of the rover; with --map its [rover] and [limits] are enough."),
    ] = None,
    mapping: Annotated[
        Path | None,
        typer.Option("--map", help="Mapping of the wheels: which signal is what."),
    ] = None,
    dbc: Annotated[
        list[Path] | None, typer.Option(help="With --list: a DBC file; may be given several times.")
    ] = None,
    channel: Annotated[str | None, typer.Option(help="The bus to use, where a log holds several.")] = None,
    list_only: Annotated[
        bool, typer.Option("--list", help="Only print identifiers, rates and decoded signals.")
    ] = False,
    out: Annotated[
        Path | None, out_option("The log to write; for several logs the folder of theirs.")
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Turn logs of a CAN bus into logs of a rover; the drivers decode its frames, and replay bit for bit.

    Example: `rover-hil import can drive.log --config el-dorado --out drive.mcap`

    Data: `rover-hil sample can` writes such a log; for yours, docs/how-to/import_a_can_log.md shows mapping
    and DBC file.
    """
    with held_signals():
        from rover_hil.app.import_can import import_can_logs, list_can_logs

    if list_only:
        sys.exit(
            list_can_logs(
                logs, config_name=config, mapping=mapping, dbc=dbc or (), channel=channel, as_json=json
            )
        )
    sys.exit(
        import_can_logs(
            logs, config_name=config, mapping=mapping, channel=channel, out=out, force=force, as_json=json
        )
    )


@import_app.command("table")
def import_table(
    files: Annotated[
        list[Path],
        typer.Argument(help="Tables, one per drive: .csv or other text, .gz, .npy, .npz, .mat, .parquet."),
    ],
    columns: Annotated[Path | None, typer.Option(help="TOML file: which column holds what.")] = None,
    out: Annotated[
        Path | None, out_option("The log to write; for several tables the folder of their logs.")
    ] = None,
    propose: Annotated[
        Path | None,
        typer.Option(help="Write to this file what the columns of the first table may hold, to be edited."),
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Turn tables into logs, which replay exactly: all of them, or none where one is wrong.

    Wheels, increments of distance and yaw, steering, angular rate, currents and true poses are used.

    Example: `rover-hil import table table.csv --columns columns.toml --out table.mcap`

    Data: `rover-hil sample table` writes the table and the file of columns; for yours,
    docs/how-to/import_a_table.md names the keys.
    """
    with held_signals():
        from rover_hil.app.import_table import import_tables, propose_columns

    if propose is not None:
        sys.exit(propose_columns(files[0], out=propose, force=force, as_json=json))
    if columns is None or out is None:
        raise ConfigError(
            "--columns and --out are needed: name the file that says which column holds what, and the log; "
            "--propose columns.toml writes such a file"
        )
    sys.exit(import_tables(files, columns_path=columns, out=out, force=force, as_json=json))


def _spread(arguments: list[str], options: tuple[str, ...]) -> list[str]:
    """Return arguments with `--test A --test B` for `--test A B`, which the library does not parse."""
    spread: list[str] = []
    option = ""
    for argument in arguments:
        if option and not argument.startswith("-") and spread[-1] != option:
            spread.append(option)
        if argument.startswith("-"):
            option = argument if argument in options else ""
        spread.append(argument)
    return spread


def main() -> None:
    """Run the command line; our own errors become one sentence and exit code 2.

    So do an output that cannot be written, and too little memory.
    """
    # Our matrices are small: more threads of numpy's linear algebra only spin, and take the loop's processor.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    open_missing_streams()
    try:
        check_name_lengths(sys.argv[1:])
        app(_spread(sys.argv[1:], ("--test", "--logs", "--held-out")), prog_name="rover-hil")
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
