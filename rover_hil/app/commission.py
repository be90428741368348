"""`rover-hil commission`: a line and squares, marks measured by hand, what the estimate is worth there."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controllers.control_loop import StepOutput
from controllers.motion.settings import MissionSettings, WaypointsMission
from controllers.slip.effort.settings import YAW_PROBE
from drivers.errors import ConfigError, LogError
from rover_hil.app.room import require_room
from rover_hil.commissioning.drive import Poses, read_poses
from rover_hil.commissioning.figures import draw_drives, draw_errors
from rover_hil.commissioning.worth import Worth, find_worth
from rover_hil.config import Config, load_config, read_config_text, shipped_configs
from rover_hil.config.entry import with_entry
from rover_hil.connect.connections import connected
from rover_hil.console.ask import ask, ask_number
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.key_presses import enter_was_pressed
from rover_hil.console.steps import show_steps
from rover_hil.datasets.arrays import Array
from rover_hil.datasets.log import read_drive
from rover_hil.datasets.marks import COLUMNS, Marks, marks_beside, marks_file, marks_text, read_marks
from rover_hil.pages.atomic_write import refuse_overwrite, write_file
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.checks import ROVER_CHECKS, VIRTUAL_RUN_CHECKS
from rover_hil.run.drive_order import DriveOrder
from rover_hil.run.drive_permission import permit_drive
from rover_hil.run.driving import require_finished, run_real, run_virtual
from rover_hil.terminal import Terminal

PAGE_NAME = "commissioning.html"
LINE = "line"
LINE_STOPS = 2
WAIT_S = 4.0
SPARE_S = 30.0
SLOWNESS = 4.0
"""Longest time of a drive over that of the mission: a slipping rover is slower."""
SEED = 1
DEFAULT_SPEED_M_S = 0.15
END_TOLERANCE_S = 0.5
"""By which the time of a mark may exceed the drive: it is rounded."""
REACTION_S = 0.2
"""Standard deviation of the time at which a person presses a key."""

Drive = tuple[str, Poses, Marks]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What is driven.

    Attributes:
        side_m: Side of the squares, and length of the line.
        laps: Squares in each sense.
        tape_sd_m: Standard deviation of a measured position.
    """

    side_m: float
    laps: int
    tape_sd_m: float

    def names(self) -> list[str]:
        """Return the names of the drives in order."""
        squares = [f"square-{sense}-{lap + 1}" for lap in range(self.laps) for sense in ("left", "right")]
        return [LINE, *squares]

    def mission(self, name: str, speed_m_s: float) -> MissionSettings:
        """Return the mission of a drive: every corner is a stop."""
        side_m = self.side_m
        if name == LINE:
            points = [(side_m * (stop + 1) / (LINE_STOPS + 1), 0.0) for stop in range(LINE_STOPS + 1)]
        else:
            left_m = side_m if "left" in name else -side_m
            points = [(side_m, 0.0), (side_m, left_m), (0.0, left_m), (0.0, 0.0)]
        return WaypointsMission(
            type="waypoints",
            points=tuple(points),
            speed_m_s=speed_m_s,
            heading="along_path",
            wait_s=WAIT_S,
        )


def commission(
    source: str,
    *,
    plan: Plan,
    virtual: bool,
    drive: bool,
    again: bool,
    enter: bool,
    out: Path,
    as_json: bool,
    force: bool,
) -> int:
    """Drive, ask for the measured marks, and write the report; returns the exit code: 1 if it did not pass.

    Args:
        source: The configuration.
        plan: What is driven.
        virtual: Drive the simulated rover; its true pose plays the tape measure.
        drive: Drive the real one without a question.
        again: Drive nothing: use the logs and marks that are in the folder.
        enter: Enter `excite_real_rover` into the configuration where the excitation has passed.
        out: Folder for logs, marks and report.
        as_json: Print JSON instead of text.
        force: Replace earlier files.

    Raises:
        ConfigError: The configuration cannot be used, or a file exists.
        LogError: A log or a file of marks is missing or damaged.
    """
    config = load_config(source, VIRTUAL_RUN_CHECKS[-1:] if virtual else ROVER_CHECKS)
    if enter:
        _check_enter(config, source, virtual=virtual)
    if again and drive:
        raise ConfigError("--again drives nothing: leave --drive out")
    page = out / PAGE_NAME
    refuse_overwrite(page, force=force or again)
    names = plan.names()
    if again:
        names = [name for name in names if (out / f"{name}.mcap").is_file()]
        if not names:
            raise ConfigError(f"{out} holds no drive of a commissioning: leave --again out")
    else:
        refuse_overwrite(*(out / f"{name}.mcap" for name in names), force=force)
        require_room(config, [plan.mission(name, DEFAULT_SPEED_M_S) for name in names], "lower --side")
        order = permit_drive(source, config, virtual=virtual, drive=drive)
        rng = np.random.default_rng(SEED)
        for name in names:
            _drive(config, plan, name, out, rng, order)
    drives = [_read(out / f"{name}.mcap", name) for name in names]
    worth = find_worth(drives)
    is_entered = enter and not worth.doubts
    if is_entered:
        _require_excited(config, source, drives)
    is_virtual = any(poses.is_virtual for _, poses, _ in drives)
    facts = _facts(config, worth, is_virtual=is_virtual, is_entered=is_entered)
    write_file(page, _page(source, drives, worth, facts))
    if is_entered:
        write_file(Path(source), with_entry(read_config_text(source), "slip", "excite_real_rover", True))
    if as_json:
        record = {
            "odometry_rms_m": worth.odometry_rms_m,
            "estimate_rms_m": worth.estimate_rms_m,
            "umbmark_systematic_m": worth.systematic_m,
            "slip": worth.odometry_slip,
            "estimated_slip": worth.estimate_slip,
            "marks_inside_95": worth.inside,
            "covariance_factor": worth.growth,
            "doubts": list(worth.doubts),
            "report": str(page),
        }
        print_json(record)
    else:
        console = Terminal(soft_wrap=True)
        for name, value in facts:
            console.print(f"{name}: {value}")
        console.print(f"report: {page}")
    return EXIT_NO if worth.doubts else EXIT_OK


def _check_enter(config: Config, source: str, *, virtual: bool) -> None:
    if virtual or source in shipped_configs():
        raise ConfigError(
            "--enter: the excitation must pass on the real rover: leave --virtual out, and name a TOML file "
            "of yours"
        )
    if not _is_excited(config):
        raise ConfigError(f'--enter: {source} does not excite the yaw: set use = "yaw_probe" in [slip] first')


def _drive(
    config: Config, plan: Plan, name: str, out: Path, rng: np.random.Generator, order: DriveOrder | None
) -> None:
    """Drive once, and write the marks that were measured."""
    speed_m_s = DEFAULT_SPEED_M_S if config.mission is None else config.mission.speed_m_s
    mission = plan.mission(name, speed_m_s)
    if config.mission is not None:
        gains = config.mission.model_dump(
            include={"heading_gain_per_s", "yaw_rate_limit_rad_s", "lookahead_m"}
        )
        mission = mission.model_copy(update=gains)
    limit_s = SLOWNESS * 4.0 * plan.side_m / speed_m_s + 5.0 * WAIT_S + SPARE_S
    driven = config.model_copy(update={"mission": mission})
    log = out / f"{name}.mcap"
    if order is not None:
        ask(f"{name}: put the rover on its start mark, nose along the line, and press Enter", "ready")
    presses_ns: list[int] = []
    with show_steps(f"driving {name}") as step:

        def show(output: StepOutput) -> None:
            if order is not None and enter_was_pressed():
                presses_ns.append(output.t_ns)
            pose = output.estimate
            keys = "" if order is None else f"  Enter on a mark: {len(presses_ns)}"
            step(f"{name}: x {pose.x_m:+.2f} m  y {pose.y_m:+.2f} m  {output.reason}{keys}")

        if order is None:
            result = run_virtual(driven, log, limit_s, show)
        else:
            with connected(driven) as operator:  # for pose fixes over ROS 2
                result = run_real(driven, log, limit_s, show, order=order, operator=operator)
    require_finished(result, name)
    poses = read_poses(log)
    if order is None:
        marks = _true_marks(log, poses.stops_s, plan.tape_sd_m, rng)
    else:
        marks = _asked_marks(name, poses, presses_ns, plan)
    write_file(marks_file(log), marks_text(marks))


def _true_marks(log: Path, stops_s: Array, sd_m: float, rng: np.random.Generator) -> Marks:
    """Return what a tape measure would give of a simulated drive: the true poses, with its errors.

    The rover was put on its start mark with the same errors, which move and turn all marks of the drive.
    """
    drive = read_drive(log)
    true = drive.true_poses()
    t_s = drive.seconds(true.t_ns)
    x_m, y_m, yaw = (np.interp(stops_s, t_s, values) for values in (true.x_m, true.y_m, true.yaw_rad))
    exact = Marks(stops_s, x_m, y_m, yaw, np.full(len(stops_s), sd_m))
    noise = rng.standard_normal((3, len(stops_s) + 1))
    start_yaw = exact.start_yaw_sd_rad * noise[2, -1]
    turned = yaw - true.yaw_rad[0] + start_yaw
    place = (x_m - true.x_m[0]) + 1j * (y_m - true.y_m[0])
    place = place * cmath.rect(1.0, start_yaw - true.yaw_rad[0])
    place += sd_m * (noise[0, -1] + 1j * noise[1, -1])
    return Marks(
        stops_s,
        place.real + sd_m * noise[0, :-1],
        place.imag + sd_m * noise[1, :-1],
        np.degrees(turned + exact.yaw_sd_rad * noise[2, :-1]),
        exact.sigma_m,
    )


def _asked_marks(name: str, poses: Poses, presses_ns: Sequence[int], plan: Plan) -> Marks:
    """Ask for the position of each stop and each press of Enter; one that was not measured is left out."""
    presses_s = [(t_ns - poses.start_ns) / 1e9 for t_ns in presses_ns]
    stops_s = [t_s for t_s in poses.stops_s.tolist() if not _is_near(t_s, presses_s)]
    places = [(t_s, f"stop at {t_s:.0f} s") for t_s in stops_s]
    places += [(t_s, f"Enter at {t_s:.1f} s") for t_s in presses_s]
    rows = []
    for t_s, place in sorted(places):
        question = f"{name}, {place}: was it measured? (yes/no)"
        if ask(question, "yes").lower().startswith("n"):
            continue
        x_m = ask_number("  x from the start, along its nose, m", -500.0, 500.0)
        y_m = ask_number("  y to the left of it, m", -500.0, 500.0)
        yaw = ask("  yaw, counter-clockwise, deg (empty: not measured)", "nan")
        try:
            yaw_deg = float(yaw)
        except ValueError:
            raise ConfigError(
                f"'{yaw}' is not a number: enter the marks into the CSV file, use --again"
            ) from None
        sigma_m = math.hypot(plan.tape_sd_m, REACTION_S * poses.speed_m_s(t_s))
        rows.append((t_s, x_m, y_m, yaw_deg, sigma_m))
    if not rows:
        raise ConfigError(f"{name}: no stop was measured: mark the places where the rover stops")
    return Marks(*np.array(rows).T)


def _is_near(stop_s: float, presses_s: Sequence[float]) -> bool:
    """Return whether Enter was pressed during a stop: the press marks it."""
    return any(abs(stop_s - press_s) <= 0.5 * WAIT_S for press_s in presses_s)


def _read(log: Path, name: str) -> Drive:
    path = marks_beside(log)
    if path is None:
        raise LogError(f"no file {marks_file(log)}: write the measured marks, {','.join(COLUMNS)}")
    poses, marks = read_poses(log), read_marks(path)
    end_s = float(poses.t_s[-1])
    if marks.t_s[0] < 0.0 or marks.t_s[-1] > end_s + END_TOLERANCE_S:
        raise LogError(
            f"{path}: t_s must be within the drive, 0 to {end_s:.1f} s after its start: correct it"
        )
    return name, poses, marks


def _is_excited(config: Config) -> bool:
    return config.slip is not None and config.slip.use == YAW_PROBE


def _require_excited(config: Config, source: str, drives: Sequence[Drive]) -> None:
    """Check that the drives which passed had the excitation that is to be entered, on the real rover."""
    for _, poses, _ in drives:
        if poses.is_virtual:
            raise ConfigError(f"--enter: {poses.path} is of the simulated rover: commission the real one")
        with restore_config(LogReader(poses.path)) as driven:
            settings = [
                (each.rover, each.slip and each.slip.model_copy(update={"excite_real_rover": True}))
                for each in (config, driven)
            ]
        if settings[0] != settings[1]:
            raise ConfigError(
                f"--enter: {poses.path} was driven with another [rover] or [slip] than that of {source}: "
                "commission again without --again"
            )


def _facts(
    config: Config, worth: Worth, *, is_virtual: bool, is_entered: bool
) -> tuple[tuple[str, str], ...]:
    facts = [
        ("marks", f"{len(worth.marks)}, {worth.distance_m:.1f} m between them"),
        ("wheels alone", f"{1e3 * worth.odometry_rms_m:.0f} mm off the marks (rms)"),
        ("estimate", f"{1e3 * worth.estimate_rms_m:.0f} mm off the marks (rms)"),
    ]
    if math.isfinite(worth.systematic_m):
        facts.append(
            (
                "squares (UMBmark)",
                f"systematic error at the end {1e3 * worth.systematic_m:.0f} mm by the wheels, "
                f"{1e3 * worth.estimate_systematic_m:.0f} mm by the estimate; scatter "
                f"{1e3 * worth.scatter_m:.0f} mm",
            )
        )
    facts += [
        (
            "slip",
            f"{100 * worth.odometry_slip:.1f} % of the wheels' distance, estimated "
            f"{100 * worth.estimate_slip:.1f} %",
        ),
        ("covariance", worth.covariance_words),
        (
            "slip estimator",
            _passed_words(worth.doubts),
        ),
    ]
    if _is_excited(config):
        words = _excitation_words(worth, is_virtual=is_virtual, is_entered=is_entered)
        facts.append(("yaw excitation", words))
    return tuple(facts)


def _passed_words(doubts: Sequence[str]) -> str:
    return f"not passed: {'; '.join(doubts)}" if doubts else "passed on this ground"


def _excitation_words(worth: Worth, *, is_virtual: bool, is_entered: bool) -> str:
    if worth.doubts:
        return 'it must not be used on this ground: set use = "surfaces" in [slip], or leave [slip] out'
    if is_virtual:
        return (
            "it passed on the simulated ground. On a real rover it stays off until a commissioning without "
            "--virtual has passed"
        )
    if is_entered:
        return "it passed here: excite_real_rover = true is now in [slip]; on another ground commission again"
    return (
        "it passed here: set excite_real_rover = true in [slip], or add --again --enter; on another ground "
        "commission again"
    )


def _page(source: str, drives: Sequence[Drive], worth: Worth, facts: Sequence[tuple[str, str]]) -> str:
    drawings = [
        Drawing(
            "Drives seen from above",
            "See whether the blue lines pass through the crosses, which were measured by hand.",
            lambda: draw_drives(drives),
        ),
        Drawing(
            "Errors at the marks",
            "See whether the blue dots lie below the bars, two of their own standard deviations.",
            lambda: draw_errors(worth),
        ),
    ]
    return render(
        "identify/report.html",
        grade="attention" if worth.doubts else "good",
        title=f"Commissioning of {source}: {'not passed' if worth.doubts else 'passed'}",
        facts=facts,
        pictures=draw_pictures(drawings),
    )
