"""Reads a log into arrays."""

import math
from array import array
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from controllers.estimation.filter.measurement_model import Measured
from controllers.motion.kinematics import make_kinematics
from controllers.motion.limits import Limit
from controllers.motion.rover_geometry import has_four_wheels
from controllers.motion.steering import mean_steering_rad
from controllers.safety import Mode
from controllers.safety.drive_check import Finding
from drivers.clock import seconds
from drivers.driver import Health
from drivers.errors import LogError
from rover_hil.config import Config
from rover_hil.drives.arrays import Array, in_body_frame
from rover_hil.drives.channels import HEADING, POSE, Channels, Readings
from rover_hil.drives.quality.judge import findings_of, with_causes
from rover_hil.recording import schema
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.findings import FindingList, FoundFinding
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.watchdog_note import read_note
from rover_hil.report.run_data import (
    CrabData,
    Cycles,
    DriftData,
    EstimatedSlip,
    GroundData,
    InnovationData,
    LinkEvent,
    RunData,
    SlipData,
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
from rover_hil.run.recorded_cycles import DRIVEN

SLOWEST_RIM_M_S, SLOWEST_M_S = 0.03, 0.01
"""Below the first the true slip, below the second the true slip angle is not defined."""
FOUR_WHEEL_PLACES = ("front left", "front right", "rear left", "rear right")


def read_run(path: Path) -> RunData:
    """Read the log at `path`.

    Raises:
        LogError: It cannot be read, or holds no complete cycle.
    """
    log = LogReader(path)
    with restore_config(log) as config:
        collector = _Collector(config, log.start_ns)
    for message in log.messages():
        collector.take(message, log)
    return collector.result(log)


class _Collector:
    """Takes the messages of a log one by one; rows of numbers are kept by kind and wheel or name."""

    def __init__(self, config: Config, start_ns: int) -> None:
        self._config = config
        self._start_ns = start_ns
        self._last_ns = start_ns
        self._readings = Channels(config)
        self._rows: defaultdict[str, list[tuple[float, ...]]] = defaultdict(list)
        self._innovations: defaultdict[Measured, list[tuple[float, ...]]] = defaultdict(list)
        self._computed: defaultdict[str, array[float]] = defaultdict(lambda: array("d"))
        self._slips: list[tuple[float, schema.SlipRecord]] = []
        self._ground_reasons: list[str] = []
        self._unconfirmed = ""
        self._drift_reasons: list[str] = []
        self._drift_sources: list[str] = []
        self._uncompared: Counter[str] = Counter()
        self._rebases = 0
        self._modes: list[Mode] = []
        self._reasons: list[str] = []
        self._suspicions: list[str] = []
        self._findings = FindingList()
        self._limits: list[Limit] = []
        self._health: list[Health] = []
        self._link_events: list[LinkEvent] = []
        self._watchdog_s: list[float] = []
        self._end: schema.EndRecord | None = None
        self._oddities: list[schema.OddityRecord] = []
        self._checks: tuple[schema.SourceCheckRecord, ...] = ()

    def take(self, message: LogMessage, log: LogReader) -> None:
        """Take one message; those of topics that the report does not show have no effect.

        Raises:
            LogError: It is damaged.
        """
        self._last_ns = max(self._last_ns, message.t_ns)
        self._readings.take(message, log)
        match message.topic:
            case schema.ESTIMATE:
                self._take_output(log.parse(message, schema.ESTIMATE_SHAPE))
            case schema.CYCLE:
                cycle = log.parse(message, schema.CYCLE_SHAPE)
                self._rows["cycle"].append((cycle["late_ns"] / 1e3, cycle["work_ns"] / 1e3))
            case schema.HEALTH:
                self._health = log.parse(message, schema.HEALTH_SHAPE)
            case schema.WATCHDOG:
                self._watchdog_s.append(self._seconds(message.t_ns))
            case schema.IMPORT:
                self._oddities = log.parse(message, schema.IMPORT_SHAPE)["oddities"]
            case schema.END:
                self._end = log.parse(message, schema.END_SHAPE)
            case topic if topic.startswith(schema.LINK):
                change = log.parse(message, schema.LINK_SHAPE)
                device = topic.removeprefix(schema.LINK)
                self._link_events.append(
                    LinkEvent(
                        t_s=self._seconds(message.t_ns), device=device, up=change.up, reason=change.reason
                    )
                )

    def result(self, log: LogReader) -> RunData:
        """Return everything taken, as arrays.

        Raises:
            LogError: There was no complete cycle.
        """
        estimates = finite_rows(self._rows["estimate"], 10)
        odometry = finite_rows(self._rows["odometry"], 4)
        if self._rows["cycle"] and not self._rows["estimate"]:
            raise LogError(
                f"log {log.path} holds no estimate: `rover-hil replay {log.path} --out FOLDER` writes a log "
                "with it"
            )
        if not (self._rows["cycle"] and len(estimates) and len(odometry)):
            raise LogError(f"log {log.path} holds no complete cycle: there is nothing to report")
        encoders = Track.of(odometry)
        computed = self._series_computed()
        estimate = Track.of(estimates)
        truth = self._true_track(estimate)
        first_motion_s = encoders.first_motion_s()
        rates = self._readings_of("gyro_z_rad_s")
        duration_s = self._seconds(self._last_ns) if self._end is None else self._end["duration_s"]
        return RunData(
            path=log.path,
            origin=log.origin,
            config=self._config,
            config_json=log.config_json,
            is_complete=log.is_complete,
            cut_off_by="" if log.is_complete else read_note(log.path),
            end=self._end,
            oddities=self._oddities,
            checks=self._checks,
            duration_s=duration_s,
            cycles=self._cycles(log),
            estimate=estimate,
            covariance=estimates[:, 4:],
            encoders=encoders,
            truth=truth,
            computed=computed,
            headings=self._headings(first_motion_s),
            gyro=None if rates is None else integrate_rate(rates, first_motion_s),
            innovations={measured: _innovation(rows) for measured, rows in self._innovations.items()},
            odometry_rebases=self._rebases,
            uncompared=dict(self._uncompared),
            wheels=self._wheels(),
            slip=self._slip(),
            drift=self._drift(computed),
            crab=self._crab(truth),
            ground=self._ground(),
            health=self._health,
            link_events=self._link_events,
            watchdog_s=self._watchdog_s,
        )

    def _seconds(self, t_ns: int) -> float:
        return seconds(t_ns - self._start_ns)

    def _take_output(self, output: schema.EstimateRecord) -> None:
        t_s = self._seconds(output["t_ns"])
        pose, odometry = output["estimate"], output["odometry"]
        pose_s = self._seconds(pose["t_ns"])
        self._modes.append(Mode(output["mode"]))
        self._reasons.append(output["reason"])
        self._suspicions.append(output.get("suspicion") or "")
        self._findings.take(t_s, [Finding(**each) for each in output.get("findings") or ()])
        self._checks += output.get("checks", ())
        self._limits.append(Limit(output["limit"]))
        self._rebases = output["odometry_rebases"]
        self._rows["time"].append((t_s,))
        self._rows["estimate"].append(
            (pose_s, pose["x_m"], pose["y_m"], pose["yaw_rad"], *pose["covariance"])
        )
        self._rows["odometry"].append((pose_s, odometry["x_m"], odometry["y_m"], odometry["yaw_rad"]))
        for key, value in _numbers_in(output):
            self._computed[key].extend((t_s, value))
        slip, drift = output.get("slip"), output.get("drift")
        if slip is not None:
            self._slips.append((t_s, slip))
        if drift is not None:
            self._take_drift(drift)
        crab = output.get("crab")
        if crab is not None:
            self._take_crab(t_s, output, crab)
        ground = output.get("ground")
        if ground is not None:
            self._ground_reasons.append(ground["reason"])
            self._unconfirmed = ground.get("unconfirmed", "")
            self._rows["ground"].append((t_s, _or_nan(ground["slip"]), _or_nan(ground["slip_sd"])))
        for innovation in output["innovations"]:
            residual, variance = innovation["residual"], innovation["variance"]
            if residual is not None and variance is not None:
                row = (t_s, residual, variance**0.5, float(innovation["accepted"]))
                self._innovations[_measured(innovation["name"])].append(row)
            else:
                self._uncompared[innovation["name"]] += 1

    def _take_drift(self, drift: schema.DriftRecord) -> None:
        self._drift_reasons.append(drift["reason"])
        trace = drift["trace"]
        if trace is not None and trace["detected"] and trace["theta_rad"] is not None:
            self._rows["trace"].append((self._seconds(trace["t_ns"]), trace["theta_rad"]))

    def _take_crab(self, t_s: float, output: schema.EstimateRecord, crab: schema.CrabRecord) -> None:
        steering_rad, set_rad = output.get("steering_rad") or (), output["command"].get("steering_rad") or ()
        if not all(map(math.isfinite, (crab["drift_rad"], *steering_rad, *set_rad))):
            return
        self._rows["crab"].append(
            (t_s, crab["drift_rad"], mean_steering_rad(steering_rad), mean_steering_rad(set_rad))
        )
        self._drift_sources.append(crab["source"])

    def _readings_of(self, name: str) -> Series | None:
        """Return readings over time; None where there are none."""
        readings = self._readings[name]
        series = Series.of(np.column_stack((self._elapsed_s(readings), readings.value)))
        return series if len(series.t_s) else None

    def _true_track(self, estimate: Track) -> Track | None:
        """Return the ground truth from its first pose; without yaw, as it fits the estimate best."""
        x, y, yaw = (self._readings[name] for name in POSE)
        has_yaw = len(yaw) == len(x)
        yaw_rad = yaw.value if has_yaw else np.zeros(len(x))
        rows = finite_rows(np.column_stack((self._elapsed_s(x), x.value, y.value, yaw_rad)), 4)
        if not len(rows):
            return None
        track = Track.of(rows)
        return track.from_first_pose() if has_yaw else track.aligned_with(estimate)

    def _true_slip(self) -> tuple[Series | None, Series | None]:
        """Return the true slip and slip angle of the rover while it moves; None where unknown."""
        forward, left = self._readings["true_forward_m_s"], self._readings["true_left_m_s"]
        count = make_kinematics(self._config.rover).wheel_count
        speeds = [self._readings[f"true_speed{number}_rad_s"].value for number in range(1, count + 1)]
        if not len(forward) or any(len(speed) != len(forward) for speed in speeds):
            return None, None
        rim_m_s = self._config.rover.wheel_radius_m * np.mean(speeds, axis=0)
        turns = np.abs(rim_m_s) > SLOWEST_RIM_M_S
        moves = turns & (forward.value > SLOWEST_M_S)
        t_s = self._elapsed_s(forward)
        along_m_s, _ = in_body_frame(forward.value, left.value, self._true_steering_rad(len(forward)))
        slip = np.where(turns, 1.0 - along_m_s / np.where(turns, rim_m_s, 1.0), np.nan)
        angle = np.where(moves, np.arctan2(left.value, forward.value), np.nan)
        columns = (Series.of(np.column_stack((t_s, values))) for values in (slip, angle))
        true_slip, true_angle = (series if len(series.t_s) else None for series in columns)
        return true_slip, true_angle

    def _true_steering_rad(self, count: int) -> Array:
        """Return the mean true steering angle at the `count` times of the truth; zeros where unknown."""
        wheels = make_kinematics(self._config.rover).wheel_count
        angles = [self._readings[f"true_steering{number}_rad"].value for number in range(1, wheels + 1)]
        if any(len(angle) != count for angle in angles):
            return np.zeros(count)
        mean: Array = np.mean(angles, axis=0)
        return mean

    def _elapsed_s(self, readings: Readings) -> Array:
        elapsed: Array = (readings.t_ns - self._start_ns) / 1e9
        return elapsed

    def _series_computed(self) -> dict[str, Series]:
        return {key: Series.of(np.array(rows).reshape(-1, 2)) for key, rows in self._computed.items()}

    def _cycles(self, log: LogReader) -> Cycles:
        times_us = np.array(self._rows["cycle"])
        return Cycles(
            t_s=np.array(self._rows["time"])[:, 0],
            mode=self._modes,
            reason=self._reasons,
            suspicion=self._suspicions,
            findings=self._judged(log),
            limit=self._limits,
            late_us=times_us[:, 0],
            work_us=times_us[:, 1],
        )

    def _judged(self, log: LogReader) -> list[FoundFinding]:
        causes = [] if log.origin in DRIVEN else findings_of(self._readings, self._config)
        return with_causes(causes, self._findings.found, [])[0]

    def _headings(self, first_motion_s: float) -> dict[str, Series]:
        headings = {
            name.removeprefix(HEADING): self._readings_of(name)
            for name in sorted(self._readings.names())
            if name.startswith(HEADING)
        }
        return {name: local_headings(series, first_motion_s) for name, series in headings.items() if series}

    def _slip(self) -> SlipData | None:
        if not self._slips:
            return None
        t_s = np.array([time_s for time_s, _ in self._slips])
        return SlipData(
            map=self._slips[0][1]["map"],
            t_s=t_s,
            surfaces=[report["surface"] or "" for _, report in self._slips],
            wheels=[
                EstimatedSlip(
                    slip=Series(t_s, np.array([wheel["slip"] for wheel in wheels])),
                    paper_torque_nm=Series(t_s, np.array([wheel["paper_torque_nm"] for wheel in wheels])),
                    wheel_torque_nm=Series(t_s, np.array([wheel["wheel_torque_nm"] for wheel in wheels])),
                    reasons=[wheel["reason"] for wheel in wheels],
                )
                for wheels in zip(*(report["wheels"] for _, report in self._slips), strict=True)
            ],
        )

    def _drift(self, computed: Mapping[str, Series]) -> DriftData | None:
        if "drift.slip" not in computed:
            return None
        true_slip, true_angle = self._true_slip()
        return DriftData(
            slip=computed["drift.slip"],
            angle=computed["drift.slip_angle_rad"],
            reasons=self._drift_reasons,
            trace=Series.of(self._rows["trace"]),
            true_slip=true_slip,
            true_angle=true_angle,
        )

    def _ground(self) -> GroundData | None:
        if not self._rows["ground"]:
            return None
        t_s, slip, slip_sd = np.array(self._rows["ground"]).T
        return GroundData(
            slip=Series(t_s, slip),
            slip_sd=slip_sd,
            reasons=self._ground_reasons,
            unconfirmed=self._unconfirmed,
        )

    def _crab(self, truth: Track | None) -> CrabData | None:
        if not self._rows["crab"]:
            return None
        t_s, *columns = np.array(self._rows["crab"]).T
        drift, steering, set_point = (Series(t_s, values) for values in columns)
        left = None
        mission = self._config.mission
        if truth is not None and mission is not None and mission.is_along_x:
            left = Series(truth.t_s, truth.y_m)
        return CrabData(
            set_point=set_point,
            steering=steering,
            drift=drift,
            sources=self._drift_sources,
            true_left_of_line=left,
        )

    def _wheels(self) -> list[WheelData]:
        rover = self._config.rover
        limit_rad_s = self._config.limits.wheel_speed_rad_s
        wheels: list[WheelData] = []
        for wheel in range(make_kinematics(rover).wheel_count):
            place = f" ({FOUR_WHEEL_PLACES[wheel]})" if has_four_wheels(rover) else ""
            number = wheel + 1
            position = self._readings_of(f"position{number}_rad")
            # A device's own speeds are often coarse, so positions come first.
            speed = self._readings_of(f"speed{number}_rad_s")
            wheels.append(
                WheelData(
                    name=f"wheel {wheel}{place}",
                    set_point=self._readings_of(f"set{number}_rad_s"),
                    speed=speed if position is None else speed_from_positions(position, limit_rad_s),
                    current=self._readings_of(f"current{number}_a"),
                    slip=self._readings_of(f"true_slip{number}"),
                    true_speed=self._readings_of(f"true_speed{number}_rad_s"),
                )
            )
        return wheels


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _numbers_in(record: object, key: str = "") -> Iterator[tuple[str, float]]:
    """Yield key and value of every number in a record; times, and lists of plain numbers, are left out."""
    if isinstance(record, float | int):
        yield key, record
    elif isinstance(record, dict):
        for name, value in record.items():
            if not name.endswith("_ns"):
                yield from _numbers_in(value, f"{key}.{name}" if key else name)
    elif isinstance(record, tuple) and record and isinstance(record[0], dict) and key != "innovations":
        for index, value in enumerate(record):
            yield from _numbers_in(value, f"{key}.{index}")


def _measured(name: str) -> Measured:
    """Return what the name of an innovation in a log means; see `Measured.__str__`."""
    device, _, quantity = name.partition(" ")
    return Measured(device, quantity)


def _innovation(rows: Sequence[tuple[float, ...]]) -> InnovationData:
    t_s, residual, deviation, accepted = np.array(rows).T
    return InnovationData(t_s=t_s, residual=residual, deviation=deviation, is_accepted=accepted)
