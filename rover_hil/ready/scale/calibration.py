"""`rover-hil calibrate scale`: the factor of the travel that a ground camera measures."""

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from controllers.control_loop import StepOutput
from controllers.motion.settings import LineMission
from drivers.clock import date_of, wall_time_ns
from drivers.errors import ConfigError, LogError
from rover_hil.config import Config
from rover_hil.console.options import number_option
from rover_hil.drives.toml_text import toml_text
from rover_hil.pages.picture import Drawing
from rover_hil.ready.options import command
from rover_hil.ready.procedure import Drive, Entry, Facts, FileProcedure, Request, comments
from rover_hil.ready.scale.figures import draw_scale, draw_view
from rover_hil.ready.scale.fit import ScaleFit, fit_scale
from rover_hil.ready.scale.record import CameraTravels, read_scale_record
from rover_hil.ready.turns import DEFAULT_SPEED_M_S, on_firm_floor
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from sim_backends.settings import SimulationSettings

SECTION = "ground_motion.tolerance"
SPARE_S = 30.0
FIRM_RUT_M = 0.001
"""Sinkage of the simulated camera on firm ground: the least of its settings."""


@command("config_unless_logs", "virtual", "drive", "out", "enter")
def calibrate(
    log: Annotated[
        list[Path] | None,
        typer.Option(help="Use this log of a drive instead of driving; repeat it."),
    ] = None,
    length: Annotated[float, number_option("Length of the drive, m.", "m", 1.5, 50.0)] = 3.0,
) -> "ScaleCalibration":
    """Find the scale of the travel that a ground camera measures.

    The travel by the camera is compared with pose fixes, or with the wheels on ground that does not slip:
    height, pitch and focal length act on it as one factor. The page with the picture is written before the
    file. Exit code 1: the scale is not sure; the file is not written.

    Example: `rover-hil calibrate scale robotino-camera --virtual --out scale.toml`

    Data: a drive of your rover with a camera and [ground_motion], or logs of such drives;
    docs/how-to/calibrate_a_ground_camera.md.
    """
    return ScaleCalibration(length, log or ())


@dataclass
class ScaleCalibration(FileProcedure[Sequence[CameraTravels], ScaleFit]):
    """Scale of a ground camera.

    Attributes:
        length_m: Length of the line that is driven.
        logs: Logs of earlier drives, used instead.
    """

    takes_log = False
    room_fix = "lower --length"

    length_m: float
    logs: Sequence[Path]

    def configure(self, request: Request, config: Config | None) -> Path | None:
        if config is None or config.ground_motion is None:
            raise ConfigError(
                f"{request.source}: the scale is of a camera with [ground_motion]: "
                "name a configuration with it, and its rig"
            )
        self._rig = config.ground_motion.rig
        return request.out

    def drives(self, config: Config) -> Sequence[Drive]:
        speed_m_s = DEFAULT_SPEED_M_S if config.mission is None else config.mission.speed_m_s
        line = LineMission(type="line", length_m=self.length_m, speed_m_s=speed_m_s, heading="along_path")
        drive = Drive(
            name="line",
            config=config.model_copy(update={"mission": line, "slip": None, "scomp": None}),
            limit_s=config.safety.settle_s + 4.0 * self.length_m / speed_m_s + SPARE_S,
            words="driving a line",
            status=_status,
            simulated=_on_firm_ground,
            needs=() if config.roles.camera is None else (config.roles.camera,),
        )
        return (drive,)

    def read(self, logs: Sequence[Path]) -> Sequence[CameraTravels]:
        """Return the travels of each log.

        Raises:
            LogError: A log is damaged, of another rig, or holds no frames.
        """
        records = [read_scale_record(path) for path in logs]
        for record in records:
            if record.rig != self._rig:
                raise LogError(
                    f"log {record.path} is of another rig: a scale is of one camera as it is mounted"
                )
        return records

    def fit(self, record: Sequence[CameraTravels]) -> ScaleFit:
        return fit_scale(record)

    def title(self, record: Sequence[CameraTravels], result: ScaleFit) -> str:
        if result.problem:
            return f"Camera: no scale, {result.problem}"
        return "Camera: scale of the measured travel"

    def facts(self, record: Sequence[CameraTravels], result: ScaleFit) -> Facts:
        day = _day(record)
        age = (date_of(wall_time_ns()) - day).days
        travels = [travel for each in record for travel in each.travels]
        valid = sum(travel.camera_m is not None for travel in travels)
        facts = [
            ("known travel", ", ".join(dict.fromkeys(each.reference for each in record))),
            ("pairs of frames", f"{valid} of {len(travels)} measured, {result.distance_m:.2f} m in pieces"),
        ]
        if result.factor is not None:
            scale, height_m = result.factor.value, record[0].height_m
            facts += [
                ("scale", f"{scale:.4f} +- {result.factor.half_width:.4f} (95 %)"),
                ("height that fits", f"{scale * height_m:.3f} m, rig {height_m:.3f} m"),
                ("course of the camera", f"{result.sideways_deg:+.2f} deg to the left of the known one"),
            ]
        facts.append(("driven on", f"{day}, {age} days ago"))
        return facts

    def json(self, record: Sequence[CameraTravels], result: ScaleFit, out: Path | None) -> dict[str, object]:
        values = {} if result.problem else _values(result, _day(record))
        return {**dict(self.facts(record, result)), SECTION: values, "problem": result.problem}

    def figures(self, record: Sequence[CameraTravels], result: ScaleFit) -> Sequence[Drawing]:
        caption = (
            "See whether the blue dots lie around zero, without a trend. A trend, "
            "or single pieces far off, is ground that slips."
        )
        seen = (
            "Green points follow the ground. Magenta is left out: what never moves in the picture, and "
            "crosses where something moves with the rover. Clean the lens or turn the camera if it is much."
        )
        return (
            Drawing("Camera against known travel", caption, lambda: draw_scale(result)),
            Drawing("What the camera sees", seen, lambda: draw_view(record[-1].picture)),
        )

    def write(self, record: Sequence[CameraTravels], result: ScaleFit) -> str:
        tolerance = {"ground_motion": {"tolerance": _values(result, _day(record))}}
        return comments(self.facts(record, result)) + toml_text(tolerance)

    def entries(self, record: Sequence[CameraTravels], result: ScaleFit, out: Path | None) -> Sequence[Entry]:
        return [Entry(SECTION, key, value) for key, value in _values(result, _day(record)).items()]


def _on_firm_ground(simulation: SimulationSettings) -> SimulationSettings:
    firm = on_firm_floor(simulation)
    devices = {
        name: settings.model_copy(update={"rut_depth_m": FIRM_RUT_M, "sinkage_per_slip_m": 0.0})
        if isinstance(settings, CameraEmulatorSettings)
        else settings
        for name, settings in firm.devices.items()
    }
    return firm.model_copy(update={"devices": devices})


def _day(records: Sequence[CameraTravels]) -> dt.date:
    return min(date_of(record.wall_ns) for record in records)


def _values(fit: ScaleFit, day: dt.date) -> dict[str, float | str]:
    if fit.factor is None:
        return {}
    return {
        "scale": round(fit.factor.value, 4),
        "scale_sd": round(fit.sd, 4),
        "scale_date": day.isoformat(),
    }


def _status(output: StepOutput) -> str:
    return f"x {output.estimate.x_m:+.2f} m  {output.reason}"
