"""`rover-hil calibrate mounting`: mounting, scale and bias of the gyro, from whole turns between rests."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from controllers.control_loop import StepOutput
from drivers.errors import ConfigError
from drivers.samples import Sample
from rover_hil.config import Config
from rover_hil.console.ask import ask_number
from rover_hil.console.options import LOG_SUFFIX, number_option
from rover_hil.console.steps import show_steps
from rover_hil.drives.arrays import Array
from rover_hil.drives.toml_text import toml_text
from rover_hil.pages.picture import Drawing
from rover_hil.ready.by_hand import record_by_hand
from rover_hil.ready.mounting.figures import draw_axis, draw_residuals, draw_turns
from rover_hil.ready.mounting.fit import COUNTED, MountingFit, Turn, find_turns, fit_mounting, turns_by
from rover_hil.ready.mounting.record import InertialTurns, read_inertial, sensor_of
from rover_hil.ready.options import DeviceOption, command
from rover_hil.ready.procedure import (
    Drive,
    Entry,
    Facts,
    FileProcedure,
    Request,
    comments,
)
from rover_hil.ready.turns import on_firm_floor, turning_config, with_frames

TURN_SD_DEG = 2.0
"""Of turns that were counted against a mark on the ground, and of a compass."""
EXACT_SD_DEG = 0.1
"""Of simulated turns."""
LEAST_COUNTED_TURN = 0.4
LONGEST_BY_HAND_S = 1800.0


@command("source", "virtual", "drive", "by_hand", "out", "enter")
def calibrate(
    turns: Annotated[int, number_option("Whole turns in each sense.", "turns", 1, 50)] = 3,
    made: Annotated[
        str | None,
        typer.Option(help="Turns really made, in order, counter-clockwise positive, like 3,-3."),
    ] = None,
    device: DeviceOption = None,
) -> "MountingCalibration":
    """Find mounting, scale and bias of the gyro, from whole turns between rests.

    A camera or a compass measures the turns, or you count them. The sensor is that of roles.gyro, or of
    --device. The page with the picture is written before the file. Exit code 1: the result is not sure; the
    file is not written.

    Example: `rover-hil calibrate mounting robotino --virtual --out mounting.toml`

    Data: turns of your rover on the ground, or a log of them; docs/how-to/calibrate_the_gyro.md.
    """
    return MountingCalibration(device, turns, None if made is None else _numbers(made))


@dataclass(frozen=True, slots=True)
class MountingRecord:
    """What a log holds of the sensor, and the turns between rests with the bias at each rest."""

    inertial: InertialTurns
    turns: tuple[Turn, ...]
    bias_rad_s: Array


@dataclass
class MountingCalibration(FileProcedure[MountingRecord, MountingFit]):
    """Mounting, scale and bias of an inertial sensor.

    Attributes:
        device: Name of the sensor; None for `roles.gyro`.
        turns: Whole turns in each sense.
        made: The turns really made, in order, counter-clockwise positive; None to use a camera or a compass
            in the log, or to ask.
    """

    room_fix = "turn it yourself with --by-hand"

    device: str | None
    turns: int
    made: Sequence[float] | None

    def configure(self, request: Request, config: Config | None) -> Path | None:
        self._is_log = request.source.endswith(LOG_SUFFIX)
        if config is not None:
            self.device, _ = sensor_of(config, self.device)
        return request.out

    def drives(self, config: Config) -> Sequence[Drive]:
        device = str(self.device)
        roles = config.roles.model_copy(update={"gyro": None})
        turning = turning_config(config.model_copy(update={"roles": roles}), device, self.turns)
        drive = Drive(
            name="turns",
            config=turning,
            limit_s=turning.loop.time_limit_s,
            words=f"turning the rover {self.turns} times in each sense",
            status=_status,
            simulated=lambda simulation: with_frames(
                config, device, on_firm_floor(simulation), "acceleration", "rate"
            ),
            must_finish=False,
            needs=(device, *config.roles.headings, *config.roles.fixes),
        )
        return (drive,)

    def record_by_hand(self, config: Config, log: Path) -> None:
        names = tuple(dict.fromkeys((str(self.device), *config.roles.headings)))
        with show_steps("connecting") as step:

            def take(samples: list[Sample]) -> bool:
                step(f"rest, {self.turns} turns left, rest, {self.turns} turns right, rest; then ctrl-C")
                return False

            record_by_hand(config, names, log, LONGEST_BY_HAND_S, take)

    def read(self, logs: Sequence[Path]) -> MountingRecord:
        inertial = read_inertial(logs[0], self.device)
        return MountingRecord(inertial, *find_turns(inertial))

    def ask(self, record: MountingRecord) -> None:
        if self.made is not None or record.inertial.references:
            return
        if self._is_log:
            raise ConfigError(
                f"{record.inertial.path} holds no compass or camera that saw the turns: "
                "give them with --made, like "
                + ",".join("3" if number % 2 == 0 else "-3" for number in range(len(record.turns)))
            )
        self.made = [
            ask_number(
                f"Turns made from {turn.start_s:.0f} to {turn.end_s:.0f} s, counter-clockwise positive",
                -100.0,
                100.0,
            )
            for turn in record.turns
        ]

    def fit(self, record: MountingRecord) -> MountingFit:
        known_rad, reference, sd_deg = self._known(record)
        return fit_mounting(
            record.inertial, record.turns, record.bias_rad_s, known_rad, reference, math.radians(sd_deg)
        )

    def _known(self, record: MountingRecord) -> tuple[Array, str, float]:
        """Return what is known of each turn in rad, what measured it, and its standard deviation in deg."""
        turns = record.turns
        if self.made is not None:
            are_turns = all(math.isfinite(turn) and abs(turn) > LEAST_COUNTED_TURN for turn in self.made)
            if len(self.made) != len(turns) or not are_turns:
                times = ", ".join(f"{turn.start_s:.0f} to {turn.end_s:.0f} s" for turn in turns)
                raise ConfigError(
                    f"--made gives {len(self.made)} turns, the log holds {len(turns)}: "
                    f"{times}; give one for each"
                )
            return math.tau * np.array(self.made), COUNTED, TURN_SD_DEG
        name = next(iter(record.inertial.references))
        known_rad = turns_by(record.inertial, turns, name)
        if not np.isfinite(known_rad).all() or (np.abs(known_rad) < 1.0).any():
            raise ConfigError(f"the {name} did not see every turn: give the turns with --made, like 3,-3")
        return known_rad, name, EXACT_SD_DEG if name.startswith("simulated") else TURN_SD_DEG

    def title(self, record: MountingRecord, result: MountingFit) -> str:
        if result.problem:
            return f"Gyro: not calibrated, {result.problem}"
        return "Gyro: mounting, scale and bias"

    def facts(self, record: MountingRecord, result: MountingFit) -> Facts:
        axis = int(np.argmax(np.abs(result.up)))
        sign = "" if result.up[axis] > 0.0 else "-"
        facts = [
            ("sensor", f"{record.inertial.device}, turns by {result.reference}"),
            ("turns", ", ".join(f"{turn / math.tau:+.2f}" for turn in result.known_rad.tolist())),
            ("axis that points up", f"{sign}{'xyz'[axis]}"),
            (
                "mounting",
                f"roll {result.roll_deg:.2f} deg, pitch {result.pitch_deg:.2f} deg, "
                f"+- {result.tilt_sd_deg:.2f} deg from turn to turn",
            ),
            ("gyro scale", f"{result.scale:.4f} +- {result.scale_sd:.4f} (one standard deviation)"),
            (
                "bias at rest",
                f"{result.bias_deg_s:+.3f} deg/s, {result.bias_sd_deg_s:.3f} deg/s from rest to rest",
            ),
        ]
        if np.isfinite(result.gravity).all():
            slope_deg = math.degrees(math.acos(float(np.clip(result.up @ result.gravity, -1.0, 1.0))))
            facts.append(("gravity at rest", f"{slope_deg:.1f} deg from this axis: slope of the ground"))
        return facts

    def json(self, record: MountingRecord, result: MountingFit, out: Path | None) -> dict[str, object]:
        device = {"device": record.inertial.device}
        return {**device, **_values(result), "scale_sd": result.scale_sd, "problem": result.problem}

    def figures(self, record: MountingRecord, result: MountingFit) -> Sequence[Drawing]:
        return (
            Drawing(
                "Turns",
                "See whether every turn is shaded, and whether the rate is level between them.",
                lambda: draw_turns(record.inertial, result),
            ),
            Drawing(
                "Missed in each turn",
                "See whether the blue dots are closer to zero than the others. A pattern by sense is a bias.",
                lambda: draw_residuals(result),
            ),
            Drawing(
                "Axis of the turns",
                "See whether the dots lie together. The cross is apart from them where the ground slopes.",
                lambda: draw_axis(result),
            ),
        )

    def write(self, record: MountingRecord, result: MountingFit) -> str:
        section = toml_text({"devices": {record.inertial.device: _values(result)}})
        return comments(self.facts(record, result)) + section

    def entries(self, record: MountingRecord, result: MountingFit, out: Path | None) -> Sequence[Entry]:
        section = f"devices.{record.inertial.device}"
        return [Entry(section, key, value) for key, value in _values(result).items()]


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ConfigError(f"--made {text}: write the turns in order, like 3,-3") from None


def _values(fit: MountingFit) -> dict[str, float]:
    """Return the new values of the section of the device."""
    # Adding zero makes 0 of -0.
    roll_deg, pitch_deg = (round(angle, 2) + 0.0 for angle in (fit.roll_deg, fit.pitch_deg))
    return {
        "mounting_roll_deg": roll_deg,
        "mounting_pitch_deg": pitch_deg,
        "gyro_scale": round(fit.scale, 4),
        "gyro_bias_deg_s": round(fit.bias_deg_s, 3),
    }


def _status(output: StepOutput) -> str:
    return f"yaw {math.degrees(output.estimate.yaw_rad):+.0f} deg  {output.reason}"
