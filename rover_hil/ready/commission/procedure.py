"""`rover-hil commission`: a line and squares, marks measured by hand, what the estimate is worth there."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from controllers.control_loop import StepOutput
from controllers.motion.settings import WaypointsMission
from controllers.slip.effort.settings import YAW_PROBE
from drivers.errors import ConfigError, LogError
from rover_hil.config import Config
from rover_hil.console.ask import ask, ask_number
from rover_hil.console.key_presses import enter_was_pressed
from rover_hil.console.options import (
    LOG_SUFFIX,
    ConfigArgument,
    DriveOption,
    ForceOption,
    JsonOption,
    VirtualOption,
    number_option,
    out_option,
)
from rover_hil.drives.arrays import Array
from rover_hil.drives.drive import read_drive
from rover_hil.drives.marks import COLUMNS, Marks, marks_beside, marks_file, marks_text, read_marks
from rover_hil.drives.quality.learned_ground import LEAST_LEGS, LearnedGround
from rover_hil.pages.atomic_write import refuse_overwrite, write_file
from rover_hil.pages.picture import Drawing
from rover_hil.ready.commission.drive import Poses, read_poses
from rover_hil.ready.commission.figures import draw_drives, draw_errors
from rover_hil.ready.commission.ground import learn_ground
from rover_hil.ready.commission.learning import LearnedReading, learn_reading
from rover_hil.ready.commission.worth import LEAST_LEG_M, Worth, find_worth
from rover_hil.ready.procedure import Drive, Entry, Facts, Procedure, Request, Results, run
from rover_hil.ready.turns import DEFAULT_SPEED_M_S, with_gains
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.report.tracks import Track

PAGE_NAME = "commissioning.html"
LEARNED_NAME = "learned_bracket.toml"
EITHER_WAY = {"excite_real_rover": True, "excite_beside_ground": False}
"""Keys of [slip] by which a commissioning may differ from what is entered."""
LINE = "line"
LINE_STOPS = 2
WAIT_S = 4.0
SPARE_S = 30.0
SLOWNESS = 4.0
"""Longest time of a drive over that of the mission: a slipping rover is slower."""
SEED = 1
END_TOLERANCE_S = 0.5
"""By which the time of a mark may exceed the drive: it is rounded."""
LEAST_ERROR_M = 0.001
"""A smaller error at the marks counts as this."""
REACTION_S = 0.2
"""Standard deviation of the time at which a person presses a key."""

MeasuredDrive = tuple[str, Poses, Marks]


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

    def mission(self, name: str, speed_m_s: float) -> WaypointsMission:
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
    source: ConfigArgument,
    *,
    out: Annotated[Path, out_option("Folder for logs, marks and report.")] = Path("commissioning"),
    virtual: VirtualOption = False,
    drive: DriveOption = False,
    side_m: Annotated[
        float, number_option("Side of the squares, length of the line, m.", "m", 0.4, 20.0, "--side")
    ] = 1.0,
    laps: Annotated[int, number_option("Squares in each sense.", "squares", 1, 20)] = 3,
    tape_sd_m: Annotated[
        float,
        number_option(
            "Accuracy of a measured position, standard deviation, m.", "m", 0.0005, 0.5, "--tape-sd"
        ),
    ] = 0.005,
    again: Annotated[
        bool, typer.Option("--again", help="Drive nothing: use the logs and marks in the folder.")
    ] = False,
    enter: Annotated[
        bool,
        typer.Option(
            "--enter",
            help="Enter the slip of this ground into the configuration, and allow the yaw excitation, where "
            "it has passed.",
        ),
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Find out what odometry, slip estimator and covariance are worth on a ground, without a camera.

    The rover drives a line and closed squares in both senses, and stops at marks that you measure by hand.
    After each drive the command asks for them. Exit code 1: the slip estimator did not pass; the report says
    why.

    Example: `rover-hil commission robotino --virtual`

    Data: your rover, chalk and a tape measure; docs/how-to/commission_a_rover.md.
    """
    plan = Plan(side_m=side_m, laps=laps, tape_sd_m=tape_sd_m)
    logs = [out / f"{name}{LOG_SUFFIX}" for name in plan.names()] if again else []
    logs = [log for log in logs if log.is_file()]
    if again and drive:
        raise ConfigError("--again drives nothing: leave --drive out")
    if again and not logs:
        raise ConfigError(f"{out} holds no drive of a commissioning: leave --again out")
    request = Request(
        source=source,
        virtual=virtual and not again,
        drive=drive,
        enter=enter,
        out=out,
        as_json=as_json,
        force=force,
    )
    return run(Commissioning(source, plan, logs), request)


@dataclass
class Commissioning(Procedure[Sequence[MeasuredDrive], Worth]):
    """What odometry, slip estimator and covariance are worth on a ground.

    Attributes:
        source: The configuration.
        plan: What is driven.
        logs: Logs of earlier drives, used instead.
    """

    is_connected = True
    good = "good"
    page_word = "report"
    takes_log = False
    room_fix = "lower --side"

    source: str
    plan: Plan
    logs: Sequence[Path]

    def __post_init__(self) -> None:
        self._config: Config | None = None
        self._is_excited = False
        self._enters = False
        self._rng = np.random.default_rng(SEED)
        self._is_virtual = False
        self._presses_ns: list[int] = []
        self._learned: LearnedReading | None = None
        self._ground: LearnedGround | None = None

    def configure(self, request: Request, config: Config | None) -> Path | None:
        self._config = config
        self._is_excited = config is not None and config.slip is not None and config.slip.use == YAW_PROBE
        self._enters = request.enter
        if request.enter and request.virtual:
            raise ConfigError("--enter: the real rover must be commissioned: leave --virtual out")
        return request.out

    def drives(self, config: Config) -> Sequence[Drive]:
        if self._is_excited and config.slip is not None and config.ground_motion is not None:
            slip = config.slip.model_copy(update={"excite_beside_ground": True})
            config = config.model_copy(update={"slip": slip})
        speed_m_s = DEFAULT_SPEED_M_S if config.mission is None else config.mission.speed_m_s
        return [
            Drive(
                name=name,
                config=config.model_copy(
                    update={"mission": with_gains(self.plan.mission(name, speed_m_s), config)}
                ),
                limit_s=SLOWNESS * 4.0 * self.plan.side_m / speed_m_s + 5.0 * WAIT_S + SPARE_S,
                words=f"driving {name}",
                status=partial(self._status, name),
                simulated=lambda simulation: simulation,
                needs=() if config.roles.camera is None else (config.roles.camera,),
            )
            for name in self.plan.names()
        ]

    def results(
        self, out: Path | None, drives: Sequence[Drive], *, is_recorded: bool, force: bool
    ) -> Results:
        folder = out or Path()
        page = folder / PAGE_NAME
        logs = [folder / f"{drive.name}{LOG_SUFFIX}" for drive in drives]
        refuse_overwrite(page, folder / LEARNED_NAME, force=force or not is_recorded)
        refuse_overwrite(*logs, force=force)
        return Results(folder, page, logs)

    def begin(self, drive: Drive, *, is_virtual: bool) -> None:
        self._is_virtual = is_virtual
        self._presses_ns = []
        if not is_virtual:
            words = "put the rover on its start mark, nose along the line, and press Enter"
            ask(f"{drive.name}: {words}", "ready")

    def end(self, drive: Drive, log: Path, *, is_virtual: bool) -> None:
        poses = read_poses(log)
        if is_virtual:
            marks = _true_marks(log, poses.stops_s, self.plan.tape_sd_m, self._rng)
        else:
            marks = _asked_marks(drive.name, poses, self._presses_ns, self.plan)
        write_file(marks_file(log), marks_text(marks))

    def _status(self, name: str, output: StepOutput) -> str:
        if not self._is_virtual and enter_was_pressed():
            self._presses_ns.append(output.t_ns)
        pose = output.estimate
        keys = "" if self._is_virtual else f"  Enter on a mark: {len(self._presses_ns)}"
        return f"{name}: x {pose.x_m:+.2f} m  y {pose.y_m:+.2f} m  {output.reason}{keys}"

    def read(self, logs: Sequence[Path]) -> Sequence[MeasuredDrive]:
        return [_read(log, log.stem) for log in logs]

    def fit(self, record: Sequence[MeasuredDrive]) -> Worth:
        """Return what the drives are worth; with fixes or ground motion also learn how to read the slip."""
        config = self._config
        if self._is_excited and config is not None and config.slip is not None and _measures_slip(config):
            logs = [poses.path for _, poses, _ in record]
            self._learned = learn_reading(logs, logs[0].parent / LEARNED_NAME, config.slip)
        self._ground = learn_ground([(poses, marks) for _, poses, marks in record])
        return find_worth(record)

    def title(self, record: Sequence[MeasuredDrive], result: Worth) -> str:
        return f"Commissioning of {self.source}: {'not passed' if result.doubts else 'passed'}"

    def facts(self, record: Sequence[MeasuredDrive], result: Worth) -> Facts:
        facts = [
            ("marks", f"{len(result.marks)}, {result.distance_m:.1f} m between them"),
            ("wheels alone", f"{1e3 * result.odometry_rms_m:.0f} mm off the marks (rms)"),
            ("estimate", f"{1e3 * result.estimate_rms_m:.0f} mm off the marks (rms)"),
        ]
        if math.isfinite(result.systematic_m):
            words = (
                f"systematic error at the end {1e3 * result.systematic_m:.0f} mm by the wheels, "
                f"{1e3 * result.estimate_systematic_m:.0f} mm by the estimate; scatter "
                f"{1e3 * result.scatter_m:.0f} mm"
            )
            facts.append(("squares (UMBmark)", words))
        slip = (
            f"{100 * result.odometry_slip:.1f} % of the wheels' distance, estimated "
            f"{100 * result.estimate_slip:.1f} %"
        )
        if result.has_slip:
            facts.append(("gain and cost", _price_words(record, result)))
        facts += [
            ("slip", slip),
            ("covariance", result.covariance.words("marks")),
            ("slip estimator", _passed_words(result.doubts) if result.has_slip else "none"),
        ]
        if not result.has_slip:
            facts.append(("commissioning", _passed_words(result.doubts)))
        if self._is_excited:
            is_virtual = any(poses.is_virtual for _, poses, _ in record)
            is_entered = self._enters and not result.doubts
            words = _excitation_words(result, is_virtual=is_virtual, is_entered=is_entered)
            facts.append(("yaw excitation", words))
        few = f"not learned: fewer than {LEAST_LEGS} legs of {LEAST_LEG_M:g} m with a measured yaw at the end"
        facts.append(("ground", few if self._ground is None else self._ground.words))
        if self._learned is not None:
            facts.append(("learned reading", self._learned.words))
        return facts

    def json(self, record: Sequence[MeasuredDrive], result: Worth, out: Path | None) -> dict[str, object]:
        learned = None if self._learned is None else self._learned.bracket
        return {
            "odometry_rms_m": result.odometry_rms_m,
            "estimate_rms_m": result.estimate_rms_m,
            "umbmark_systematic_m": result.systematic_m,
            "slip": result.odometry_slip,
            "estimated_slip": result.estimate_slip,
            "marks_inside_95": result.covariance.inside,
            "covariance_factor": result.covariance.growth,
            "doubts": list(result.doubts),
            "ground": None if self._ground is None else self._ground._asdict(),
            "learned_bracket": None if learned is None else learned.model_dump(mode="json"),
            "report": str((out or Path()) / PAGE_NAME),
        }

    def figures(self, record: Sequence[MeasuredDrive], result: Worth) -> Sequence[Drawing]:
        return (
            Drawing(
                "Drives seen from above",
                "See whether the blue lines pass through the crosses, which were measured by hand.",
                lambda: draw_drives(record),
            ),
            Drawing(
                "Errors at the marks",
                "See whether the blue dots lie below the bars, two of their own standard deviations.",
                lambda: draw_errors(result),
            ),
        )

    def entries(self, record: Sequence[MeasuredDrive], result: Worth, out: Path | None) -> Sequence[Entry]:
        """Return what is assumed about the ground, and the key that allows the excitation of the real rover.

        Raises:
            ConfigError: The drives were made by the simulated rover, or without the excitation.
        """
        if not self._enters or self._config is None:
            return ()
        _require_same(self._config, self.source, record)
        entries = [Entry("slip", "excite_real_rover", True)] if self._is_excited else []
        if self._ground is None:
            return entries
        learned = self._ground.settings(str(record[0][1].path.parent))
        return [*entries, *(Entry("ground", key, value) for key, value in learned.items())]


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


def _read(log: Path, name: str) -> MeasuredDrive:
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


def _require_same(config: Config, source: str, drives: Sequence[MeasuredDrive]) -> None:
    """Check that the drives which passed were those of the real rover, with what is to be entered."""
    for _, poses, _ in drives:
        if poses.is_virtual:
            raise ConfigError(f"--enter: {poses.path} is of the simulated rover: commission the real one")
        with restore_config(LogReader(poses.path)) as driven:
            settings = [
                (each.rover, each.slip and each.slip.model_copy(update=EITHER_WAY))
                for each in (config, driven)
            ]
        if settings[0] != settings[1]:
            raise ConfigError(
                f"--enter: {poses.path} was driven with another [rover] or [slip] than that of {source}: "
                "commission again without --again"
            )


def _measures_slip(config: Config) -> bool:
    return bool(config.fix_sources) or config.ground_motion is not None


def _passed_words(doubts: Sequence[str]) -> str:
    return f"not passed: {'; '.join(doubts)}" if doubts else "passed on this ground"


def _price_words(record: Sequence[MeasuredDrive], result: Worth) -> str:
    """Return by how much the estimate is nearer to the marks than the wheels, and how much longer it took."""
    nearer = result.odometry_rms_m / max(result.estimate_rms_m, LEAST_ERROR_M)
    rolled_m = sum(_length_m(poses, poses.odometry) for _, poses, _ in record)
    moved_m = sum(_length_m(poses, poses.estimate) for _, poses, _ in record)
    longer = max(0.0, 100.0 * (rolled_m / moved_m - 1.0)) if moved_m > 0.0 else 0.0
    return (
        f"the wheels alone are {nearer:.1f} times as far off the marks as the estimate; drives take "
        f"{longer:.0f} % longer, as the wheels roll what they slip"
    )


def _length_m(poses: Poses, track: Array) -> float:
    return float(Track.of(np.column_stack((poses.t_s, track))).distance_m()[-1])


def _excitation_words(worth: Worth, *, is_virtual: bool, is_entered: bool) -> str:
    if worth.doubts:
        return 'it must not be used on this ground: set use = "surfaces" in [slip], or leave [slip] out'
    if is_virtual:
        return (
            "it passed on the simulated ground. "
            "On a real rover it stays off until a commissioning without --virtual has passed"
        )
    if is_entered:
        return "it passed here: excite_real_rover = true is now in [slip]; on another ground commission again"
    return (
        "it passed here: set excite_real_rover = true in [slip], or add --again --enter; "
        "on another ground commission again"
    )
