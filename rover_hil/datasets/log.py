"""Read a log of this software as quantities over time: the reader behind identify, scomp, gap and report."""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controllers.motion.steering import mean_steering_rad
from drivers.errors import LogError
from drivers.samples import PoseFixSample, RateSample
from rover_hil.config import Config
from rover_hil.datasets.arrays import Array, Times
from rover_hil.datasets.marks import marks_beside, read_marks
from rover_hil.recording import schema
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogMessage, LogReader

DEGREES = {
    "heading_rad": "heading_deg",
    "gyro_z_rad_s": "yaw_rate_deg_s",
    "pitch_rad": "pitch_deg",
    "roll_rad": "roll_deg",
    "trace_rad": "beta_ftrace_deg",
    "steering_rad": "steering_deg",
}
"""Columns of a table that are in degrees, as in CSV files of drives."""
SINGLE = ("heading_rad", "trace_rad")
"""In a table these stay single readings; setpoints are held, all else is interpolated."""
SET_POINT = "set"
HEADING = "heading_rad "
"""Followed by device and reference."""
POSE = ("x_m", "y_m", "yaw_rad")


@dataclass(frozen=True, slots=True)
class Readings:
    """One quantity over time, in the order of the log: host monotonic times, and values."""

    t_ns: Times
    value: Array

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class TruePoses:
    """Known poses of the rover, n of them.

    Attributes:
        source: What measured them, in words.
        t_ns: Host monotonic time, (n,) as everything else.
        yaw_rad: Unwrapped.
        position_sd_m: Standard deviation of x and of y; 0 where the pose is exact.
        yaw_sd_rad: The same of the yaw.
    """

    source: str
    t_ns: Times
    x_m: Array
    y_m: Array
    yaw_rad: Array
    position_sd_m: Array
    yaw_sd_rad: Array

    @property
    def is_exact(self) -> bool:
        """Whether the poses have no noise."""
        return not (self.position_sd_m.any() or self.yaw_sd_rad.any())


class LogRows:
    """Collects the readings of a drive, message by message.

    Names carry the unit; wheels count from 1. Wheels: `position1_rad`, `speed1_rad_s`, `current1_a`,
    `voltage1_v`, `steer1_rad`, `set1_rad_s` and `set_steer1_rad` (delivered setpoints only). Body:
    `gyro_z_rad_s` (and x, y), `pitch_rad` (nose up), `roll_rad` (left side up), `heading_rad` of the
    first heading device, `heading_rad DEVICE REFERENCE` of each, and on request `trace_rad`, the angles
    of the rear left wheel's trace that the run itself found, and `steering_rad`, the mean steering angle
    of the wheels. Truth: `x_m`, `y_m`, `yaw_rad`, `true_slip1`, `true_speed1_rad_s`,
    `true_steering1_rad`, `true_forward_m_s`, `true_left_m_s`.

    Args:
        config: Of the log.
        with_traces: Read trace and steering angles too.

    Attributes:
        unsigned_wheels: Wheels, from 1, whose currents are magnitudes.
        has_computed_wheels: The angles of the wheels are no measurement, but computed from a path.
    """

    def __init__(self, config: Config, *, with_traces: bool = False) -> None:
        self.unsigned_wheels: set[int] = set()
        self.has_computed_wheels = False
        self._roles = config.roles
        self._fix_sources = config.fix_sources
        self._with_traces = with_traces
        self._rows: defaultdict[str, list[tuple[int, float]]] = defaultdict(list)
        self._fixes: defaultdict[str, list[PoseFixSample]] = defaultdict(list)

    def __contains__(self, name: str) -> bool:
        return name in self._rows

    def __getitem__(self, name: str) -> Readings:
        rows = self._rows.get(name, [])
        return Readings(np.array([t for t, _ in rows], np.int64), np.array([v for _, v in rows], np.float64))

    def names(self) -> list[str]:
        """Return what there is."""
        return list(self._rows)

    def take(self, message: LogMessage, log: LogReader) -> None:
        """Take one message; those of other topics have no effect.

        Raises:
            LogError: It is damaged.
        """
        match message.topic:
            case schema.SAMPLES:
                samples = log.parse(message, schema.SAMPLES_SHAPE)
                self._take_wheels(samples)
                self._take_body(samples)
                for fix in samples.fixes:
                    if fix.device in self._fix_sources:
                        self._fixes[fix.device].append(fix)
            case schema.TRUTH:
                self._take_truth(log.parse(message, schema.TRUTH_SHAPE))
            case schema.COMMAND | schema.SET_POINT:
                record = log.parse(message, schema.SET_POINT_SHAPE)
                if record.get("delivered", True):
                    self._add_wheels("set{}_rad_s", message.t_ns, record["speed_rad_s"])
                    self._add_wheels("set_steer{}_rad", message.t_ns, record.get("steering_rad") or ())
            case schema.IMPORT:
                imported = log.parse(message, schema.IMPORT_SHAPE)
                self.has_computed_wheels = imported.get("computed_wheels", False)
            case schema.ESTIMATE if self._with_traces:
                self._take_angles(message.t_ns, log.parse(message, schema.TRACES_SHAPE))

    def true_poses(self, log: LogReader) -> TruePoses:
        """Return the poses on `/truth`, else those of the camera in `roles.fixes` that gave most fixes.

        Without both, the marks measured by hand in the file beside the log (`rover_hil.datasets.marks`),
        those that have a yaw. A fix counts from when its picture was taken; one that is not newer than the
        last is left out.

        Raises:
            LogError: There is none of them.
        """
        if POSE[0] in self._rows:
            x, y, yaw = (self[name] for name in POSE)
            exact = np.zeros(len(x.t_ns))
            return TruePoses(
                source="simulated pose" if log.origin == "virtual" else f"pose on /truth, {log.origin}",
                t_ns=x.t_ns,
                x_m=x.value,
                y_m=y.value,
                yaw_rad=np.unwrap(yaw.value),
                position_sd_m=exact,
                yaw_sd_rad=exact,
            )
        fixes = self.fixes() or _marks_of(log)
        if fixes is None:
            raise LogError(
                f"log {log.path} holds no true pose, neither on /truth nor as pose fixes of a device in "
                "roles.fixes: record one with an overhead camera"
            )
        return fixes

    def fixes(self) -> TruePoses | None:
        """Return the poses of the camera in `roles.fixes` that gave most fixes; None without one."""
        device = max(self._fixes, key=lambda name: len(self._fixes[name]), default=None)
        if device is None:
            return None
        columns = ("x_m", "y_m", "yaw_rad", "position_std_m", "yaw_std_rad")
        taken = [(min(fix.t_capture_ns, fix.t_ns), fix) for fix in self._fixes[device]]
        t_ns = np.array([t for t, _ in taken], np.int64)
        table = np.array([[getattr(fix, name) for name in columns] for _, fix in taken])
        newest_before = np.concatenate(([-1], np.maximum.accumulate(t_ns)[:-1]))
        use = (t_ns > newest_before) & np.isfinite(table).all(axis=1)
        x_m, y_m, yaw_rad, position_sd_m, yaw_sd_rad = table[use].T
        return TruePoses(
            source=f"pose fixes of '{device}'",
            t_ns=t_ns[use],
            x_m=x_m,
            y_m=y_m,
            yaw_rad=np.unwrap(yaw_rad),
            position_sd_m=position_sd_m,
            yaw_sd_rad=yaw_sd_rad,
        )

    def _take_angles(self, t_ns: int, record: schema.TracesRecord) -> None:
        drift, steering_rad = record.get("drift"), record.get("steering_rad")
        if steering_rad and all(map(math.isfinite, steering_rad)):
            self._rows["steering_rad"].append((t_ns, mean_steering_rad(steering_rad)))
        trace = None if drift is None else drift.get("trace")
        if trace is not None and trace["detected"] and trace["theta_rad"] is not None:
            self._rows["trace_rad"].append((trace["t_ns"], trace["theta_rad"]))

    def _add_wheels(self, name: str, t_ns: int, values: Sequence[float]) -> None:
        for wheel, value in enumerate(values, start=1):
            self._rows[name.format(wheel)].append((t_ns, value))

    def _take_wheels(self, samples: schema.SamplesRecord) -> None:
        for wheel in samples.wheels:
            if wheel.device != self._roles.wheels:
                continue
            number = wheel.wheel + 1
            if not wheel.current_is_signed:
                self.unsigned_wheels.add(number)
            for name, value in (
                (f"position{number}_rad", wheel.position_rad),
                (f"speed{number}_rad_s", wheel.speed_rad_s),
                (f"current{number}_a", wheel.current_a),
                (f"voltage{number}_v", wheel.voltage_v),
                (f"steer{number}_rad", wheel.steering_rad),
            ):
                if value is not None:
                    self._rows[name].append((wheel.t_ns, value))

    def _take_body(self, samples: schema.SamplesRecord) -> None:
        roles, rows = self._roles, self._rows
        for heading in samples.headings:
            if heading.device in roles.headings[:1]:
                rows["heading_rad"].append((heading.t_ns, heading.heading_rad))
            if heading.device in roles.headings:
                name = f"{HEADING}{heading.device} {heading.reference}"
                rows[name].append((heading.t_ns, heading.heading_rad))
        for rate in samples.rates:
            if rate.device == roles.gyro:
                self._take_rates(rate)
        for attitude in samples.attitudes:
            # A sample counts nose down.
            nose_up_rad = None if attitude.pitch_rad is None else -attitude.pitch_rad
            for name, value in (("pitch_rad", nose_up_rad), ("roll_rad", attitude.roll_rad)):
                if value is not None:
                    rows[name].append((attitude.t_ns, value))

    def _take_rates(self, rate: RateSample) -> None:
        for axis, value in (("x", rate.rate_x_rad_s), ("y", rate.rate_y_rad_s), ("z", rate.rate_z_rad_s)):
            if value is not None:
                self._rows[f"gyro_{axis}_rad_s"].append((rate.t_ns, value))

    def _take_truth(self, truth: schema.TruthRecord) -> None:
        t_ns = truth["t_ns"]
        if truth.get("is_new", True):
            for name, value in zip(POSE, (truth["x_m"], truth["y_m"], truth["yaw_rad"]), strict=True):
                self._rows[name].append((t_ns, value))
        self._add_wheels("true_slip{}", t_ns, truth.get("slip", ()))
        self._add_wheels("true_speed{}_rad_s", t_ns, truth.get("wheel_speed_rad_s", ()))
        self._add_wheels("true_steering{}_rad", t_ns, truth.get("steering_rad") or ())
        if "velocity_x_m_s" in truth and "velocity_y_m_s" in truth:
            self._rows["true_forward_m_s"].append((t_ns, truth["velocity_x_m_s"]))
            self._rows["true_left_m_s"].append((t_ns, truth["velocity_y_m_s"]))


def _marks_of(log: LogReader) -> TruePoses | None:
    path = marks_beside(log.path)
    if path is None:
        return None
    marks = read_marks(path)
    use = np.isfinite(marks.yaw_deg)
    if not use.any():
        return None
    return TruePoses(
        source=f"marks measured by hand in {path.name}",
        t_ns=log.start_ns + np.round(1e9 * marks.t_s[use]).astype(np.int64),
        x_m=marks.x_m[use],
        y_m=marks.y_m[use],
        yaw_rad=np.unwrap(np.radians(marks.yaw_deg[use])),
        position_sd_m=marks.sigma_m[use],
        yaw_sd_rad=marks.yaw_sd_rad[use],
    )


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """A log read to its end: file, configuration, readings."""

    log: LogReader
    config: Config
    rows: LogRows

    @property
    def clock(self) -> str:
        """Name of the readings of the first wheel that make the rows of a table."""
        return "position1_rad" if "position1_rad" in self.rows else "speed1_rad_s"

    def seconds(self, t_ns: Times) -> Array:
        """Return times since the start of the log."""
        elapsed: Array = (t_ns - self.log.start_ns) / 1e9
        return elapsed

    def true_poses(self) -> TruePoses:
        """Return the known poses; see `LogRows.true_poses`."""
        return self.rows.true_poses(self.log)

    def table(self, names: Sequence[str], *, outside: float | None = None) -> dict[str, Array]:
        """Return quantities at the times of the first wheel's readings, with `t_s` since the start.

        Single readings go into the first row at or after their time, NaN elsewhere; setpoints are held, 0
        before the first; all else is interpolated. Headings, rates and tilts are in degrees, under the names
        that CSV files of drives have.

        Args:
            names: The quantities wanted, of those that there are; of wheels the name without number.
            outside: Stands before the first and after the last reading; the end values without it.
        """
        t_ns = np.unique(self.rows[self.clock].t_ns)
        columns = {"t_s": self.seconds(t_ns)}
        for name in self.rows.names():
            if "".join(char for char in name if not char.isdigit()) not in names:
                continue
            readings = self.rows[name]
            order = np.lexsort((readings.value, readings.t_ns))
            times, values = readings.t_ns[order], readings.value[order]
            if name in DEGREES:
                values = np.degrees(values)
            if name in SINGLE:
                column = np.full(t_ns.size, np.nan)
                index = np.searchsorted(t_ns, times)
                column[index[index < t_ns.size]] = values[index < t_ns.size]
            elif name.startswith(SET_POINT):
                place = np.searchsorted(times, t_ns, side="right") - 1
                column = np.where(place >= 0, values[np.maximum(place, 0)], 0.0)
            else:
                values = np.unwrap(values) if name == "yaw_rad" else values
                column = np.interp(t_ns, times, values, left=outside, right=outside)
            columns[DEGREES.get(name, name)] = column
        return columns


def read_drive(path: Path, *, with_traces: bool = False) -> RecordedDrive:
    """Return the drive in a log.

    Raises:
        LogError: The log cannot be read or is damaged.
    """
    log = LogReader(path)
    with restore_config(log) as config:
        rows = LogRows(config, with_traces=with_traces)
    for message in log.messages():
        rows.take(message, log)
    return RecordedDrive(log, config, rows)
