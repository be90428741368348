"""`rover-hil calibrate imu --turns`: mounting, scale and bias of the gyro, from whole turns between rests."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from controllers.control_loop import StepOutput
from drivers.errors import ConfigError
from drivers.samples import Sample
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.app.calibrate.by_hand import record_by_hand
from rover_hil.app.calibrate.compass import turning_config
from rover_hil.app.calibrate.imu import LOG_SUFFIX, on_firm_floor
from rover_hil.app.calibrate.results import check_results
from rover_hil.app.room import require_room
from rover_hil.config import Config, load_config, read_config_text, shipped_configs
from rover_hil.config.entry import with_entry
from rover_hil.console.ask import ask_number
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.steps import show_steps
from rover_hil.datasets.arrays import Array
from rover_hil.datasets.toml_text import toml_text
from rover_hil.identify.mounting.figures import draw_axis, draw_residuals, draw_turns
from rover_hil.identify.mounting.fit import COUNTED, MountingFit, Turn, find_turns, fit_mounting, turns_by
from rover_hil.identify.mounting.record import InertialRecord, read_inertial, sensor_of
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

TURN_SD_DEG = 2.0
"""Of turns that were counted against a mark on the ground, and of a compass."""
EXACT_SD_DEG = 0.1
"""Of simulated turns."""
LONGEST_BY_HAND_S = 1800.0


def calibrate_mounting(
    source: str,
    *,
    turns: int,
    made: str | None,
    device: str | None,
    virtual: bool,
    drive: bool,
    by_hand: bool,
    enter: bool,
    out: Path,
    as_json: bool,
    force: bool,
) -> int:
    """Calibrate an inertial sensor and write the result; returns the exit code: 1, and no file, if unsure.

    The page with the picture is written first, also where the result is not good enough.

    Args:
        source: A configuration, whose rover turns, or a log.
        turns: Whole turns in each sense.
        made: The turns really made, in order, counter-clockwise positive, like "3,-3"; None to use a camera
            or a compass in the log, or to ask.
        device: Name of the sensor; None for `roles.gyro`.
        virtual: Turn the simulated rover.
        drive: Turn the real one by its wheels, without a question.
        by_hand: Drive nothing: the user turns the rover.
        enter: Enter the values into the configuration.
        out: File to write, TOML; page and log beside it have its name.
        as_json: Print JSON instead of text.
        force: Replace earlier files.

    Raises:
        ConfigError: The configuration cannot be used, or a file exists.
        LogError: The log is damaged or holds no turns.
    """
    is_log = source.endswith(LOG_SUFFIX)
    if is_log and (virtual or drive or by_hand or enter):
        raise ConfigError(f"{source} is a log: leave --virtual, --drive, --by-hand and --enter out")
    if by_hand and (virtual or drive):
        raise ConfigError("--by-hand drives nothing: leave --virtual and --drive out")
    if enter and source in shipped_configs():
        raise ConfigError(f"--enter: {source} cannot be edited: name a TOML file of yours")
    known = None if made is None else _numbers(made)
    log_path = out.with_suffix(LOG_SUFFIX)
    page = check_results(out, () if is_log else (log_path,), force=force)
    if not is_log:
        config = load_config(source, VIRTUAL_RUN_CHECKS[-1:] if virtual else ROVER_CHECKS)
        device, _ = sensor_of(config, device)
        if by_hand:
            _record_by_hand(config, device, log_path, turns)
        else:
            order = permit_drive(source, config, virtual=virtual, drive=drive)
            _record(config, device, log_path, turns, order)
    record = read_inertial(Path(source) if is_log else log_path, device)
    found, biases = find_turns(record)
    known_rad, reference, sd_deg = _known(record, found, known, is_log=is_log)
    fit = fit_mounting(record, found, biases, known_rad, reference, math.radians(sd_deg))
    write_file(page, _page(record, fit))
    values = _values(fit)
    if not fit.problem:
        comments = "".join(f"# {name}: {value}\n" for name, value in _facts(record, fit))
        write_file(out, comments + toml_text({"devices": {record.device: values}}))
        if enter:
            text = read_config_text(source)
            for key, value in values.items():
                text = with_entry(text, f"devices.{record.device}", key, value)
            write_file(Path(source), text)
    _print(record, fit, page, out, source if enter else "", as_json=as_json)
    return EXIT_NO if fit.problem else EXIT_OK


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ConfigError(f"--made {text}: write the turns in order, like 3,-3") from None


def _known(
    record: InertialRecord, turns: Sequence[Turn], made: list[float] | None, *, is_log: bool
) -> tuple[Array, str, float]:
    """Return what is known of each turn in rad, what measured it, and its standard deviation in deg."""
    if made is None and not record.references:
        if is_log:
            raise ConfigError(
                f"{record.path} holds no compass or camera that saw the turns: give them with --made, like "
                + ",".join("3" if number % 2 == 0 else "-3" for number in range(len(turns)))
            )
        made = [
            ask_number(
                f"Turns made from {turn.start_s:.0f} to {turn.end_s:.0f} s, counter-clockwise positive",
                -100.0,
                100.0,
            )
            for turn in turns
        ]
    if made is not None:
        if len(made) != len(turns) or not all(math.isfinite(each) and abs(each) > 0.4 for each in made):
            times = ", ".join(f"{turn.start_s:.0f} to {turn.end_s:.0f} s" for turn in turns)
            raise ConfigError(
                f"--made gives {len(made)} turns, the log holds {len(turns)}: {times}; give one for each"
            )
        return math.tau * np.array(made), COUNTED, TURN_SD_DEG
    name = next(iter(record.references))
    known_rad = turns_by(record, turns, name)
    if not np.isfinite(known_rad).all() or (np.abs(known_rad) < 1.0).any():
        raise ConfigError(f"the {name} did not see every turn: give the turns with --made, like 3,-3")
    return known_rad, name, EXACT_SD_DEG if name.startswith("simulated") else TURN_SD_DEG


def _record_by_hand(config: Config, device: str, log_path: Path, turns: int) -> None:
    names = tuple(dict.fromkeys((device, *config.roles.headings)))
    with show_steps("connecting") as step:

        def take(samples: list[Sample]) -> bool:
            step(f"rest, {turns} turns left, rest, {turns} turns right, rest; then ctrl-C")
            return False

        record_by_hand(config, names, log_path, LONGEST_BY_HAND_S, take)


def _record(config: Config, device: str, log_path: Path, turns: int, order: DriveOrder | None) -> None:
    # The turns are driven by the wheels: a gyro whose mounting is not known may count the wrong way.
    roles = config.roles.model_copy(update={"gyro": None})
    driven = turning_config(config.model_copy(update={"roles": roles}), device, turns)
    require_room(config, [driven.mission], "turn it yourself with --by-hand")
    with show_steps(f"turning the rover {turns} times in each sense") as step:

        def show(output: StepOutput) -> None:
            step(f"yaw {math.degrees(output.estimate.yaw_rad):+.0f} deg  {output.reason}")

        if order is None:
            simulation = _with_accelerations(config, device, on_firm_floor(driven.require_simulation()))
            driven = driven.model_copy(update={"simulation": simulation})
            result = run_virtual(driven, log_path, driven.loop.time_limit_s, show)
        else:
            result = run_real(driven, log_path, driven.loop.time_limit_s, show, order=order)
    require_uninterrupted(result)


def _with_accelerations(config: Config, device: str, simulation: SimulationSettings) -> SimulationSettings:
    """Return the simulation with a WitMotion sensor that also sends accelerations."""
    if not isinstance(config.devices[device], WitMotionSettings):
        return simulation
    errors = simulation.devices.get(device)
    sensor = errors if isinstance(errors, ImuEmulatorSettings) else ImuEmulatorSettings()
    frames = tuple(dict.fromkeys(("acceleration", *sensor.frames, "rate")))
    sensor = sensor.model_copy(update={"frames": frames})
    return simulation.model_copy(update={"devices": {**simulation.devices, device: sensor}})


def _values(fit: MountingFit) -> dict[str, float]:
    """Return the new values of the section of the device."""
    values = {"gyro_scale": round(fit.scale, 4), "gyro_bias_deg_s": round(fit.bias_deg_s, 3)}
    # Adding zero makes 0 of -0.
    roll_deg, pitch_deg = (round(angle, 2) + 0.0 for angle in (fit.roll_deg, fit.pitch_deg))
    return {"mounting_roll_deg": roll_deg, "mounting_pitch_deg": pitch_deg, **values}


def _facts(record: InertialRecord, fit: MountingFit) -> tuple[tuple[str, str], ...]:
    axis = int(np.argmax(np.abs(fit.up)))
    sign = "" if fit.up[axis] > 0.0 else "-"
    facts = [
        ("sensor", f"{record.device}, turns by {fit.reference}"),
        ("turns", ", ".join(f"{turn / math.tau:+.2f}" for turn in fit.known_rad.tolist())),
        ("axis that points up", f"{sign}{'xyz'[axis]}"),
    ]
    facts += [
        (
            "mounting",
            f"roll {fit.roll_deg:.2f} deg, pitch {fit.pitch_deg:.2f} deg, "
            f"+- {fit.tilt_sd_deg:.2f} deg from turn to turn",
        ),
        ("gyro scale", f"{fit.scale:.4f} +- {fit.scale_sd:.4f} (one standard deviation)"),
        (
            "bias at rest",
            f"{fit.bias_deg_s:+.3f} deg/s, {fit.bias_sd_deg_s:.3f} deg/s from rest to rest",
        ),
    ]
    if np.isfinite(fit.gravity).all():
        slope_deg = math.degrees(math.acos(float(np.clip(fit.up @ fit.gravity, -1.0, 1.0))))
        facts.append(("gravity at rest", f"{slope_deg:.1f} deg from this axis: slope of the ground"))
    return tuple(facts)


def _page(record: InertialRecord, fit: MountingFit) -> str:
    drawings = [
        Drawing(
            "Turns",
            "See whether every turn is shaded, and whether the rate is level between them.",
            lambda: draw_turns(record, fit),
        ),
        Drawing(
            "Missed in each turn",
            "See whether the blue dots are closer to zero than the others. A pattern by sense is a bias.",
            lambda: draw_residuals(fit),
        ),
        Drawing(
            "Axis of the turns",
            "See whether the dots lie together. The cross is apart from them where the ground slopes.",
            lambda: draw_axis(fit),
        ),
    ]
    return render(
        "identify/report.html",
        grade="attention" if fit.problem else "plain",
        title=f"Gyro: not calibrated, {fit.problem}" if fit.problem else "Gyro: mounting, scale and bias",
        facts=_facts(record, fit),
        pictures=draw_pictures(drawings),
    )


def _print(
    record: InertialRecord, fit: MountingFit, page: Path, out: Path, entered: str, *, as_json: bool
) -> None:
    if as_json:
        values = {"device": record.device, **_values(fit), "scale_sd": fit.scale_sd}
        print_json({**values, "problem": fit.problem})
        return
    console = Terminal(soft_wrap=True)
    for name, value in _facts(record, fit):
        console.print(f"{name}: {value}")
    console.print(f"picture: {page}")
    into = f" and entered into {entered}" if entered else "; --enter enters it into the configuration"
    done = f"written to {out}{into}"
    console.print(f"not written: {fit.problem}" if fit.problem else done)
