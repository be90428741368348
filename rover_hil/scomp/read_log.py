"""Read a drive from one of our own logs."""

import math
from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, ValidationError

from controllers.settings import SkidSteerRoverSettings
from controllers.slip.scomp.compensator import TraceReading
from controllers.slip.scomp.parameters import RoverGeometry
from drivers.errors import LogError
from drivers.samples import AttitudeSample, HeadingSample, RateSample, WheelSample
from rover_hil.config import Config
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader

Array = NDArray[np.float64]
Rows = dict[str, list[tuple[float, float]]]


class _Samples(BaseModel):
    """What a cycle's samples tell about the motion."""

    wheels: list[WheelSample] = Field(default=[], alias="WheelSample")
    headings: list[HeadingSample] = Field(default=[], alias="HeadingSample")
    rates: list[RateSample] = Field(default=[], alias="RateSample")
    attitudes: list[AttitudeSample] = Field(default=[], alias="AttitudeSample")


class _Drift(BaseModel):
    trace: TraceReading | None = None


class _Estimate(BaseModel):
    """What a cycle told of the trace."""

    drift: _Drift | None = None


def read_log_columns(path: Path) -> tuple[dict[str, Array], RoverGeometry]:
    """Return a log as columns in the units of the CSV files, a row per position of the first wheel.

    The heading is that of the first heading device, the rate that of the gyro. Nose and left side up are
    positive. The trace angles are those that the run itself found in its frames.

    Raises:
        LogError: The log is damaged, of another kind of rover, or lacks wheel positions.
    """
    log = LogReader(path)
    with restore_config(log) as config:
        rover = config.rover
    if not isinstance(rover, SkidSteerRoverSettings):
        msg = f"{path} is of a {rover.kinematics} rover: sComp needs four wheels that do not steer"
        raise LogError(msg)
    rows: Rows = defaultdict(list)
    for message in log.messages():
        if message.topic in ("/samples", "/estimate"):
            try:
                if message.topic == "/samples":
                    _take(_Samples.model_validate_json(message.data), config, rows)
                else:
                    _take_trace(_Estimate.model_validate_json(message.data), rows)
            except ValidationError as error:
                problem = error.errors()[0]["msg"]
                msg = f"{path} is damaged: {message.topic} at {message.t_ns} ns: {problem}"
                raise LogError(msg) from error
    if len(rows["enc1_rad"]) < 2:
        msg = f"log {path} holds no positions of the first wheel: give the log of a drive"
        raise LogError(msg)
    geometry = RoverGeometry(wheel_radius_m=rover.wheel_radius_m, track_m=rover.track_m)
    return _assemble(rows, log.start_ns), geometry


def _take(samples: _Samples, config: Config, rows: Rows) -> None:
    for wheel in samples.wheels:
        if wheel.device == config.roles.wheels and wheel.position_rad is not None:
            rows[f"enc{wheel.wheel + 1}_rad"].append((wheel.t_ns, wheel.position_rad))
    for heading in samples.headings:
        if heading.device in config.roles.headings[:1]:
            rows["compass_deg"].append((heading.t_ns, math.degrees(heading.heading_rad)))
    for rate in samples.rates:
        if rate.device == config.roles.gyro:
            rows["gyro_z_deg_s"].append((rate.t_ns, math.degrees(rate.rate_z_rad_s)))
    for attitude in samples.attitudes:
        if attitude.pitch_rad is not None:
            rows["pitch_deg"].append((attitude.t_ns, -math.degrees(attitude.pitch_rad)))
        if attitude.roll_rad is not None:
            rows["roll_deg"].append((attitude.t_ns, math.degrees(attitude.roll_rad)))


def _take_trace(estimate: _Estimate, rows: Rows) -> None:
    trace = None if estimate.drift is None else estimate.drift.trace
    if trace is not None and trace.detected and trace.theta_rad is not None:
        rows["beta_ftrace_deg"].append((trace.t_ns, math.degrees(trace.theta_rad)))


def _assemble(rows: Rows, start_ns: int) -> dict[str, Array]:
    """Put each sample into the first row at or after its time; wheels and angles between two are linear."""
    t_ns = np.unique([t for t, _ in rows["enc1_rad"]])
    columns = {"t_s": (t_ns - start_ns) / 1e9}
    for name, pairs in rows.items():
        times, values = np.array(sorted(pairs)).T
        if name in ("compass_deg", "beta_ftrace_deg"):
            index = np.searchsorted(t_ns, times)
            column = np.full(len(t_ns), np.nan)
            column[index[index < len(t_ns)]] = values[index < len(t_ns)]
            columns[name] = column
        else:
            columns[name] = np.interp(t_ns, times, values)
    return columns
