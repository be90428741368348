"""Logs of this software as columns, for models that are compared with recorded drives."""

import math
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from controllers.settings import OmniRoverSettings, SkidSteerRoverSettings
from drivers.errors import ConfigError, LogError
from drivers.robotino_board.codec import scales
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import AttitudeSample, HeadingSample, RateSample, WheelSample
from rover_hil.config import Config
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogMessage, LogReader
from sim_backends.models.interface import Array, Run
from sim_backends.models.log_columns import DriveLog, LogModel

Rows = dict[str, list[tuple[float, float]]]

LEAST_ROWS = 30
CUT_COUNTS = 4
"""An EA05 board leaves out the two lowest bits of a current."""
HELD = "set"


class _Samples(BaseModel):
    wheels: list[WheelSample] = Field(default=[], alias="WheelSample")
    headings: list[HeadingSample] = Field(default=[], alias="HeadingSample")
    rates: list[RateSample] = Field(default=[], alias="RateSample")
    attitudes: list[AttitudeSample] = Field(default=[], alias="AttitudeSample")


class _Truth(BaseModel):
    t_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    is_new: bool = True


class _SetPoint(BaseModel):
    speed_rad_s: tuple[float, ...]
    delivered: bool = True


def find_logs(path: Path) -> list[Path]:
    """Return a log, or all logs in a folder and the folders below it."""
    return [path] if path.suffix == ".mcap" else sorted(path.rglob("*.mcap"))


def read_logs(model: object, path: Path) -> list[Run]:
    """Return the runs in the logs of a file or folder.

    Raises:
        ConfigError: The model cannot be compared with logs, or a log lacks what it needs.
        LogError: A log cannot be read.
    """
    if not isinstance(model, LogModel):
        raise ConfigError(f"{path}: this model is not compared with logs; give its measurements as a table")
    files = find_logs(path)
    runs = []
    for file in files:
        name = file.stem if len(files) == 1 else file.relative_to(path).with_suffix("").as_posix()
        runs += model.runs_of_log(read_log(file, name))
    return runs


def read_log(path: Path, name: str) -> DriveLog:
    """Return a log as columns, a row for each reading of the first wheel.

    Raises:
        LogError: It cannot be read, or holds no drive.
    """
    log = LogReader(path)
    with restore_config(log) as config:
        facts = _facts(config)
    rows: Rows = defaultdict(list)
    for message in log.messages():
        try:
            _take(message, config, rows)
        except ValidationError as error:
            problem = error.errors()[0]["msg"]
            raise LogError(f"{path} is damaged: {message.topic} at {message.t_ns} ns: {problem}") from error
    first = rows.get("enc1_rad") or rows.get("speed1_rad_s") or []
    if len(first) < LEAST_ROWS:
        raise LogError(f"log {path} holds {len(first)} readings of the first wheel: give the log of a drive")
    return DriveLog(
        name=name,
        columns=_assemble(rows, np.unique([t for t, _ in first]), log.start_ns),
        facts=facts,
        kind=config.rover.kinematics,
    )


def _take(message: LogMessage, config: Config, rows: Rows) -> None:
    match message.topic:
        case "/samples":
            _take_samples(_Samples.model_validate_json(message.data), config, rows)
        case "/truth":
            truth = _Truth.model_validate_json(message.data)
            if truth.is_new:
                rows["x_m"].append((truth.t_ns, truth.x_m))
                rows["y_m"].append((truth.t_ns, truth.y_m))
                rows["psi_rad"].append((truth.t_ns, truth.yaw_rad))
        case "/command" | "/set_point":
            set_point = _SetPoint.model_validate_json(message.data)
            for wheel, speed in enumerate(set_point.speed_rad_s if set_point.delivered else (), start=1):
                rows[f"{HELD}{wheel}_rad_s"].append((message.t_ns, speed))


def _take_samples(samples: _Samples, config: Config, rows: Rows) -> None:
    roles = config.roles
    for wheel in samples.wheels:
        if wheel.device != roles.wheels:
            continue
        number = wheel.wheel + 1
        readings = {
            f"enc{number}_rad": wheel.position_rad,
            f"speed{number}_rad_s": wheel.speed_rad_s,
            f"current{number}_a": wheel.current_a,
            f"voltage{number}_v": wheel.voltage_v,
        }
        for name, value in readings.items():
            if value is not None:
                rows[name].append((wheel.t_ns, value))
    _take_attitude(samples, config, rows)


def _take_attitude(samples: _Samples, config: Config, rows: Rows) -> None:
    roles = config.roles
    for heading in samples.headings:
        if heading.device in roles.headings[:1]:
            rows["compass_deg"].append((heading.t_ns, math.degrees(heading.heading_rad)))
    for rate in samples.rates:
        if rate.device == roles.gyro:
            rows["gyro_z_deg_s"].append((rate.t_ns, math.degrees(rate.rate_z_rad_s)))
    for attitude in samples.attitudes:
        # A sample counts nose down.
        if attitude.pitch_rad is not None:
            rows["pitch_deg"].append((attitude.t_ns, -math.degrees(attitude.pitch_rad)))
        if attitude.roll_rad is not None:
            rows["roll_deg"].append((attitude.t_ns, math.degrees(attitude.roll_rad)))


def _facts(config: Config) -> Mapping[str, float]:
    rover, device = config.rover, config.devices[config.roles.wheels]
    facts: dict[str, float] = {}
    if isinstance(rover, SkidSteerRoverSettings):
        facts |= {"wheel_radius_m": rover.wheel_radius_m, "track_m": rover.track_m}
    if isinstance(rover, OmniRoverSettings):
        facts |= {"wheel_radius_m": rover.wheel_radius_m, "base_radius_m": rover.base_radius_m}
    if isinstance(device, RobotinoBoardSettings):
        counts = scales(device)
        cut = CUT_COUNTS if device.board == "EA05" else 1
        facts |= {
            "gear_ratio": device.gear_ratio,
            "speed_step_rad_s": counts.speed_rad_s,
            "current_step_a": cut * counts.current_a,
        }
    return facts


def _assemble(rows: Rows, t_ns: Array, start_ns: int) -> dict[str, Array]:
    """Put all at the times of the rows: set-points hold, headings stay readings, the rest is linear."""
    columns = {"t_s": (t_ns - start_ns) / 1e9}
    for name, pairs in rows.items():
        times, values = np.array(sorted(pairs)).T
        if name == "compass_deg":
            column = np.full(t_ns.size, np.nan)
            index = np.searchsorted(t_ns, times)
            column[index[index < t_ns.size]] = values[index < t_ns.size]
        elif name.startswith(HELD):
            place = np.searchsorted(times, t_ns, side="right") - 1
            column = np.where(place >= 0, values[np.maximum(place, 0)], 0.0)
        else:
            observations = np.unwrap(values) if name == "psi_rad" else values
            column = np.interp(t_ns, times, observations, left=np.nan, right=np.nan)
        columns[name] = column
    return columns
