"""`rover-hil calibrate compass`: hard and soft iron or deviation, from whole turns."""

import math
from pathlib import Path

from controllers.control_loop import StepOutput
from controllers.motion.kinematics import make_kinematics
from controllers.motion.settings import WaypointsMission, WholeTurnsMission
from drivers.angles import wrap_rad
from drivers.clock import seconds, wall_time_ns
from drivers.device_settings import FrameDeviceSettings
from drivers.errors import ConfigError
from drivers.samples import RateSample, Sample
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.app.calibrate.by_hand import record_by_hand
from rover_hil.app.calibrate.imu import on_firm_floor
from rover_hil.app.calibrate.results import check_results
from rover_hil.app.room import require_room
from rover_hil.config import Config, load_config, read_config_text, shipped_configs
from rover_hil.config.entry import with_entry
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.steps import show_steps
from rover_hil.datasets.toml_text import toml_text
from rover_hil.doctor.clocks import today
from rover_hil.identify.compass.coverage import Coverage
from rover_hil.identify.compass.figures import draw_deviation, draw_errors, draw_field
from rover_hil.identify.compass.fit import CompassFit, fit_compass
from rover_hil.identify.compass.parameters import COMPASS_FIT
from rover_hil.identify.compass.record import CompassRecord, CompassSettings, compass_of, read_record
from rover_hil.pages.atomic_write import write_file
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.run.checks import ROVER_CHECKS, VIRTUAL_RUN_CHECKS
from rover_hil.run.drive_order import DriveOrder
from rover_hil.run.drive_permission import permit_drive
from rover_hil.run.driving import require_uninterrupted, run_real, run_virtual
from rover_hil.terminal import Terminal
from sim_backends.devices.witmotion import ImuEmulatorSettings
from sim_backends.settings import SimulationSettings

LOG_SUFFIX = ".mcap"
SPARE_S = 30.0
"""In addition to the turns: settling, rests, stops."""
SLOWEST_BY_HAND_S = 120.0
"""Longest time of a turn by hand."""
TURN_RATE_RAD_S = 0.6
LIMIT_SHARE = 0.6
"""Of the greatest wheel speed."""
SKID_FACTOR = 4.0
CORNERS = 12
"""Of the ring that a rover drives which cannot turn on the spot."""


def calibrate_compass(
    source: str,
    *,
    log: Path | None,
    device: str | None,
    virtual: bool,
    drive: bool,
    by_hand: bool,
    turns: int,
    dip_deg: float | None,
    out: Path | None,
    enter: bool,
    as_json: bool,
    force: bool,
) -> int:
    """Calibrate a compass and write the result; returns the exit code: 1, and no file, if it is not good.

    The page with the picture is written first, also where the result is not good enough.

    Args:
        source: A configuration, whose rover turns, or a log.
        log: Log of turns to use instead of driving.
        device: Name of the compass; None where there is only one.
        virtual: Turn the simulated rover.
        drive: Turn the real one by its wheels, without a question.
        by_hand: Drive nothing: the user turns the rover or the sensor.
        turns: Whole turns in each sense.
        dip_deg: Angle of the earth's field below the horizontal, or None.
        out: File to write; None for that of the configuration, else a name from configuration and device.
        enter: Enter the file into the configuration.
        as_json: Print JSON instead of text.
        force: Replace earlier files.

    Raises:
        ConfigError: The configuration cannot be used, or a file exists.
        LogError: The log is damaged or holds no turns of the compass.
    """
    if source.endswith(LOG_SUFFIX):
        log = log or Path(source)
    _check_options(source, log, virtual=virtual, drive=drive, by_hand=by_hand)
    config = None if source.endswith(LOG_SUFFIX) else load_config(source, ROVER_CHECKS)
    if enter and (config is None or source in shipped_configs()):
        raise ConfigError(f"--enter: {source} cannot be edited: name a TOML file of yours")
    if config is not None:
        device, _ = compass_of(config, device)
        present = getattr(config.devices[device], "calibration", None)
        out = out or Path(present or f"{Path(source).stem}-{device}.toml")
    if out is None:
        raise ConfigError("--out is missing: name the file to write")
    log_path = out.with_suffix(LOG_SUFFIX)
    page = check_results(out, () if log is not None else (log_path,), force=force)
    if log is None and config is not None and device is not None:
        if by_hand:
            _record_by_hand(config, device, log_path, turns)
        else:
            order = permit_drive(source, config, virtual=virtual, drive=drive)
            _record(config, device, log_path, turns, order)
    log = log or log_path
    with show_steps("fitting"):
        record = read_record(log, device)
        fit = fit_compass(record, today(wall_time_ns()), dip_deg)
        write_file(page, _page(record, fit))
    if not fit.problem and fit.calibration is not None:
        write_file(out, toml_text(fit.calibration.model_dump(), digits=6))
        if enter:
            write_file(
                Path(source),
                with_entry(read_config_text(source), f"devices.{record.device}", "calibration", str(out)),
            )
    _print(record, fit, page, out, source if enter else "", as_json=as_json)
    return EXIT_NO if fit.problem else EXIT_OK


def _check_options(source: str, log: Path | None, *, virtual: bool, drive: bool, by_hand: bool) -> None:
    if log is not None and (virtual or drive or by_hand):
        raise ConfigError(f"{log} is a log: leave --virtual, --drive and --by-hand out")
    if by_hand and (virtual or drive):
        raise ConfigError("--by-hand drives nothing: leave --virtual and --drive out")
    if virtual:
        load_config(source, VIRTUAL_RUN_CHECKS[-1:])


def _print(
    record: CompassRecord, fit: CompassFit, page: Path, out: Path, entered: str, *, as_json: bool
) -> None:
    if as_json:
        facts = {
            "device": record.device,
            "rms_deg": fit.rms_deg,
            "before_rms_deg": fit.before_rms_deg,
            "turns": fit.turns,
            "covered": fit.covered,
            "lag_s": fit.lag_s,
            "problem": fit.problem,
            "file": None if fit.problem else str(out),
        }
        print_json(facts)
        return
    console = Terminal(soft_wrap=True)
    for name, value in _facts(record, fit):
        console.print(f"{name}: {value}")
    console.print(f"picture: {page}")
    if fit.problem:
        console.print(f"not written: {fit.problem}")
    elif entered:
        console.print(f"written to {out} and entered into {entered}")
    else:
        console.print(
            f'written to {out}; in the configuration: [devices.{record.device}] calibration = "{out}"'
        )


def _record(config: Config, device: str, log_path: Path, turns: int, order: DriveOrder | None) -> None:
    """Turn the rover into a log, and show how far it is."""
    coverage, wanted = Coverage(), 2 * turns
    driven = turning_config(config, device, turns)
    require_room(config, [driven.mission], "turn it yourself with --by-hand")
    limit_s = driven.loop.time_limit_s
    with show_steps(f"turning the rover {turns} times in each sense") as step:

        def show(output: StepOutput) -> None:
            coverage.add(output.estimate.yaw_rad)
            step(f"{coverage.text(wanted)}  {output.reason}")

        if order is None:
            simulation = with_magnetic_frames(config, device, on_firm_floor(driven.require_simulation()))
            driven = driven.model_copy(update={"simulation": simulation})
            result = run_virtual(driven, log_path, limit_s, show)
        else:
            result = run_real(driven, log_path, limit_s, show, order=order)
    require_uninterrupted(result)
    if result.end is None or result.end.name != "FINISHED":
        Terminal(stderr=True).print(f"the turns ended early: {result.reason}", soft_wrap=True)


def turning_config(config: Config, device: str, turns: int) -> Config:
    """Return a configuration that turns on the spot, and uses no heading, no slip compensation and no camera.

    A rover that cannot turn on the spot drives rings of about twice its least radius instead.
    """
    kinematics = make_kinematics(config.rover)
    mission: WholeTurnsMission | WaypointsMission
    if kinematics.turns_on_spot:
        wheel_rad_s = max(map(abs, kinematics.wheel_speeds(0.0, 0.0, 1.0)))
        rate = min(TURN_RATE_RAD_S, LIMIT_SHARE * config.limits.wheel_speed_rad_s / wheel_rad_s)
        mission = WholeTurnsMission(
            type="whole_turns", turns=turns, heading="along_path", turn_rate_rad_s=max(0.05, rate)
        )
        # Wheels that skid turn the rover by less than they roll.
        time_s = SKID_FACTOR * 2.0 * turns * math.tau / mission.turn_rate_rad_s + 3.0 * mission.rest_s
    else:
        speed_m_s = 0.2 if config.mission is None else config.mission.speed_m_s
        points = _rings(2.0 * kinematics.turn_radius_m, turns)
        mission = WaypointsMission(
            type="waypoints",
            points=points,
            heading="along_path",
            speed_m_s=speed_m_s,
            position_tolerance_m=0.1,
        )
        time_s = 4.0 * turns * math.tau * 2.0 * kinematics.turn_radius_m / speed_m_s
    kept = {
        name: settings
        for name, settings in config.devices.items()
        if not isinstance(settings, FrameDeviceSettings) or name in config.roles.fixes
    }
    roles = config.roles.model_copy(update={"headings": (), "camera": None, "require_camera": False})
    loop = config.loop.model_copy(update={"time_limit_s": config.safety.settle_s + 1.5 * time_s + SPARE_S})
    simulation = config.simulation
    if simulation is not None:
        simulation = simulation.model_copy(
            update={
                "devices": {name: each for name, each in simulation.devices.items() if name in kept},
                "faults": tuple(fault for fault in simulation.faults if fault.device in kept),
            }
        )
    settings = kept[device]
    if isinstance(settings, CompassSettings):
        settings = settings.model_copy(update={"calibration": None})
    devices = {**kept, device: settings}
    changes = {"mission": mission, "slip": None, "scomp": None, "roles": roles, "loop": loop}
    return config.model_copy(update={**changes, "devices": devices, "simulation": simulation})


def with_magnetic_frames(config: Config, device: str, simulation: SimulationSettings) -> SimulationSettings:
    """Return the simulation with a WitMotion sensor that also sends attitude and magnetic frames."""
    if not isinstance(config.devices[device], WitMotionSettings):
        return simulation
    errors = simulation.devices.get(device)
    sensor = errors if isinstance(errors, ImuEmulatorSettings) else ImuEmulatorSettings()
    frames = tuple(dict.fromkeys((*sensor.frames, "rate", "angle", "magnetic")))
    sensor = sensor.model_copy(update={"frames": frames})
    return simulation.model_copy(update={"devices": {**simulation.devices, device: sensor}})


def _rings(radius_m: float, turns: int) -> tuple[tuple[float, float], ...]:
    """Return corners of rings to the left, then as many to the right, both through the start."""
    points = []
    for side in (1.0, -1.0):
        for corner in range(1, CORNERS * turns + 1):
            angle = math.tau * corner / CORNERS
            points.append((radius_m * math.sin(angle), side * radius_m * (1.0 - math.cos(angle))))
    return tuple(points)


def _record_by_hand(config: Config, device: str, log_path: Path, turns: int) -> None:
    """Record compass and gyro while the user turns them; ends when that is enough, or with ctrl-C."""
    coverage, wanted = Coverage(), 2 * turns
    names = tuple(dict.fromkeys((device, *((config.roles.gyro,) if config.roles.gyro else ()))))
    yaw_rad, last_ns = 0.0, 0
    with show_steps("connecting") as step:

        def take(samples: list[Sample]) -> bool:
            nonlocal yaw_rad, last_ns
            for sample in samples:
                if isinstance(sample, RateSample) and sample.device == names[-1]:
                    yaw_rad += sample.rate_z_rad_s * (seconds(sample.t_ns - last_ns) if last_ns else 0.0)
                    last_ns = sample.t_ns
                    coverage.add(wrap_rad(yaw_rad))
            step(f"turn it slowly by hand, in both senses; ctrl-C ends: {coverage.text(wanted)}")
            return coverage.turns >= wanted and coverage.covered >= COMPASS_FIT.least_covered

        record_by_hand(config, names, log_path, SLOWEST_BY_HAND_S * wanted, take)


def _facts(record: CompassRecord, fit: CompassFit) -> tuple[tuple[str, str], ...]:
    facts = [
        ("compass", f"{record.device}, against the {record.reference}"),
        ("turns", f"{fit.turns}, {100 * fit.covered:.0f} % of the directions"),
    ]
    if math.isfinite(fit.before_rms_deg):
        facts.append(("error without calibration", f"{fit.before_rms_deg:.1f} deg rms"))
    if math.isfinite(fit.rms_deg):
        facts.append(("error on held-out turns", f"{fit.rms_deg:.2f} deg rms"))
    if fit.strength_counts:
        x, y, z = getattr(fit.calibration, "hard_iron_counts", (0.0, 0.0, 0.0))
        share = math.hypot(x, y) / fit.strength_counts
        facts.append(
            ("hard iron", f"{x:.0f}, {y:.0f}, {z:.0f} counts, {share:.1f} times the horizontal field")
        )
    elif fit.calibration is not None:
        facts.append(("lag of the compass", f"{fit.lag_s:.2f} s; in the configuration: filter.heading_lag_s"))
    return tuple(facts)


def _page(record: CompassRecord, fit: CompassFit) -> str:
    drawings = [
        Drawing(
            "Field in the sensor",
            "See whether the dots on the right lie on the circle, all around. On the left the rover's "
            "magnets shift them "
            "and its iron makes an ellipse of the circle.",
            lambda: draw_field(fit),
        ),
        Drawing(
            "Deviation",
            "The table that is added to the readings. A smooth curve of one or two waves is usual.",
            lambda: draw_deviation(fit),
        ),
        Drawing(
            "Error over the heading",
            "See whether waves are left below. What is left without a wave is noise of the sensor. The "
            "constant part is "
            "not counted: the filter estimates it while driving.",
            lambda: draw_errors(fit),
        ),
    ]
    return render(
        "identify/report.html",
        grade="attention" if fit.problem else "plain",
        title=f"Compass: not calibrated, {fit.problem}"
        if fit.problem
        else f"Calibration of '{record.device}'",
        facts=_facts(record, fit),
        pictures=draw_pictures(drawings),
    )
