"""`rover-hil calibrate compass CONFIG --motors`: the field of motor currents at a compass."""

import math
from pathlib import Path

from controllers.control_loop import StepOutput
from controllers.motion.settings import WaypointsMission
from drivers.clock import wall_time_ns
from drivers.errors import ConfigError
from rover_hil.app.calibrate.compass import LOG_SUFFIX, turning_config, with_magnetic_frames
from rover_hil.app.calibrate.imu import on_firm_floor
from rover_hil.app.calibrate.results import check_results
from rover_hil.app.room import require_room
from rover_hil.config import Config, load_config, read_config_text, shipped_configs
from rover_hil.config.entry import with_entry
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.steps import show_steps
from rover_hil.datasets.arrays import rms
from rover_hil.datasets.toml_text import toml_text
from rover_hil.doctor.clocks import today
from rover_hil.identify.compass.figures import draw_motor_errors, draw_motor_fields
from rover_hil.identify.compass.motors import MotorFieldFit, fit_motor_fields
from rover_hil.identify.compass.record import compass_of
from rover_hil.pages.atomic_write import write_file
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.run.checks import ROVER_CHECKS, VIRTUAL_RUN_CHECKS
from rover_hil.run.drive_order import DriveOrder
from rover_hil.run.drive_permission import permit_drive
from rover_hil.run.driving import require_finished, run_real, run_virtual
from rover_hil.terminal import Terminal

DEFAULT_SPEED_M_S = 0.15
WAIT_S = 3.0
SPARE_S = 60.0
SLOWNESS = 6.0
"""Longest time of the drive over that of its sides: a skidding rover turns slowly."""


def calibrate_motors(
    source: str,
    *,
    log: Path | None,
    device: str | None,
    virtual: bool,
    drive: bool,
    side_m: float,
    out: Path | None,
    enter: bool,
    as_json: bool,
    force: bool,
) -> int:
    """Find the field of the motors and write it; returns the exit code: 1, and no file, if it is of no use.

    The page with the picture is written first, also where nothing is to be corrected.

    Args:
        source: A configuration, whose rover drives, or a log.
        log: Log of a drive to use instead of driving.
        device: Name of the compass; None where there is only one.
        virtual: Drive the simulated rover.
        drive: Drive the real one without a question.
        side_m: Side of the two squares that are driven, one to the left and one to the right.
        out: File to write; None for a name from configuration and device.
        enter: Enter the file into the configuration.
        as_json: Print JSON instead of text.
        force: Replace earlier files.

    Raises:
        ConfigError: The configuration cannot be used, or a file exists.
        LogError: The log is damaged, or holds no headings, turns or currents.
    """
    if source.endswith(LOG_SUFFIX):
        log = log or Path(source)
    if log is not None and (virtual or drive):
        raise ConfigError(f"{log} is a log: leave --virtual and --drive out")
    checks = VIRTUAL_RUN_CHECKS[-1:] if virtual else ROVER_CHECKS
    config = None if source.endswith(LOG_SUFFIX) else load_config(source, checks)
    if enter and (config is None or source in shipped_configs()):
        raise ConfigError(f"--enter: {source} cannot be edited: name a TOML file of yours")
    if config is not None:
        device, _ = compass_of(config, device)
        out = out or Path(f"{Path(source).stem}-{device}-motors.toml")
    if out is None:
        raise ConfigError("--out is missing: name the file to write")
    log_path = out.with_suffix(LOG_SUFFIX)
    page = check_results(out, () if log is not None else (log_path,), force=force)
    if log is None and config is not None and device is not None:
        order = permit_drive(source, config, virtual=virtual, drive=drive)
        _drive(config, device, log_path, side_m, order)
    with show_steps("fitting"):
        fit = fit_motor_fields(log or log_path, device, today(wall_time_ns()).isoformat())
        write_file(page, _page(fit))
    if not fit.problem:
        write_file(out, toml_text(fit.fields.model_dump(), digits=5))
        if enter:
            write_file(Path(source), with_entry(read_config_text(source), "filter", "motor_fields", str(out)))
    _print(fit, page, out, source if enter else "", as_json=as_json)
    return EXIT_NO if fit.problem else EXIT_OK


def _drive(config: Config, device: str, log_path: Path, side_m: float, order: DriveOrder | None) -> None:
    """Drive a square to the left and one to the right, with a stop at each corner."""
    speed_m_s = DEFAULT_SPEED_M_S if config.mission is None else config.mission.speed_m_s
    corners = [(side_m, 0.0), (side_m, side_m), (0.0, side_m), (0.0, 0.0)]
    mission = WaypointsMission(
        type="waypoints",
        points=(*corners, *((x_m, -y_m) for x_m, y_m in corners)),
        speed_m_s=speed_m_s,
        heading="along_path",
        position_tolerance_m=0.05,
        wait_s=WAIT_S,
    )
    if config.mission is not None:
        gains = config.mission.model_dump(
            include={"heading_gain_per_s", "yaw_rate_limit_rad_s", "lookahead_m"}
        )
        mission = mission.model_copy(update=gains)
    require_room(config, [mission], "lower --side")
    # The calibration of the compass stays: what it leaves is to be explained.
    base = turning_config(config, device, 1)
    devices = {**base.devices, device: config.devices[device]}
    driven = base.model_copy(update={"mission": mission, "devices": devices})
    limit_s = SLOWNESS * 8.0 * side_m / speed_m_s + 8.0 * WAIT_S + SPARE_S
    with show_steps("driving two squares") as step:

        def show(output: StepOutput) -> None:
            pose = output.estimate
            step(f"x {pose.x_m:+.2f} m  y {pose.y_m:+.2f} m  {output.reason}")

        if order is None:
            simulation = with_magnetic_frames(config, device, on_firm_floor(driven.require_simulation()))
            driven = driven.model_copy(update={"simulation": simulation})
            result = run_virtual(driven, log_path, limit_s, show)
        else:
            result = run_real(driven, log_path, limit_s, show, order=order)
    require_finished(result, "the squares")


def _print(fit: MotorFieldFit, page: Path, out: Path, entered: str, *, as_json: bool) -> None:
    if as_json:
        record = {
            "device": fit.fields.device,
            "per_ampere": fit.fields.per_ampere,
            "per_ampere_sd": fit.fields.per_ampere_sd,
            "before_rms_deg": rms(fit.before_deg),
            "rms_deg": rms(fit.after_deg),
            "problem": fit.problem,
            "file": None if fit.problem else str(out),
        }
        print_json(record)
        return
    console = Terminal(soft_wrap=True)
    for name, value in _facts(fit):
        console.print(f"{name}: {value}")
    console.print(f"picture: {page}")
    if fit.problem:
        console.print(f"not written: {fit.problem}")
    elif entered:
        console.print(f"written to {out} and entered into {entered}")
    else:
        console.print(f'written to {out}; in the configuration: [filter] motor_fields = "{out}"')


def _facts(fit: MotorFieldFit) -> tuple[tuple[str, str], ...]:
    facts = [
        ("compass", f"{fit.fields.device}, against the {fit.reference}"),
        ("error without the currents", f"{rms(fit.before_deg):.2f} deg rms"),
        ("error on held-out parts with them", f"{rms(fit.after_deg):.2f} deg rms"),
        ("greatest change of the heading", f"{fit.largest_deg:.1f} deg"),
    ]
    pairs = zip(fit.fields.per_ampere, fit.fields.per_ampere_sd, strict=True)
    for motor, (field, sd) in enumerate(pairs, start=1):
        text = f"{100 * math.hypot(*field):.1f} +- {100 * math.hypot(*sd):.1f} % of the earth's field per A"
        facts.append((f"motor {motor}", text))
    if not fit.separate.all():
        together = ", ".join(str(motor) for motor, own in enumerate(fit.separate, start=1) if not own)
        facts.append(
            (
                "not separated",
                f"motors {together} had no current of their own: the correction holds for such drives",
            )
        )
    return tuple(facts)


def _page(fit: MotorFieldFit) -> str:
    drawings = [
        Drawing(
            "Error of the heading and currents",
            "See whether the error below follows the currents above, and whether it does so no more with the "
            "correction. Each part was corrected with a fit that did not see it.",
            lambda: draw_motor_errors(fit),
        ),
        Drawing(
            "Field of each motor",
            "Share of the earth's horizontal field per ampere, with two standard deviations. A bar as long "
            "as the distance from zero means that the drive did not show this motor.",
            lambda: draw_motor_fields(fit),
        ),
    ]
    return render(
        "identify/report.html",
        grade="attention" if fit.problem else "plain",
        title=f"Motors at the compass: {fit.problem}" if fit.problem else "Motors at the compass: corrected",
        facts=_facts(fit),
        pictures=draw_pictures(drawings),
    )
