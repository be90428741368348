"""Reads a log into arrays."""

from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from controllers.control_loop import StepOutput
from controllers.motion.kinematics import make_kinematics
from controllers.motion.limits import Limit
from controllers.safety import Mode
from controllers.settings import SkidSteerRoverSettings
from controllers.slip.effort.compensator import SlipReport
from controllers.slip.scomp.compensator import ScompReport
from drivers.clock import seconds
from drivers.driver import Health
from drivers.errors import LogError
from drivers.link import LinkChange
from drivers.samples import HeadingSample, RateSample, WheelSample
from rover_hil.config import Config
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.report.run_data import (
    Cycles,
    DriftData,
    InnovationData,
    LinkEvent,
    RunData,
    SlipData,
    ToldSlip,
    WheelData,
)
from rover_hil.report.tracks import (
    Series,
    Track,
    finite_rows,
    integrate_rate,
    local_headings,
    speed_from_positions,
)
from rover_hil.run.executive import RunResult

SLOWEST_RIM_M_S, SLOWEST_M_S = 0.03, 0.01
"""Below the first the true slip, below the second the true slip angle says nothing."""
SKID_STEER_PLACES = ("front left", "front right", "rear left", "rear right")


class _Samples(BaseModel):
    """The samples of one cycle that a report shows."""

    wheels: list[WheelSample] = Field(default=[], alias="WheelSample")
    headings: list[HeadingSample] = Field(default=[], alias="HeadingSample")
    rates: list[RateSample] = Field(default=[], alias="RateSample")


class _Truth(BaseModel):
    """The truth of a simulated rover, or of an overhead camera, which repeats itself when it saw nothing."""

    t_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    is_new: bool = True
    velocity_x_m_s: float | None = None
    velocity_y_m_s: float | None = None
    wheel_speed_rad_s: tuple[float, ...] = ()
    slip: tuple[float, ...] = ()


class _SetPoint(BaseModel):
    speed_rad_s: tuple[float, ...]


class _Cycle(BaseModel):
    late_ns: int
    work_ns: int


_STEP_OUTPUT = TypeAdapter(StepOutput)
_HEALTH = TypeAdapter(list[Health])
_LINK = TypeAdapter(LinkChange)
_END = TypeAdapter(RunResult)


def read_run(path: Path) -> RunData:
    """Read the log at `path`.

    Raises:
        LogError: It cannot be read, or holds no complete cycle.
    """
    log = LogReader(path)
    with restore_config(log) as config:
        collector = _Collector(config, log.start_ns)
    for message in log.messages():
        try:
            collector.take(message)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"])) or "its content"
            msg = f"{path} is damaged: {message.topic} at {message.t_ns} ns: {place}: {first['msg']}"
            raise LogError(msg) from error
    return collector.result(log)


class _Collector:
    """Takes the messages of a log one by one; rows of numbers are kept by kind and wheel or name."""

    def __init__(self, config: Config, start_ns: int) -> None:
        self._config = config
        self._start_ns = start_ns
        self._last_ns = start_ns
        self._rows: defaultdict[tuple[str, int | str], list[tuple[float, ...]]] = defaultdict(list)
        self._slips: list[tuple[float, SlipReport]] = []
        self._drift_reasons: list[str] = []
        self._uncompared: Counter[str] = Counter()
        self._modes: list[Mode] = []
        self._reasons: list[str] = []
        self._limits: list[Limit] = []
        self._health: list[Health] = []
        self._link_events: list[LinkEvent] = []
        self._watchdog_s: list[float] = []
        self._end: RunResult | None = None

    def take(self, message: LogMessage) -> None:
        """Take one message; topics that the report does not show are passed over."""
        self._last_ns = max(self._last_ns, message.t_ns)
        t_s = self._seconds(message.t_ns)
        kind, _, device = message.topic[1:].partition("/")
        match kind:
            case "samples":
                self._take_samples(_Samples.model_validate_json(message.data))
            case "estimate":
                self._take_output(_STEP_OUTPUT.validate_json(message.data))
            case "command" | "set_point":
                command = _SetPoint.model_validate_json(message.data)
                self._add_wheels("set_point", t_s, command.speed_rad_s)
            case "truth":
                self._take_truth(_Truth.model_validate_json(message.data))
            case "cycle":
                cycle = _Cycle.model_validate_json(message.data)
                self._rows["cycle", ""].append((cycle.late_ns / 1e3, cycle.work_ns / 1e3))
            case "health":
                self._health = _HEALTH.validate_json(message.data)
            case "link":
                change = _LINK.validate_json(message.data)
                self._link_events.append(
                    LinkEvent(t_s=t_s, device=device, up=change.up, reason=change.reason)
                )
            case "watchdog":
                self._watchdog_s.append(t_s)
            case "end":
                self._end = _END.validate_json(message.data)

    def result(self, log: LogReader) -> RunData:
        """Return everything taken, as arrays.

        Raises:
            LogError: There was no complete cycle.
        """
        estimates = finite_rows(self._rows["estimate", ""], 10)
        odometry = finite_rows(self._rows["odometry", ""], 4)
        if not (self._rows["cycle", ""] and len(estimates) and len(odometry)):
            msg = f"log {log.path} holds no complete cycle: there is nothing to report"
            raise LogError(msg)
        encoders = Track.of(odometry)
        truth = finite_rows(self._rows["truth", ""], 4)
        first_motion_s = encoders.first_motion_s()
        rates = self._series("rate", "")
        duration_s = self._seconds(self._last_ns) if self._end is None else self._end.duration_s
        return RunData(
            path=log.path,
            origin=log.origin,
            config=self._config,
            config_json=log.config_json,
            is_complete=log.is_complete,
            end=self._end,
            duration_s=duration_s,
            cycles=self._cycles(),
            estimate=Track.of(estimates),
            covariance=estimates[:, 4:],
            encoders=encoders,
            truth=Track.of(truth).from_first_pose() if len(truth) else None,
            cross_track=self._series("cross_track", ""),
            headings=self._headings(first_motion_s),
            gyro=None if rates is None else integrate_rate(rates, first_motion_s),
            innovations=self._innovations(),
            uncompared=dict(self._uncompared),
            wheels=self._wheels(),
            slip=self._slip(),
            drift=self._drift(),
            health=self._health,
            link_events=self._link_events,
            watchdog_s=self._watchdog_s,
        )

    def _seconds(self, t_ns: int) -> float:
        return seconds(t_ns - self._start_ns)

    def _add_wheels(self, kind: str, t_s: float, values: tuple[float | None, ...], first: int = 0) -> None:
        for wheel, value in enumerate(values, start=first):
            if value is not None:
                self._rows[kind, wheel].append((t_s, value))

    def _take_output(self, output: StepOutput) -> None:
        t_s = self._seconds(output.t_ns)
        pose, odometry = output.estimate, output.odometry
        pose_s = self._seconds(pose.t_ns)
        self._modes.append(output.mode)
        self._reasons.append(output.reason)
        self._limits.append(output.limit)
        self._rows["time", ""].append((t_s,))
        self._rows["estimate", ""].append((pose_s, pose.x_m, pose.y_m, pose.yaw_rad, *pose.covariance))
        self._rows["odometry", ""].append((pose_s, odometry.x_m, odometry.y_m, odometry.yaw_rad))
        if output.cross_track_m is not None:
            self._rows["cross_track", ""].append((t_s, output.cross_track_m))
        if output.slip is not None:
            self._slips.append((t_s, output.slip))
        if output.drift is not None:
            self._take_drift(t_s, output.drift)
        for innovation in output.innovations:
            if innovation.residual is not None and innovation.variance is not None:
                row = (t_s, innovation.residual, innovation.variance**0.5, float(innovation.accepted))
                self._rows["innovation", innovation.name].append(row)
            else:
                self._uncompared[innovation.name] += 1

    def _take_drift(self, t_s: float, drift: ScompReport) -> None:
        self._rows["drift_slip", ""].append((t_s, drift.slip))
        self._rows["drift_angle", ""].append((t_s, drift.slip_angle_rad))
        self._drift_reasons.append(drift.reason)
        trace = drift.trace
        if trace is not None and trace.detected and trace.theta_rad is not None:
            self._rows["trace", ""].append((self._seconds(trace.t_ns), trace.theta_rad))

    def _take_samples(self, samples: _Samples) -> None:
        roles = self._config.roles
        for wheel in samples.wheels:
            if wheel.device == roles.wheels:
                t_s = self._seconds(wheel.t_ns)
                self._add_wheels("position", t_s, (wheel.position_rad,), wheel.wheel)
                self._add_wheels("speed", t_s, (wheel.speed_rad_s,), wheel.wheel)
                self._add_wheels("current", t_s, (wheel.current_a,), wheel.wheel)
        for heading in samples.headings:
            if heading.device in roles.headings:
                name = f"{heading.device} {heading.reference}"
                self._rows["heading", name].append((self._seconds(heading.t_ns), heading.heading_rad))
        for rate in samples.rates:
            if rate.device == roles.gyro:
                self._rows["rate", ""].append((self._seconds(rate.t_ns), rate.rate_z_rad_s))

    def _take_truth(self, truth: _Truth) -> None:
        t_s = self._seconds(truth.t_ns)
        if truth.is_new:
            self._rows["truth", ""].append((t_s, truth.x_m, truth.y_m, truth.yaw_rad))
        forward, left = truth.velocity_x_m_s, truth.velocity_y_m_s
        if forward is not None and left is not None and truth.wheel_speed_rad_s:
            rim_m_s = self._config.rover.wheel_radius_m * float(np.mean(truth.wheel_speed_rad_s))
            turns = abs(rim_m_s) > SLOWEST_RIM_M_S
            self._rows["true_slip", ""].append((t_s, 1.0 - forward / rim_m_s if turns else np.nan))
            moves = turns and forward > SLOWEST_M_S
            self._rows["true_angle", ""].append((t_s, np.arctan2(left, forward) if moves else np.nan))
        self._add_wheels("slip", t_s, truth.slip)
        self._add_wheels("true_speed", t_s, truth.wheel_speed_rad_s)

    def _series(self, kind: str, key: int | str) -> Series | None:
        series = Series.of(self._rows[kind, key])
        return series if len(series.t_s) else None

    def _cycles(self) -> Cycles:
        times_us = np.array(self._rows["cycle", ""])
        return Cycles(
            t_s=np.array(self._rows["time", ""])[:, 0],
            mode=self._modes,
            reason=self._reasons,
            limit=self._limits,
            late_us=times_us[:, 0],
            work_us=times_us[:, 1],
        )

    def _headings(self, first_motion_s: float) -> dict[str, Series]:
        names = [str(name) for kind, name in self._rows if kind == "heading"]
        found = {name: self._series("heading", name) for name in sorted(names)}
        return {name: local_headings(series, first_motion_s) for name, series in found.items() if series}

    def _innovations(self) -> dict[str, InnovationData]:
        found: dict[str, InnovationData] = {}
        for (kind, name), rows in self._rows.items():
            if kind == "innovation":
                t_s, residual, deviation, accepted = np.array(rows).T
                found[str(name)] = InnovationData(
                    t_s=t_s, residual=residual, deviation=deviation, is_accepted=accepted
                )
        return found

    def _slip(self) -> SlipData | None:
        if not self._slips:
            return None
        t_s = np.array([told_s for told_s, _ in self._slips])
        return SlipData(
            map=self._slips[0][1].map,
            t_s=t_s,
            surfaces=[report.surface or "" for _, report in self._slips],
            wheels=[
                ToldSlip(
                    slip=Series(t_s, np.array([wheel.slip for wheel in wheels])),
                    paper_torque_nm=Series(t_s, np.array([wheel.paper_torque_nm for wheel in wheels])),
                    wheel_torque_nm=Series(t_s, np.array([wheel.wheel_torque_nm for wheel in wheels])),
                    reasons=[wheel.reason for wheel in wheels],
                )
                for wheels in zip(*(report.wheels for _, report in self._slips), strict=True)
            ],
        )

    def _drift(self) -> DriftData | None:
        slip, angle = self._series("drift_slip", ""), self._series("drift_angle", "")
        if slip is None or angle is None:
            return None
        return DriftData(
            slip=slip,
            angle=angle,
            reasons=self._drift_reasons,
            trace=Series.of(self._rows["trace", ""]),
            true_slip=self._series("true_slip", ""),
            true_angle=self._series("true_angle", ""),
        )

    def _wheels(self) -> list[WheelData]:
        rover = self._config.rover
        limit_rad_s = self._config.limits.wheel_speed_rad_s
        wheels: list[WheelData] = []
        for wheel in range(make_kinematics(rover).wheel_count):
            place = f" ({SKID_STEER_PLACES[wheel]})" if isinstance(rover, SkidSteerRoverSettings) else ""
            position = self._series("position", wheel)
            # A device's own speeds are often coarse, so positions come first.
            speed = self._series("speed", wheel)
            wheels.append(
                WheelData(
                    name=f"wheel {wheel}{place}",
                    set_point=self._series("set_point", wheel),
                    speed=speed if position is None else speed_from_positions(position, limit_rad_s),
                    current=self._series("current", wheel),
                    slip=self._series("slip", wheel),
                    true_speed=self._series("true_speed", wheel),
                )
            )
        return wheels
