"""`rover-hil calibrate wheels`: from drives with ground truth, or from known distances and known turns."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from controllers.control_loop import StepOutput
from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import WheelsRoverSettings
from controllers.motion.settings import LineMission, MissionSettings, WholeTurnsMission
from drivers.errors import ConfigError, LogError
from rover_hil.config import Config
from rover_hil.console.ask import ask_number
from rover_hil.console.options import number_option, out_option
from rover_hil.drives.drive import read_drive
from rover_hil.drives.formats.described_rover import is_log
from rover_hil.drives.toml_text import toml_text
from rover_hil.pages.picture import Drawing
from rover_hil.ready.options import command
from rover_hil.ready.procedure import Drive, Entry, Facts, FileProcedure, Request, comments
from rover_hil.ready.turns import DEFAULT_SPEED_M_S, turning_config
from rover_hil.ready.wheels.drives_procedure import DrivesCalibration
from rover_hil.ready.wheels.figures import draw_factor
from rover_hil.ready.wheels.fit import (
    LEAST_DISTANCE_M,
    LEAST_TURN_RAD,
    Factor,
    Odometry,
    WheelsFit,
    fit_factor,
    read_odometry,
)

SPARE_S = 30.0
DRIVES = 2
"""Of each kind, where the command drives."""


class Known(NamedTuple):
    """A drive of which the distance in m from start to end is known, or the turns, counter-clockwise."""

    log: Path
    value: float


@command("virtual", "drive", "enter")
def calibrate(
    source: Annotated[
        str,
        typer.Argument(
            help="Configuration whose rover is to move or is calibrated; or the first log of drives.",
            metavar="CONFIG_OR_LOG",
            show_default=False,
        ),
    ] = "",
    logs: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Logs of drives with ground truth or positions, or folders of runs.", show_default=False
        ),
    ] = None,
    validation: Annotated[
        list[Path] | None,
        typer.Option(help="A log that only validates; without it each drive validates a fit of the others."),
    ] = None,
    line: Annotated[
        list[str] | None,
        typer.Option(help="A straight drive of known distance from start to end, LOG=METRES; repeat it."),
    ] = None,
    spin: Annotated[
        list[str] | None,
        typer.Option(help="Turns on the spot, LOG=TURNS, counter-clockwise positive; repeat it."),
    ] = None,
    length: Annotated[float, number_option("Length of a straight drive, m.", "m", 0.5, 50.0)] = 2.0,
    turns: Annotated[int, number_option("Turns of a drive on the spot.", "turns", 1, 50)] = 3,
    tape_sd: Annotated[
        float, number_option("Accuracy of a known distance, standard deviation, m.", "m", 0.0001, 1.0)
    ] = 0.005,
    turn_sd: Annotated[
        float, number_option("Accuracy of a known turn, standard deviation, deg.", "deg", 0.01, 45.0)
    ] = 2.0,
    out: Annotated[
        Path | None, out_option("File to write, TOML; page and logs beside it have its name.")
    ] = None,
) -> "WheelsCalibration | DrivesCalibration":
    """Fit the wheels to recorded drives with ground truth, or to known distances and turns, with intervals.

    With logs, radii, track or base, steering, marker and gyro are fitted to the ground truth or to positions.
    They are written where they are better than the description in every kind of motion of drives that were
    not used in the fit. Without logs, --line and --spin the rover drives two lines and turns on the spot in
    both senses; after each drive the command asks for the measured distance, or the turns. Of a rover that
    skids in turns the base is the effective track. The page with the pictures is written before the file.
    Exit code 1: the numbers are not sure, or not better; the file is not written.

    Example: `rover-hil calibrate wheels robotino --virtual --out wheels.toml`

    Data: logs of drives of your rover with ground truth, or its drives and a tape measure;
    docs/how-to/calibrate_the_wheels.md.
    """
    drives = [*([Path(source)] if source and is_log(source) else []), *(logs or ())]
    known = [*(line or ()), *(spin or ())]
    if validation and not drives:
        raise ConfigError("--validation: name logs of other drives, too, which the numbers are fitted to")
    if drives and not (known and is_log(source) and not logs):
        if known:
            raise ConfigError("--line and --spin: leave them out, logs of drives are given by themselves")
        return DrivesCalibration(drives, validation or ())
    if out is None:
        raise ConfigError("--out is needed: name the file to write, like wheels.toml")
    return WheelsCalibration(
        lines=[_known_line(text) for text in line or ()],
        spins=[_known_spin(text) for text in spin or ()],
        length_m=length,
        turns=turns,
        tape_sd_m=tape_sd,
        turn_sd_rad=math.radians(turn_sd),
    )


@dataclass
class WheelsCalibration(FileProcedure[Sequence[Odometry], WheelsFit]):
    """Radius and base of the wheels.

    Attributes:
        lines: Straight drives whose distance is known; none of them and of `spins` where the rover drives.
        spins: Turns on the spot.
        length_m: Length of a straight drive.
        turns: Turns of a drive on the spot.
        tape_sd_m: Standard deviation of a known distance.
        turn_sd_rad: Standard deviation of a known turn.
    """

    takes_log = False
    room_fix = "lower --length"

    lines: list[Known]
    spins: list[Known]
    length_m: float
    turns: int
    tape_sd_m: float
    turn_sd_rad: float

    def __post_init__(self) -> None:
        self.logs = [known.log for known in (*self.lines, *self.spins)]

    def configure(self, request: Request, config: Config | None) -> Path | None:
        if request.enter and config is not None and isinstance(config.rover, WheelsRoverSettings):
            raise ConfigError(
                f"--enter: [[rover.wheels]] of {request.source} cannot be edited: copy the values"
            )
        return request.out

    def drives(self, config: Config) -> Sequence[Drive]:
        speed_m_s = DEFAULT_SPEED_M_S if config.mission is None else config.mission.speed_m_s
        line = LineMission(type="line", length_m=self.length_m, speed_m_s=speed_m_s, heading="along_path")
        plan: list[tuple[str, MissionSettings]] = [(f"line{n + 1}", line) for n in range(DRIVES)]
        if make_kinematics(config.rover).turns_on_spot:
            spin = WholeTurnsMission(
                type="whole_turns", turns=self.turns, heading="along_path", senses="left"
            )
            plan += [("spin1", spin), ("spin2", spin.model_copy(update={"senses": "right"}))]
        base = turning_config(config, config.roles.wheels, self.turns)
        return [
            Drive(
                name=name,
                config=base.model_copy(update={"mission": mission}),
                limit_s=max(base.loop.time_limit_s, 4.0 * self.length_m / speed_m_s + SPARE_S),
                words=f"driving {name}",
                status=lambda output, name=name: _status(name, output),  # type: ignore[misc]
            )
            for name, mission in plan
        ]

    def end(self, drive: Drive, log: Path, *, is_virtual: bool) -> None:
        distance_m, turned = _true_motion(log) if is_virtual else (math.nan, math.nan)
        if isinstance(drive.config.mission, LineMission):
            question = "Distance from start to end by tape, m"
            self.lines.append(Known(log, distance_m if is_virtual else ask_number(question, 0.05, 1000.0)))
        else:
            question = "Turns really made, e.g. 2.98, negative for clockwise"
            self.spins.append(Known(log, turned if is_virtual else ask_number(question, -100.0, 100.0)))

    def read(self, logs: Sequence[Path]) -> Sequence[Odometry]:
        """Return what the wheels say of each line, then of each turn.

        Raises:
            LogError: A drive is too short, or they have different geometries.
        """
        drives = [read_odometry(known.log) for known in (*self.lines, *self.spins)]
        for drive in drives:
            if drive.rover != drives[0].rover:
                raise LogError(
                    f"{drive.path} and {drives[0].path} have different [rover]: use logs of one geometry"
                )
        for drive in drives[: len(self.lines)]:
            if drive.distance_m < LEAST_DISTANCE_M:
                raise LogError(
                    f"log {drive.path}: the rover drove {drive.distance_m:.2f} m, "
                    f"{LEAST_DISTANCE_M:g} m are needed"
                )
        for drive in drives[len(self.lines) :]:
            if abs(drive.turn_rad) < LEAST_TURN_RAD:
                turned = f"{drive.turn_rad / math.tau:.2f} turns in all"
                raise LogError(
                    f"log {drive.path}: the wheels made {turned}, half a turn in one sense is needed"
                )
        return drives

    def fit(self, record: Sequence[Odometry]) -> WheelsFit:
        lines, spins = record[: len(self.lines)], record[len(self.lines) :]
        radius = turn = None
        if lines:
            distances_m = [known.value for known in self.lines]
            radius = fit_factor(distances_m, [drive.distance_m for drive in lines], self.tape_sd_m)
        if spins:
            turns_rad = [math.tau * known.value for known in self.spins]
            turn = fit_factor(turns_rad, [drive.turn_rad for drive in spins], self.turn_sd_rad)
        return WheelsFit(rover=record[0].rover, radius=radius, turn=turn)

    def title(self, record: Sequence[Odometry], result: WheelsFit) -> str:
        if result.problem:
            return f"Wheels: not calibrated, {result.problem}"
        return "Wheels: radius and base"

    def facts(self, record: Sequence[Odometry], result: WheelsFit) -> Facts:
        facts = []
        for name, factor, drive in (
            ("distance", result.radius, "straight drive"),
            ("turn", result.turn, "drive on the spot"),
        ):
            if factor is not None:
                facts.append((f"known {name} over odometry", _factor_words(factor, drive)))
        if result.skids and result.turn is not None:
            words = f"{1.0 / result.turn.value:.2f} times that of the configuration: the wheels skid in turns"
            facts.append(("effective track", words))
        facts += [(key, str(value)) for key, value in result.values.items()]
        if result.wheels:
            facts.append(("wheels", str(result.wheels)))
        return facts

    def json(self, record: Sequence[Odometry], result: WheelsFit, out: Path | None) -> dict[str, object]:
        return {**dict(self.facts(record, result)), "rover": _section(result), "problem": result.problem}

    def figures(self, record: Sequence[Odometry], result: WheelsFit) -> Sequence[Drawing]:
        return (
            Drawing(
                "Distance",
                "See whether the blue dots are closer to zero than the others, and how far they scatter.",
                lambda: draw_factor(result.radius, "m"),
            ),
            Drawing("Turns", "The same for the turns on the spot.", lambda: draw_factor(result.turn, "rad")),
        )

    def write(self, record: Sequence[Odometry], result: WheelsFit) -> str:
        return comments(self.facts(record, result)) + toml_text({"rover": _section(result)})

    def entries(self, record: Sequence[Odometry], result: WheelsFit, out: Path | None) -> Sequence[Entry]:
        return [Entry("rover", key, value) for key, value in result.values.items()]


def _known_line(text: str) -> Known:
    known = _known("--line", text)
    if known.value < 0.0:
        raise ConfigError(
            f"--line {text}: a distance from start to end is above 0 m: write it without a sign"
        )
    return known


def _known_spin(text: str) -> Known:
    return _known("--spin", text)


def _known(option: str, text: str) -> Known:
    path, _, number = text.rpartition("=")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not path or not math.isfinite(value) or value == 0.0:
        raise ConfigError(f"{option} {text}: write the log and what is known of it, like run.mcap=5.02")
    return Known(Path(path), value)


def _true_motion(path: Path) -> tuple[float, float]:
    """Return the true distance in m from start to end and the number of turns of a virtual drive."""
    poses = read_drive(path).true_poses()
    distance_m = math.hypot(poses.x_m[-1] - poses.x_m[0], poses.y_m[-1] - poses.y_m[0])
    return distance_m, float(poses.yaw_rad[-1] - poses.yaw_rad[0]) / math.tau


def _factor_words(factor: Factor, drive: str) -> str:
    count = len(factor.measured)
    drives = f"{count} {drive}{'' if count == 1 else 's'}"
    return f"{factor.value:.4f} +- {factor.half_width:.4f} (95 %), {drives}"


def _section(result: WheelsFit) -> dict[str, object]:
    return {"wheels": result.wheels} if result.wheels else {**result.values}


def _status(name: str, output: StepOutput) -> str:
    pose = output.estimate
    return f"{name}: x {pose.x_m:+.2f} m  yaw {math.degrees(pose.yaw_rad):+.0f} deg  {output.reason}"
