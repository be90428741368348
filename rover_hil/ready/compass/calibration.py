"""`rover-hil calibrate compass`: hard and soft iron or deviation, from whole turns."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from controllers.control_loop import StepOutput
from drivers.angles import wrap_rad
from drivers.clock import date_of, seconds, wall_time_ns
from drivers.errors import ConfigError
from drivers.samples import RateSample, Sample
from rover_hil.config import Config
from rover_hil.console.options import number_option
from rover_hil.console.steps import show_steps
from rover_hil.drives.toml_text import toml_text
from rover_hil.pages.picture import Drawing
from rover_hil.ready.by_hand import record_by_hand
from rover_hil.ready.compass.coverage import Coverage
from rover_hil.ready.compass.figures import draw_deviation, draw_errors, draw_field
from rover_hil.ready.compass.fit import CompassFit, fit_compass
from rover_hil.ready.compass.parameters import COMPASS_FIT
from rover_hil.ready.compass.record import CompassTurns, compass_of, read_record
from rover_hil.ready.options import DeviceOption, OptionalOutOption, command
from rover_hil.ready.procedure import Drive, Entry, Facts, FileProcedure, Request
from rover_hil.ready.turns import on_firm_floor, turning_config, with_frames

SLOWEST_BY_HAND_S = 120.0
"""Longest time of a turn by hand."""


@command("source", "log", "virtual", "drive", "by_hand", "enter")
def calibrate(
    device: DeviceOption = None,
    turns: Annotated[int, number_option("Whole turns in each sense.", "turns", 2, 50)] = 3,
    dip: Annotated[
        float | None,
        number_option("Dip of the earth's field at this place, for tilt compensation, deg.", "deg", -85, 85),
    ] = None,
    out: OptionalOutOption = None,
) -> "CompassCalibration":
    """Calibrate a compass by whole turns: hard and soft iron, or a deviation table.

    The rover turns on the spot, with all that belongs on it and its motors on. Each turn is judged with a
    calibration that did not see it. The page with the picture is written before the file. Exit code 1: the
    error on held-out turns is above 3 deg, or directions are missing; the file is not written.

    Example: `rover-hil calibrate compass el-dorado --virtual --out compass.toml`

    Data: turns of your rover, driven or by hand, or a log of them; docs/how-to/calibrate_the_compass.md.
    """
    return CompassCalibration(device, turns, dip)


@dataclass
class CompassCalibration(FileProcedure[CompassTurns, CompassFit]):
    """Hard and soft iron of a magnetometer, or the deviation of a compass.

    Attributes:
        device: Name of the compass; None where there is only one.
        turns: Whole turns in each sense.
        dip_deg: Angle of the earth's field below the horizontal, or None.
    """

    room_fix = "turn it yourself with --by-hand"

    device: str | None
    turns: int
    dip_deg: float | None

    def configure(self, request: Request, config: Config | None) -> Path:
        out = request.out
        if config is not None:
            self.device, _ = compass_of(config, self.device)
            present = getattr(config.devices[self.device], "calibration", None)
            out = out or Path(present or f"{Path(request.source).stem}-{self.device}.toml")
        if out is None:
            raise ConfigError("--out is missing: name the file to write")
        return out

    def drives(self, config: Config) -> Sequence[Drive]:
        device, coverage, wanted = str(self.device), Coverage(), 2 * self.turns
        turning = turning_config(config, device, self.turns)

        def status(output: StepOutput) -> str:
            coverage.add(output.estimate.yaw_rad)
            return f"{coverage.text(wanted)}  {output.reason}"

        drive = Drive(
            name="turns",
            config=turning,
            limit_s=turning.loop.time_limit_s,
            words=f"turning the rover {self.turns} times in each sense",
            status=status,
            simulated=lambda simulation: with_frames(
                config, device, on_firm_floor(simulation), "rate", "angle", "magnetic"
            ),
            must_finish=False,
            needs=(device,),
        )
        return (drive,)

    def record_by_hand(self, config: Config, log: Path) -> None:
        coverage, wanted = Coverage(), 2 * self.turns
        names = tuple(dict.fromkeys(filter(None, (self.device, config.roles.gyro))))
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

            record_by_hand(config, names, log, SLOWEST_BY_HAND_S * wanted, take)

    def read(self, logs: Sequence[Path]) -> CompassTurns:
        return read_record(logs[0], self.device)

    def fit(self, record: CompassTurns) -> CompassFit:
        return fit_compass(record, date_of(wall_time_ns()), self.dip_deg)

    def title(self, record: CompassTurns, result: CompassFit) -> str:
        if result.problem:
            return f"Compass: not calibrated, {result.problem}"
        return f"Calibration of '{record.device}'"

    def facts(self, record: CompassTurns, result: CompassFit) -> Facts:
        facts = [
            ("compass", f"{record.device}, against the {record.reference}"),
            ("turns", f"{result.turns}, {100 * result.covered:.0f} % of the directions"),
        ]
        if math.isfinite(result.before_rms_deg):
            facts.append(("error without calibration", f"{result.before_rms_deg:.1f} deg rms"))
        if math.isfinite(result.rms_deg):
            facts.append(("error on held-out turns", f"{result.rms_deg:.2f} deg rms"))
        if result.strength_counts:
            x, y, z = getattr(result.calibration, "hard_iron_counts", (0.0, 0.0, 0.0))
            share = math.hypot(x, y) / result.strength_counts
            facts.append(
                ("hard iron", f"{x:.0f}, {y:.0f}, {z:.0f} counts, {share:.1f} times the horizontal field")
            )
        elif result.calibration is not None:
            facts.append(
                ("lag of the compass", f"{result.lag_s:.2f} s; in the configuration: filter.heading_lag_s")
            )
        return facts

    def json(self, record: CompassTurns, result: CompassFit, out: Path | None) -> dict[str, object]:
        return {
            "device": record.device,
            "rms_deg": result.rms_deg,
            "before_rms_deg": result.before_rms_deg,
            "turns": result.turns,
            "covered": result.covered,
            "lag_s": result.lag_s,
            "problem": result.problem,
            "file": None if result.problem else str(out),
        }

    def figures(self, record: CompassTurns, result: CompassFit) -> Sequence[Drawing]:
        return (
            Drawing(
                "Field in the sensor",
                "See whether the dots on the right lie on the circle, all around. On the left the rover's "
                "magnets shift them and its iron makes an ellipse of the circle.",
                lambda: draw_field(result),
            ),
            Drawing(
                "Deviation",
                "The table that is added to the readings. A smooth curve of one or two waves is usual.",
                lambda: draw_deviation(result),
            ),
            Drawing(
                "Error over the heading",
                "See whether waves are left below. What is left without a wave is noise of the sensor. The "
                "constant part is not counted: the filter estimates it while driving.",
                lambda: draw_errors(result),
            ),
        )

    def write(self, record: CompassTurns, result: CompassFit) -> str:
        return "" if result.calibration is None else toml_text(result.calibration.model_dump(), digits=6)

    def entries(self, record: CompassTurns, result: CompassFit, out: Path | None) -> Sequence[Entry]:
        return (Entry(f"devices.{record.device}", "calibration", str(out)),)
