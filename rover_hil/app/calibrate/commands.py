"""`rover-hil calibrate`: arguments, help and exit codes; heavy modules are imported inside the commands."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from drivers.errors import ConfigError
from rover_hil.console.options import (
    ConfigArgument,
    DriveOption,
    ForceOption,
    Group,
    JsonOption,
    number_option,
    out_option,
)
from rover_hil.run.end_signals import held_signals

calibrate_app = typer.Typer(cls=Group, help="Calibrate sensors.")


@calibrate_app.command("camera")
def calibrate_camera(
    source: Annotated[
        str,
        typer.Argument(help="Folder, video or log of the board in many poses; with --scale a configuration."),
    ],
    out: Annotated[
        Path, out_option("Rig file to write, JSON, or TOML with --scale; the page beside it has its name.")
    ],
    ground: Annotated[
        Path | None,
        typer.Option(help="Picture of the board on the ground behind the wheel, or a log: its last frame."),
    ] = None,
    rover: Annotated[
        Path | None, typer.Option(help="JSON with the rig's keys that are not the camera's.")
    ] = None,
    columns: Annotated[
        int | None, number_option("Squares along the board's x axis.", "squares", 3, 100)
    ] = None,
    rows: Annotated[int | None, number_option("Squares along its y axis.", "squares", 3, 100)] = None,
    square: Annotated[float | None, number_option("Side of a square, m.", "m", 0.001, 1.0)] = None,
    ground_x: Annotated[
        float | None,
        number_option("First inner corner on the ground, vehicle frame, m.", "m", -100.0, 100.0),
    ] = None,
    ground_y: Annotated[
        float | None,
        number_option("First inner corner on the ground, vehicle frame, m.", "m", -100.0, 100.0),
    ] = None,
    ground_yaw: Annotated[
        float, number_option("Direction of the board's columns from x, deg.", "deg", -360.0, 360.0)
    ] = 0.0,
    board: Annotated[Literal["chessboard", "charuco"], typer.Option(help="The printed board.")] = "charuco",
    fps: Annotated[float, number_option("Frames per second.", "Hz", 0.01, 1000.0)] = 5.0,
    scale: Annotated[
        bool,
        typer.Option("--scale", help="Find the scale of the travel that [ground_motion] measures instead."),
    ] = False,
    log: Annotated[
        list[Path] | None,
        typer.Option(help="With --scale: use this log of a drive instead of driving; repeat it."),
    ] = None,
    virtual: Annotated[
        bool, typer.Option("--virtual", help="With --scale: drive the simulated rover.")
    ] = False,
    drive: DriveOption = False,
    length: Annotated[float, number_option("With --scale: length of the drive, m.", "m", 1.5, 50.0)] = 3.0,
    enter: Annotated[
        bool, typer.Option("--enter", help="With --scale: enter the values into the configuration.")
    ] = False,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Make the rig file of a rearward camera: lens, and pose above the ground; with --scale its factor.

    The page with the picture is written before the file. Exit code 1: the board fits worse than 1 pixel, or
    the scale is not sure; the file is not written.

    With --scale the travel by the camera is compared with pose fixes, or with the wheels on ground that does
    not slip: height, pitch and focal length act on it as one factor.

    Example: `rover-hil calibrate camera pictures/ --ground ground.png --rover rover.json --out my_rig.json
    --columns 8 --rows 6 --square 0.04 --ground-x -0.72 --ground-y 0.1 --ground-yaw 90`

    Scale: `rover-hil calibrate camera robotino-camera --scale --virtual --out scale.toml`

    Data: `rover-hil sample board` writes these files; for pictures by your camera and rover.json,
    docs/how-to/measure_a_wheel_trace.md describes them; docs/how-to/calibrate_a_ground_camera.md.
    """
    board_options = {
        "--ground": ground,
        "--rover": rover,
        "--columns": columns,
        "--rows": rows,
        "--square": square,
        "--ground-x": ground_x,
        "--ground-y": ground_y,
    }
    if scale:
        given = [name for name, value in board_options.items() if value is not None]
        if given:
            raise ConfigError(f"{', '.join(given)}: of a board; leave them out with --scale")
        with held_signals():
            from rover_hil.app.calibrate.camera_scale import calibrate_scale

        sys.exit(
            calibrate_scale(
                source,
                logs=log or [],
                virtual=virtual,
                drive=drive,
                length_m=length,
                enter=enter,
                out=out,
                as_json=as_json,
                force=force,
            )
        )
    if log or virtual or drive or enter or as_json:
        raise ConfigError("--log, --virtual, --drive, --enter and --json belong to --scale: add it")
    if (
        ground is None
        or rover is None
        or columns is None
        or rows is None
        or square is None
        or ground_x is None
        or ground_y is None
    ):
        missing = [name for name, value in board_options.items() if value is None]
        raise ConfigError(f"pictures of a board need {', '.join(missing)}: give them, or --scale")
    with held_signals():
        from math import radians

        from rover_hil.app.calibrate.camera import calibrate_camera as calibrate
        from rover_hil.ftrace.calibration import Board, GroundTarget

    sys.exit(
        calibrate(
            Path(source),
            ground=ground,
            board=Board(kind=board, columns=columns, rows=rows, square_m=square),
            target=GroundTarget(x_m=ground_x, y_m=ground_y, yaw_rad=radians(ground_yaw)),
            rover=rover,
            fps=fps,
            out=out,
            force=force,
        )
    )


@calibrate_app.command("imu")
def calibrate_imu(
    source: Annotated[str, typer.Argument(help="Configuration whose rover is to turn, or a log (.mcap).")],
    out: Annotated[Path, out_option("File to write, TOML; page and log beside it have its name.")],
    virtual: Annotated[bool, typer.Option("--virtual", help="Turn the simulated rover.")] = False,
    drive: DriveOption = False,
    turns: Annotated[
        int | None,
        number_option("Whole turns in each sense: find mounting, scale and bias instead.", "turns", 1, 50),
    ] = None,
    made: Annotated[
        str | None,
        typer.Option(
            help="Turns really made, in order, counter-clockwise positive, like 3,-3; with --turns."
        ),
    ] = None,
    device: Annotated[
        str | None, typer.Option(help="The sensor, with --turns [default: roles.gyro].")
    ] = None,
    by_hand: Annotated[
        bool, typer.Option("--by-hand", help="With --turns: drive nothing; you turn the rover.")
    ] = False,
    enter: Annotated[
        bool, typer.Option("--enter", help="With --turns: enter the values into the configuration.")
    ] = False,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Identify gain, delay and bandwidth of the gyro; with --turns its mounting, scale and bias.

    The rover turns to and fro for a minute, on firm ground with half a metre of free space. With --turns it
    makes whole turns between rests; a camera or a compass measures them, or you count them. The page with the
    picture is written before the file. Exit code 1: the result is not sure; the file is not written.

    Example: `rover-hil calibrate imu robotino --virtual --out gyro.toml`

    Mounting: `rover-hil calibrate imu robotino --virtual --turns 3 --out mounting.toml`

    Data: a drive of your rover on firm ground, or a log of one; docs/how-to/calibrate_the_gyro.md.
    """
    if turns is not None:
        with held_signals():
            from rover_hil.app.calibrate.mounting import calibrate_mounting

        sys.exit(
            calibrate_mounting(
                source,
                turns=turns,
                made=made,
                device=device,
                virtual=virtual,
                drive=drive,
                by_hand=by_hand,
                enter=enter,
                out=out,
                as_json=as_json,
                force=force,
            )
        )
    if made is not None or device is not None or by_hand or enter:
        raise ConfigError("--made, --device, --by-hand and --enter belong to --turns: add it")
    with held_signals():
        from rover_hil.app.calibrate.imu import calibrate_imu as calibrate

    sys.exit(calibrate(source, virtual=virtual, drive=drive, out=out, as_json=as_json, force=force))


@calibrate_app.command("compass")
def calibrate_compass(
    source: Annotated[str, typer.Argument(help="Configuration whose rover is to turn, or a log (.mcap).")],
    log: Annotated[Path | None, typer.Option(help="Use this log of turns instead of driving.")] = None,
    device: Annotated[str | None, typer.Option(help="The compass, where there are several.")] = None,
    virtual: Annotated[bool, typer.Option("--virtual", help="Turn the simulated rover.")] = False,
    drive: DriveOption = False,
    by_hand: Annotated[
        bool, typer.Option("--by-hand", help="Drive nothing; you turn the rover, or carry the sensor around.")
    ] = False,
    turns: Annotated[int, number_option("Whole turns in each sense.", "turns", 2, 50)] = 3,
    dip: Annotated[
        float | None,
        number_option("Dip of the earth's field at this place, for tilt compensation, deg.", "deg", -85, 85),
    ] = None,
    out: Annotated[
        Path | None,
        out_option(
            "File to write, TOML; page and log beside it have its name [default: CONFIG-DEVICE.toml]."
        ),
    ] = None,
    motors: Annotated[
        bool,
        typer.Option("--motors", help="Find the field of the motor currents instead, in two squares."),
    ] = False,
    side: Annotated[float, number_option("Side of the squares of --motors, m.", "m", 0.3, 50.0)] = 1.0,
    enter: Annotated[
        bool, typer.Option("--enter", help="Enter the file into the configuration; comments stay.")
    ] = False,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Calibrate a compass by whole turns: hard and soft iron, or a deviation table.

    The rover turns on the spot, with all that belongs on it and its motors on. Each turn is judged with a
    calibration that did not see it. The page with the picture is written before the file. Exit code 1: the
    error on held-out turns is above 3 deg, or directions are missing; the file is not written.

    With --motors a calibrated compass is compared with the gyro over the motor currents, on a square to the
    left and one to the right, and the field of each motor per ampere is found; exit code 1 also where the
    motors do not matter.

    Example: `rover-hil calibrate compass el-dorado --virtual --out compass.toml`

    Motors: `rover-hil calibrate compass my_rover.toml --motors --enter`

    Data: turns of your rover, driven or by hand, or a log of them; docs/how-to/calibrate_the_compass.md.
    """
    if motors:
        if by_hand or dip is not None:
            raise ConfigError("--motors drives the rover: leave --by-hand and --dip out")
        with held_signals():
            from rover_hil.app.calibrate.motors import calibrate_motors

        sys.exit(
            calibrate_motors(
                source,
                log=log,
                device=device,
                virtual=virtual,
                drive=drive,
                side_m=side,
                out=out,
                enter=enter,
                as_json=as_json,
                force=force,
            )
        )
    with held_signals():
        from rover_hil.app.calibrate.compass import calibrate_compass as calibrate

    sys.exit(
        calibrate(
            source,
            log=log,
            device=device,
            virtual=virtual,
            drive=drive,
            by_hand=by_hand,
            turns=turns,
            dip_deg=dip,
            out=out,
            enter=enter,
            as_json=as_json,
            force=force,
        )
    )


@calibrate_app.command("wheels")
def calibrate_wheels(
    config: ConfigArgument,
    out: Annotated[Path, out_option("File to write, TOML; page and logs beside it have its name.")],
    line: Annotated[
        list[str] | None,
        typer.Option(help="A straight drive of known distance from start to end, LOG=METRES; repeat it."),
    ] = None,
    spin: Annotated[
        list[str] | None,
        typer.Option(help="Turns on the spot, LOG=TURNS, counter-clockwise positive; repeat it."),
    ] = None,
    virtual: Annotated[bool, typer.Option("--virtual", help="Drive the simulated rover.")] = False,
    drive: DriveOption = False,
    length: Annotated[float, number_option("Length of a straight drive, m.", "m", 0.5, 50.0)] = 2.0,
    turns: Annotated[int, number_option("Turns of a drive on the spot.", "turns", 1, 50)] = 3,
    tape_sd: Annotated[
        float, number_option("Accuracy of a known distance, standard deviation, m.", "m", 0.0001, 1.0)
    ] = 0.005,
    turn_sd: Annotated[
        float, number_option("Accuracy of a known turn, standard deviation, deg.", "deg", 0.01, 45.0)
    ] = 2.0,
    enter: Annotated[
        bool, typer.Option("--enter", help="Enter the values into the configuration; comments stay.")
    ] = False,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Fit radius and base of the wheels to known distances and known turns, with intervals.

    Without --line and --spin the rover drives two lines and turns on the spot in both senses; after each
    drive the command asks for the measured distance, or the turns. The page with the picture is written
    before the file. Exit code 1: a factor is not sure, or implausible; the file is not written.

    Example: `rover-hil calibrate wheels robotino --virtual --out wheels.toml`

    Data: drives of your rover and a tape measure, or logs of such drives;
    docs/how-to/calibrate_the_wheels.md.
    """
    with held_signals():
        from rover_hil.app.calibrate.wheels import calibrate_wheels as calibrate

    sys.exit(
        calibrate(
            config,
            lines=line or [],
            spins=spin or [],
            virtual=virtual,
            drive=drive,
            length_m=length,
            turns=turns,
            tape_sd_m=tape_sd,
            turn_sd_deg=turn_sd,
            out=out,
            enter=enter,
            as_json=as_json,
            force=force,
        )
    )


@calibrate_app.command("time")
def calibrate_time(
    log: Annotated[Path, typer.Argument(help="A log of turns that begin and end.")],
    out: Annotated[
        Path | None,
        out_option("Also write the offsets to this TOML file, and a page with a picture beside it."),
    ] = None,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Find offsets between gyro, wheels, compass and cameras by the turns that they all feel.

    Exit code 1: no offset is sure.

    Example: `rover-hil calibrate time gyro.mcap`, the log of `rover-hil calibrate imu`

    Data: your log of turns to and fro for half a minute; docs/how-to/calibrate_the_times.md.
    """
    with held_signals():
        from rover_hil.app.calibrate.time import calibrate_time as calibrate

    sys.exit(calibrate(log, out=out, as_json=as_json, force=force))
