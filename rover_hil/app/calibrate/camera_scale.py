"""`rover-hil calibrate camera --scale`: the factor of the travel that a ground camera measures."""

import datetime as dt
from collections.abc import Sequence
from pathlib import Path

from controllers.control_loop import StepOutput
from controllers.ground_motion.rig import RigFile
from controllers.motion.settings import LineMission
from drivers.clock import wall_time_ns
from drivers.errors import ConfigError, LogError
from rover_hil.app.calibrate.imu import LOG_SUFFIX, on_firm_floor
from rover_hil.app.calibrate.results import check_results
from rover_hil.app.room import require_room
from rover_hil.config import Config, load_config, read_config_text, shipped_configs
from rover_hil.config.entry import with_entry
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.steps import show_steps
from rover_hil.datasets.toml_text import toml_text
from rover_hil.doctor.clocks import today
from rover_hil.identify.ground_scale.figures import draw_scale
from rover_hil.identify.ground_scale.fit import ScaleFit, fit_scale
from rover_hil.identify.ground_scale.record import ScaleRecord, read_scale_record
from rover_hil.pages.atomic_write import write_file
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.run.checks import ROVER_CHECKS, VIRTUAL_RUN_CHECKS
from rover_hil.run.drive_order import DriveOrder
from rover_hil.run.drive_permission import permit_drive
from rover_hil.run.driving import require_finished, run_real, run_virtual
from rover_hil.terminal import Terminal
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from sim_backends.settings import SimulationSettings

SECTION = "ground_motion.tolerance"
SPARE_S = 30.0
FIRM_RUT_M = 0.001
"""Sinkage of the simulated camera on firm ground: the least of its settings."""


def calibrate_scale(
    source: str,
    *,
    logs: Sequence[Path],
    virtual: bool,
    drive: bool,
    length_m: float,
    enter: bool,
    out: Path,
    as_json: bool,
    force: bool,
) -> int:
    """Find the scale of the ground camera; returns the exit code: 1, and no file, if it is not sure.

    The page with the picture is written first, also where the scale is not sure.

    Args:
        source: A configuration.
        logs: Drives of this rover; without them it drives a line.
        virtual: Drive the simulated rover, on firm ground.
        drive: Drive the real one without a question.
        length_m: Length of the line.
        enter: Enter the values into the configuration.
        out: File to write, TOML; page and log beside it have its name.
        as_json: Print JSON instead of text.
        force: Replace earlier files.

    Raises:
        ConfigError: The configuration or an option cannot be used, or a file exists.
        LogError: A log is damaged, of another rig, or holds no frames.
    """
    config = load_config(source, VIRTUAL_RUN_CHECKS[-1:] if virtual else ROVER_CHECKS)
    if config.ground_motion is None:
        raise ConfigError(f"{source}: --scale is of a camera with [ground_motion]: add it, and its rig")
    if enter and source in shipped_configs():
        raise ConfigError(f"--enter: {source} cannot be edited: name a TOML file of yours")
    if logs and (virtual or drive):
        raise ConfigError("--log is of a drive: leave --virtual and --drive out")
    log_path = out.with_suffix(LOG_SUFFIX)
    page = check_results(out, () if logs else (log_path,), force=force)
    if not logs:
        order = permit_drive(source, config, virtual=virtual, drive=drive)
        _record(config, log_path, length_m, order)
    records = _read(logs or (log_path,), config.ground_motion.rig)
    fit = fit_scale(records)
    day = min(today(record.wall_ns) for record in records)
    facts = _facts(records, fit, day)
    write_file(page, _page(fit, facts))
    values = _values(fit, day)
    if values:
        comments = "".join(f"# {name}: {value}\n" for name, value in facts)
        write_file(out, comments + toml_text({"ground_motion": {"tolerance": values}}))
    if values and enter:
        text = read_config_text(source)
        for key, value in values.items():
            text = with_entry(text, SECTION, key, value)
        write_file(Path(source), text)
    if as_json:
        print_json({**dict(facts), "ground_motion.tolerance": values, "problem": fit.problem})
    else:
        console = Terminal(soft_wrap=True)
        for name, value in facts:
            console.print(f"{name}: {value}")
        console.print(f"picture: {page}")
        into = f" and entered into {source}" if enter else "; --enter enters it into the configuration"
        console.print(f"written to {out}{into}" if values else f"not written: {fit.problem}")
    return EXIT_OK if values else EXIT_NO


def _record(config: Config, path: Path, length_m: float, order: DriveOrder | None) -> None:
    speed_m_s = 0.15 if config.mission is None else config.mission.speed_m_s
    line = LineMission(type="line", length_m=length_m, speed_m_s=speed_m_s, heading="along_path")
    require_room(config, [line], "lower --length")
    # Slip compensation is left out: it may shake the rover, and the wheels are what is known.
    driven = config.model_copy(update={"mission": line, "slip": None, "scomp": None})
    limit_s = config.safety.settle_s + 4.0 * length_m / speed_m_s + SPARE_S
    with show_steps("driving a line") as step:

        def show(output: StepOutput) -> None:
            step(f"x {output.estimate.x_m:+.2f} m  {output.reason}")

        if order is None:
            simulation = _on_firm_ground(config.require_simulation())
            result = run_virtual(driven.model_copy(update={"simulation": simulation}), path, limit_s, show)
        else:
            result = run_real(driven, path, limit_s, show, order=order)
    require_finished(result, "line")


def _on_firm_ground(simulation: SimulationSettings) -> SimulationSettings:
    firm = on_firm_floor(simulation)
    devices = {
        name: each.model_copy(update={"rut_depth_m": FIRM_RUT_M, "sinkage_per_slip_m": 0.0})
        if isinstance(each, CameraEmulatorSettings)
        else each
        for name, each in firm.devices.items()
    }
    return firm.model_copy(update={"devices": devices})


def _read(paths: Sequence[Path], rig: RigFile) -> list[ScaleRecord]:
    records = []
    with show_steps("comparing frames") as step:
        for path in paths:
            step(f"comparing frames of {path}")
            record = read_scale_record(path)
            if record.rig != rig:
                raise LogError(f"log {path} is of another rig: a scale is of one camera as it is mounted")
            records.append(record)
    return records


def _values(fit: ScaleFit, day: dt.date) -> dict[str, float | str]:
    if fit.problem or fit.factor is None:
        return {}
    return {
        "scale": round(fit.factor.value, 4),
        "scale_sd": round(fit.sd, 4),
        "scale_date": day.isoformat(),
    }


def _facts(records: Sequence[ScaleRecord], fit: ScaleFit, day: dt.date) -> tuple[tuple[str, str], ...]:
    age = (today(wall_time_ns()) - day).days
    pairs = sum(len(record.travels) for record in records)
    valid = sum(travel.camera_m is not None for record in records for travel in record.travels)
    facts = [("known travel", ", ".join(dict.fromkeys(record.reference for record in records)))]
    facts.append(("pairs of frames", f"{valid} of {pairs} measured, {fit.distance_m:.2f} m in pieces"))
    if fit.factor is not None:
        height_m = records[0].height_m
        facts += [
            ("scale", f"{fit.factor.value:.4f} +- {fit.factor.half_width:.4f} (95 %)"),
            ("height that fits", f"{fit.factor.value * height_m:.3f} m, rig {height_m:.3f} m"),
            ("course of the camera", f"{fit.sideways_deg:+.2f} deg to the left of the known one"),
        ]
    facts.append(("driven on", f"{day}, {age} days ago"))
    return tuple(facts)


def _page(fit: ScaleFit, facts: tuple[tuple[str, str], ...]) -> str:
    drawing = Drawing(
        "Camera against known travel",
        "See whether the blue dots lie around zero, without a trend. A trend, or single pieces far off, is "
        "ground that slips.",
        lambda: draw_scale(fit),
    )
    return render(
        "identify/report.html",
        grade="attention" if fit.problem else "plain",
        title=f"Camera: no scale, {fit.problem}" if fit.problem else "Camera: scale of the measured travel",
        facts=facts,
        pictures=draw_pictures([drawing]),
    )
