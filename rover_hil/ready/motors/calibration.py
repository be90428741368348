"""`rover-hil calibrate motors`: the field of motor currents at a compass."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from controllers.control_loop import StepOutput
from controllers.motion.settings import WaypointsMission
from drivers.clock import date_of, wall_time_ns
from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.console.options import number_option
from rover_hil.drives.arrays import rms
from rover_hil.drives.toml_text import toml_text
from rover_hil.pages.picture import Drawing
from rover_hil.ready.compass.record import compass_of
from rover_hil.ready.motors.figures import draw_motor_errors, draw_motor_fields
from rover_hil.ready.motors.fit import FieldHeadings, MotorFieldFit, fit_motor_fields, read_motor_drive
from rover_hil.ready.options import DeviceOption, OptionalOutOption, command
from rover_hil.ready.procedure import Drive, Entry, Facts, FileProcedure, Request
from rover_hil.ready.turns import DEFAULT_SPEED_M_S, on_firm_floor, turning_config, with_frames, with_gains

WAIT_S = 3.0
SPARE_S = 60.0
SLOWNESS = 6.0
"""Longest time of the drive over that of its sides: a skidding rover turns slowly."""


@command("source", "log", "virtual", "drive", "enter")
def calibrate(
    device: DeviceOption = None,
    side: Annotated[float, number_option("Side of the squares, m.", "m", 0.3, 50.0)] = 1.0,
    out: OptionalOutOption = None,
) -> "MotorCalibration":
    """Find the field of the motor currents at a calibrated compass, in two squares.

    A calibrated compass is compared with the gyro over the motor currents, on a square to the left and one to
    the right, and the field of each motor per ampere is found. The page with the picture is written before
    the file. Exit code 1: the error on held-out parts is too large, or the motors do not matter; the file is
    not written.

    Example: `rover-hil calibrate motors el-dorado --virtual --out motors.toml`

    Data: a drive of your rover, or a log of one; docs/how-to/calibrate_the_compass.md.
    """
    return MotorCalibration(device, side)


@dataclass
class MotorCalibration(FileProcedure[FieldHeadings, MotorFieldFit]):
    """The field of each motor at a compass, per ampere of its current.

    Attributes:
        device: Name of the compass; None where there is only one.
        side_m: Side of the two squares that are driven, one to the left and one to the right.
    """

    room_fix = "lower --side"

    device: str | None
    side_m: float

    def configure(self, request: Request, config: Config | None) -> Path:
        out = request.out
        if config is not None:
            self.device, _ = compass_of(config, self.device)
            out = out or Path(f"{Path(request.source).stem}-{self.device}-motors.toml")
        if out is None:
            raise ConfigError("--out is missing: name the file to write")
        return out

    def drives(self, config: Config) -> Sequence[Drive]:
        device, side_m = str(self.device), self.side_m
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
        # The calibration of the compass stays: what it leaves is to be explained.
        base = turning_config(config, device, 1)
        devices = {**base.devices, device: config.devices[device]}
        changes = {"mission": with_gains(mission, config), "devices": devices}
        drive = Drive(
            name="the squares",
            config=base.model_copy(update=changes),
            limit_s=SLOWNESS * 8.0 * side_m / speed_m_s + 8.0 * WAIT_S + SPARE_S,
            words="driving two squares",
            status=_status,
            simulated=lambda simulation: with_frames(
                config, device, on_firm_floor(simulation), "rate", "angle", "magnetic"
            ),
            needs=(device,),
        )
        return (drive,)

    def read(self, logs: Sequence[Path]) -> FieldHeadings:
        return read_motor_drive(logs[0], self.device)

    def fit(self, record: FieldHeadings) -> MotorFieldFit:
        return fit_motor_fields(record, date_of(wall_time_ns()).isoformat())

    def title(self, record: FieldHeadings, result: MotorFieldFit) -> str:
        return f"Motors at the compass: {result.problem or 'corrected'}"

    def facts(self, record: FieldHeadings, result: MotorFieldFit) -> Facts:
        facts = [
            ("compass", f"{result.fields.device}, against the {result.reference}"),
            ("error without the currents", f"{rms(result.before_deg):.2f} deg rms"),
            ("error on held-out parts with them", f"{rms(result.after_deg):.2f} deg rms"),
            ("greatest change of the heading", f"{result.largest_deg:.1f} deg"),
        ]
        pairs = zip(result.fields.per_ampere, result.fields.per_ampere_sd, strict=True)
        for motor, (field, sd) in enumerate(pairs, start=1):
            share, share_sd = 100 * math.hypot(*field), 100 * math.hypot(*sd)
            facts.append((f"motor {motor}", f"{share:.1f} +- {share_sd:.1f} % of the earth's field per A"))
        if not result.separate.all():
            together = ", ".join(
                str(motor) for motor, is_separate in enumerate(result.separate, start=1) if not is_separate
            )
            words = f"motors {together} had no current of their own: the correction holds for such drives"
            facts.append(("not separated", words))
        return facts

    def json(self, record: FieldHeadings, result: MotorFieldFit, out: Path | None) -> dict[str, object]:
        return {
            "device": result.fields.device,
            "per_ampere": result.fields.per_ampere,
            "per_ampere_sd": result.fields.per_ampere_sd,
            "before_rms_deg": rms(result.before_deg),
            "rms_deg": rms(result.after_deg),
            "problem": result.problem,
            "file": None if result.problem else str(out),
        }

    def figures(self, record: FieldHeadings, result: MotorFieldFit) -> Sequence[Drawing]:
        return (
            Drawing(
                "Error of the heading and currents",
                "See whether the error below follows the currents above, and whether it does so no more with "
                "the correction. Each part was corrected with a fit that did not see it.",
                lambda: draw_motor_errors(result),
            ),
            Drawing(
                "Field of each motor",
                "Share of the earth's horizontal field per ampere, with two standard deviations. A bar as "
                "long as the distance from zero means that the drive did not show this motor.",
                lambda: draw_motor_fields(result),
            ),
        )

    def write(self, record: FieldHeadings, result: MotorFieldFit) -> str:
        return toml_text(result.fields.model_dump(), digits=5)

    def entries(self, record: FieldHeadings, result: MotorFieldFit, out: Path | None) -> Sequence[Entry]:
        return (Entry("filter", "motor_fields", str(out)),)


def _status(output: StepOutput) -> str:
    pose = output.estimate
    return f"x {pose.x_m:+.2f} m  y {pose.y_m:+.2f} m  {output.reason}"
