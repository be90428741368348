"""Quantities of a recorded drive over time, with their names and SI units."""

import math
from array import array
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controllers.motion.steering import mean_steering_rad
from drivers.samples import AttitudeSample, PoseFixSample, RateSample
from rover_hil.config import Config
from rover_hil.drives.arrays import Array, Times
from rover_hil.recording import schema
from rover_hil.recording.reader import LogMessage, LogReader

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


def _no_readings() -> tuple["array[int]", "array[float]"]:
    return array("q"), array("d")


class Channels:
    """Collects the readings of a drive, message by message.

    Names carry the unit; wheels count from 1. Wheels: `position1_rad`, `speed1_rad_s`, `current1_a`,
    `voltage1_v`, `steer1_rad`, `set1_rad_s` and `set_steer1_rad` (delivered setpoints only). Body:
    `gyro_z_rad_s` (and x, y), `pitch_rad` (nose up), `roll_rad` (left side up), `heading_rad` of the
    first heading device, `heading_rad DEVICE REFERENCE` of each, and on request `trace_rad`, the angles
    of the rear left wheel's trace that the run itself found, and `steering_rad`, the mean steering angle
    of the wheels; of any device, `gyro_z_rad_s DEVICE`, `pitch_rad DEVICE`, `acceleration_x_m_s2 DEVICE`,
    `fix_yaw_rad DEVICE` and so on. Truth: `x_m`, `y_m`, `yaw_rad`, `true_slip1`, `true_speed1_rad_s`,
    `true_steering1_rad`, `true_forward_m_s`, `true_left_m_s`.

    Args:
        config: Of the log.
        with_traces: Read trace and steering angles too.
        with_devices: Read rates, tilts, accelerations and headings of all devices too.

    Attributes:
        unsigned_wheels: Wheels, from 1, whose currents are magnitudes.
        import_findings: What the import found wrong with the data, and what it did about it.
        has_computed_wheels: The angles of the wheels are no measurement, but computed from a path.
        fixes: Pose measurements of each device in `roles.fixes`, in the order of the log.
    """

    def __init__(self, config: Config, *, with_traces: bool = False, with_devices: bool = False) -> None:
        self.unsigned_wheels: set[int] = set()
        self.has_computed_wheels = False
        self.import_findings: list[schema.OddityRecord] = []
        self._roles = config.roles
        self._fix_sources = config.fix_sources
        self._with_traces, self._with_devices = with_traces, with_devices
        # Arrays, because a number in a list takes five times the memory.
        self._rows: defaultdict[str, tuple[array[int], array[float]]] = defaultdict(_no_readings)
        self.fixes: defaultdict[str, list[PoseFixSample]] = defaultdict(list)

    def __contains__(self, name: str) -> bool:
        return name in self._rows

    def __getitem__(self, name: str) -> Readings:
        t_ns, values = self._rows.get(name) or _no_readings()
        return Readings(np.array(t_ns, np.int64), np.array(values, np.float64))

    def names(self) -> list[str]:
        """Return what there is."""
        return list(self._rows)

    def of_devices(self, name: str) -> dict[str, Readings]:
        """Return a quantity of each device that has it; of headings, of each device and reference."""
        return {
            each.removeprefix(f"{name} "): self[each] for each in self._rows if each.startswith(f"{name} ")
        }

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
                if self._with_devices:
                    self._take_devices(samples)
                for fix in samples.fixes:
                    if fix.device in self._fix_sources:
                        self.fixes[fix.device].append(fix)
            case schema.TRUTH:
                self._take_truth(log.parse(message, schema.TRUTH_SHAPE))
            case schema.COMMAND | schema.SET_POINT:
                record = log.parse(message, schema.SET_POINT_SHAPE)
                if record.get("delivered", True):
                    self._add_wheels("set{}_rad_s", message.t_ns, record["speed_rad_s"])
                    self._add_wheels("set_steer{}_rad", message.t_ns, record.get("steering_rad") or ())
            case schema.IMPORT:
                imported = log.parse(message, schema.IMPORT_SHAPE)
                self.import_findings = imported["oddities"]
                self.has_computed_wheels = imported.get("computed_wheels", False)
            case schema.ESTIMATE if self._with_traces:
                self._take_angles(message.t_ns, log.parse(message, schema.TRACES_SHAPE))

    def _take_angles(self, t_ns: int, record: schema.TracesRecord) -> None:
        drift, steering_rad = record.get("drift"), record.get("steering_rad")
        if steering_rad and all(map(math.isfinite, steering_rad)):
            self._add("steering_rad", t_ns, mean_steering_rad(steering_rad))
        trace = None if drift is None else drift.get("trace")
        if trace is not None and trace["detected"] and trace["theta_rad"] is not None:
            self._add("trace_rad", trace["t_ns"], trace["theta_rad"])

    def _add(self, name: str, t_ns: int, value: float) -> None:
        times, values = self._rows[name]
        times.append(t_ns)
        values.append(value)

    def _add_wheels(self, name: str, t_ns: int, values: Sequence[float]) -> None:
        for wheel, value in enumerate(values, start=1):
            self._add(name.format(wheel), t_ns, value)

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
                    self._add(name, wheel.t_ns, value)

    def _take_body(self, samples: schema.SamplesRecord) -> None:
        roles = self._roles
        for heading in samples.headings:
            if heading.device in roles.headings[:1]:
                self._add("heading_rad", heading.t_ns, heading.heading_rad)
            if self._with_devices or heading.device in roles.headings:
                name = f"{HEADING}{heading.device} {heading.reference}"
                self._add(name, heading.t_ns, heading.heading_rad)
        for rate in samples.rates:
            if rate.device == roles.gyro:
                self._take_rates(rate)
        for attitude in samples.attitudes:
            self._take_attitude(attitude)

    def _take_devices(self, samples: schema.SamplesRecord) -> None:
        for rate in samples.rates:
            self._take_rates(rate, f" {rate.device}")
        for attitude in samples.attitudes:
            self._take_attitude(attitude, f" {attitude.device}")
        for fix in samples.fixes:
            self._add(f"fix_yaw_rad {fix.device}", min(fix.t_capture_ns, fix.t_ns), fix.yaw_rad)
        for force in samples.accelerations:
            for axis, value in (("x", force.x_m_s2), ("y", force.y_m_s2), ("z", force.z_m_s2)):
                self._add(f"acceleration_{axis}_m_s2 {force.device}", force.t_ns, value)

    def _take_rates(self, rate: RateSample, of: str = "") -> None:
        for axis, value in (("x", rate.rate_x_rad_s), ("y", rate.rate_y_rad_s), ("z", rate.rate_z_rad_s)):
            if value is not None:
                self._add(f"gyro_{axis}_rad_s{of}", rate.t_ns, value)

    def _take_attitude(self, attitude: AttitudeSample, of: str = "") -> None:
        if attitude.pitch_rad is not None:
            self._add(f"pitch_rad{of}", attitude.t_ns, -attitude.pitch_rad)  # a sample counts nose down
        if attitude.roll_rad is not None:
            self._add(f"roll_rad{of}", attitude.t_ns, attitude.roll_rad)

    def _take_truth(self, truth: schema.TruthRecord) -> None:
        t_ns = truth["t_ns"]
        if truth.get("is_new", True):
            self._add("x_m", t_ns, truth["x_m"])
            self._add("y_m", t_ns, truth["y_m"])
            if "yaw_rad" in truth:
                self._add("yaw_rad", t_ns, truth["yaw_rad"])
        self._add_wheels("true_slip{}", t_ns, truth.get("slip", ()))
        self._add_wheels("true_speed{}_rad_s", t_ns, truth.get("wheel_speed_rad_s", ()))
        self._add_wheels("true_steering{}_rad", t_ns, truth.get("steering_rad") or ())
        if "velocity_x_m_s" in truth and "velocity_y_m_s" in truth:
            self._add("true_forward_m_s", t_ns, truth["velocity_x_m_s"])
            self._add("true_left_m_s", t_ns, truth["velocity_y_m_s"])
