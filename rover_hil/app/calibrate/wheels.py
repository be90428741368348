"""`rover-hil calibrate wheels`: radius and base from known distances and known turns."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from controllers.control_loop import StepOutput
from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import WheelsRoverSettings
from controllers.motion.settings import LineMission, MissionSettings, WholeTurnsMission
from drivers.errors import ConfigError, LogError
from rover_hil.app.calibrate.compass import turning_config
from rover_hil.app.calibrate.imu import on_firm_floor
from rover_hil.app.calibrate.results import check_results
from rover_hil.app.room import require_room
from rover_hil.config import Config, load_config, read_config_text, shipped_configs
from rover_hil.config.entry import with_entry
from rover_hil.console.ask import ask_number
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.steps import show_steps
from rover_hil.datasets.log import read_drive
from rover_hil.datasets.toml_text import toml_text
from rover_hil.identify.wheels.figures import draw_factor
from rover_hil.identify.wheels.fit import (
    LEAST_DISTANCE_M,
    LEAST_TURN_RAD,
    Factor,
    Odometry,
    fit_factor,
    proposal,
    read_odometry,
)
from rover_hil.pages.atomic_write import write_file
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.run.checks import ROVER_CHECKS, VIRTUAL_RUN_CHECKS
from rover_hil.run.drive_order import DriveOrder
from rover_hil.run.drive_permission import permit_drive
from rover_hil.run.driving import require_finished, run_real, run_virtual
from rover_hil.terminal import Terminal

SPARE_S = 30.0
DRIVES = 2
"""Of each kind, where the command drives."""
Known = tuple[Path, float]


def calibrate_wheels(
    source: str,
    *,
    lines: Sequence[str],
    spins: Sequence[str],
    virtual: bool,
    drive: bool,
    length_m: float,
    turns: int,
    tape_sd_m: float,
    turn_sd_deg: float,
    out: Path,
    enter: bool,
    as_json: bool,
    force: bool,
) -> int:
    """Propose radius and base; returns the exit code: 1, and no file, if they are not sure.

    Args:
        source: A configuration.
        lines: Straight drives as LOG=METRES. Without these and `spins` the rover is driven.
        spins: Turns on the spot as LOG=TURNS, counter-clockwise positive.
        virtual: Drive the simulated rover; its true motion is what is known.
        drive: Drive the real one without a question.
        length_m: Length of a straight drive.
        turns: Turns of a drive on the spot.
        tape_sd_m: Standard deviation of a known distance.
        turn_sd_deg: Standard deviation of a known turn.
        out: File to write; the page has its name with `.html`, logs with `-line1.mcap` and so on.
        enter: Enter the values into the configuration.
        as_json: Print JSON instead of text.
        force: Replace earlier files.

    Raises:
        ConfigError: The configuration or an option cannot be used, or a file exists.
        LogError: A log is damaged or holds no drive.
    """
    config = load_config(source, VIRTUAL_RUN_CHECKS[-1:] if virtual else ROVER_CHECKS)
    if enter and (source in shipped_configs() or isinstance(config.rover, WheelsRoverSettings)):
        raise ConfigError(
            f"--enter: {source} cannot be edited: name a TOML file of yours, without [[rover.wheels]]"
        )
    page = check_results(out, force=force)
    known_lines, known_spins = (
        [_known(each, "--line") for each in lines],
        [_known(each, "--spin") for each in spins],
    )
    if not known_lines and not known_spins:
        order = permit_drive(source, config, virtual=virtual, drive=drive)
        known_lines, known_spins = _drive(config, out, length_m, turns, order, force=force)
    elif virtual or drive:
        raise ConfigError("--line and --spin are of logs: leave --virtual and --drive out")
    line_odometry = [read_odometry(path) for path, _ in known_lines]
    spin_odometry = [read_odometry(path) for path, _ in known_spins]
    rover = _one_geometry([*line_odometry, *spin_odometry])
    radius = _line_factor(known_lines, line_odometry, tape_sd_m)
    turn = _spin_factor(known_spins, spin_odometry, math.radians(turn_sd_deg))
    problem = next((each.problem for each in (radius, turn) if each is not None and each.problem), "")
    values = proposal(rover.rover, radius, turn)
    facts = _facts(radius, turn, values)
    write_file(page, _page(radius, turn, facts, problem))
    if not problem:
        comments = "".join(f"# {name}: {value}\n" for name, value in facts)
        write_file(out, f"{comments}{toml_text({'rover': values})}")
        if enter:
            text = read_config_text(source)
            for key, value in values.items():
                text = with_entry(text, "rover", key, float(str(value)))
            write_file(Path(source), text)
    if as_json:
        print_json({**dict(facts), "rover": values, "problem": problem})
    else:
        console = Terminal(soft_wrap=True)
        for name, value in facts:
            console.print(f"{name}: {value}")
        console.print(f"picture: {page}")
        into = f" and entered into {source}" if enter else "; --enter enters it into the configuration"
        done = f"proposal written to {out}{into}"
        console.print(f"not written: {problem}" if problem else done)
    return EXIT_NO if problem else EXIT_OK


def _known(text: str, option: str) -> Known:
    path, _, number = text.rpartition("=")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not path or not math.isfinite(value) or value == 0.0:
        raise ConfigError(f"{option} {text}: write the log and what is known of it, like run.mcap=5.02")
    return Path(path), value


def _one_geometry(drives: Sequence[Odometry]) -> Odometry:
    for each in drives:
        if each.rover != drives[0].rover:
            raise LogError(
                f"{each.path} and {drives[0].path} have different [rover]: use logs of one geometry"
            )
    return drives[0]


def _line_factor(known: Sequence[Known], drives: Sequence[Odometry], tape_sd_m: float) -> Factor | None:
    for each in drives:
        if each.distance_m < LEAST_DISTANCE_M:
            raise LogError(
                f"log {each.path}: the rover drove {each.distance_m:.2f} m, {LEAST_DISTANCE_M:g} m are needed"
            )
    if not drives:
        return None
    return fit_factor([abs(value) for _, value in known], [each.distance_m for each in drives], tape_sd_m)


def _spin_factor(known: Sequence[Known], drives: Sequence[Odometry], turn_sd_rad: float) -> Factor | None:
    for each in drives:
        if abs(each.turn_rad) < LEAST_TURN_RAD:
            turned = f"{each.turn_rad / math.tau:.2f} turns in all"
            raise LogError(f"log {each.path}: the wheels made {turned}, half a turn in one sense is needed")
    if not drives:
        return None
    return fit_factor(
        [math.tau * value for _, value in known], [each.turn_rad for each in drives], turn_sd_rad
    )


def _drive(
    config: Config, out: Path, length_m: float, turns: int, order: DriveOrder | None, *, force: bool
) -> tuple[list[Known], list[Known]]:
    """Drive lines and turns, and return what the user, or the simulation, knows of them."""
    kinematics = make_kinematics(config.rover)
    speed_m_s = 0.15 if config.mission is None else config.mission.speed_m_s
    line = LineMission(type="line", length_m=length_m, speed_m_s=speed_m_s, heading="along_path")
    plan: list[tuple[str, MissionSettings]] = [(f"line{n + 1}", line) for n in range(DRIVES)]
    if kinematics.turns_on_spot:
        spin = WholeTurnsMission(type="whole_turns", turns=turns, heading="along_path", senses="left")
        plan += [("spin1", spin), ("spin2", spin.model_copy(update={"senses": "right"}))]
    require_room(config, [mission for _, mission in plan], "lower --length")
    paths = [out.with_name(f"{out.stem}-{name}.mcap") for name, _ in plan]
    check_results(out, paths, force=force)
    lines: list[Known] = []
    spins: list[Known] = []
    base = turning_config(config, config.roles.wheels, turns)
    for path, (name, mission) in zip(paths, plan, strict=True):
        limit_s = max(base.loop.time_limit_s, 4.0 * length_m / speed_m_s + SPARE_S)
        driven = base.model_copy(update={"mission": mission})
        with show_steps(f"driving {name}") as step:

            def show(output: StepOutput, name: str = name, step: Callable[[str], None] = step) -> None:
                pose = output.estimate
                step(
                    f"{name}: x {pose.x_m:+.2f} m  yaw {math.degrees(pose.yaw_rad):+.0f} deg  {output.reason}"
                )

            if order is None:
                simulation = on_firm_floor(driven.require_simulation())
                result = run_virtual(
                    driven.model_copy(update={"simulation": simulation}), path, limit_s, show
                )
            else:
                result = run_real(driven, path, limit_s, show, order=order)
        require_finished(result, name)
        distance_m, turned = _true_motion(path) if order is None else (math.nan, math.nan)
        if name.startswith("line"):
            words = "Distance from start to end by tape, m"
            lines.append((path, distance_m if order is None else ask_number(words, 0.05, 1000.0)))
        else:
            words = "Turns really made, e.g. 2.98, negative for clockwise"
            spins.append((path, turned if order is None else ask_number(words, -100.0, 100.0)))
    return lines, spins


def _true_motion(path: Path) -> tuple[float, float]:
    """Return the true distance in m from start to end and the number of turns of a virtual drive."""
    poses = read_drive(path).true_poses()
    distance_m = math.hypot(poses.x_m[-1] - poses.x_m[0], poses.y_m[-1] - poses.y_m[0])
    return distance_m, float(poses.yaw_rad[-1] - poses.yaw_rad[0]) / math.tau


def _facts(
    radius: Factor | None, turn: Factor | None, values: dict[str, object]
) -> tuple[tuple[str, str], ...]:
    facts = []
    for name, factor, drive in (("distance", radius, "straight drive"), ("turn", turn, "drive on the spot")):
        if factor is not None:
            count = len(factor.measured)
            drives = f"{count} {drive}{'' if count == 1 else 's'}"
            facts.append(
                (
                    f"known {name} over odometry",
                    f"{factor.value:.4f} +- {factor.half_width:.4f} (95 %), {drives}",
                )
            )
    facts += [(key, str(value)) for key, value in values.items()]
    return tuple(facts)


def _page(
    radius: Factor | None, turn: Factor | None, facts: tuple[tuple[str, str], ...], problem: str
) -> str:
    drawings = [
        Drawing(
            "Distance",
            "See whether the blue dots are closer to zero than the others, and how far they scatter.",
            lambda: draw_factor(radius, "m"),
        ),
        Drawing("Turns", "The same for the turns on the spot.", lambda: draw_factor(turn, "rad")),
    ]
    return render(
        "identify/report.html",
        grade="attention" if problem else "plain",
        title=f"Wheels: not calibrated, {problem}" if problem else "Wheels: radius and base",
        facts=facts,
        pictures=draw_pictures(drawings),
    )
