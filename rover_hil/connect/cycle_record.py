"""Makes the record of a cycle that other programs get while the rover drives."""

from collections.abc import Callable, Mapping, Sequence

from controllers.control_loop import StepOutput
from controllers.motion.kinematics import make_kinematics
from controllers.safety import Mode
from controllers.unwatched_yaw import find_unwatched_yaw
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.driver import DeviceState, Health
from drivers.samples import AccelerationSample, PowerSample, RateSample, Sample, WheelSample
from rover_hil.config import Config
from rover_hil.config.ros2_joints import steered_wheels
from rover_hil.connect.odometry_record import OdometryRecorder, map_to_odom, slip_of
from rover_hil.connect.records import (
    CycleRecord,
    ImuRecord,
    PowerRecord,
    StatusRecord,
    Triple,
    WheelsRecord,
)
from rover_hil.connect.wall_clock import WallOffset
from rover_hil.recording.schema import EstimateRecord, estimate_record
from rover_hil.run.executive import CycleView

STATUS_PERIOD_NS = NANOSECONDS_PER_SECOND
GOOD, WARNING, ERROR, STALE = range(4)
LEVELS = {
    DeviceState.STREAMING: GOOD,
    DeviceState.CONNECTED: WARNING,
    DeviceState.DEGRADED: STALE,
    DeviceState.CLOSED: STALE,
    DeviceState.FAILED: ERROR,
}
QUIET_MODES = (Mode.RUNNING, Mode.OBSERVING, Mode.FINISHED)


class CycleRecorder:
    """Makes the records of successive cycles of a run.

    Args:
        config: The rover.
        offset: From real monotonic time to the wall clock.
        simulated_offset_ns: Returns real minus simulated time; 0 for a real rover.
    """

    def __init__(
        self, config: Config, offset: WallOffset, simulated_offset_ns: Callable[[], int] = lambda: 0
    ) -> None:
        self._odometry = OdometryRecorder(config.filter)
        self._gyro, self._wheels = config.roles.gyro, config.roles.wheels
        wheel_count = make_kinematics(config.rover).wheel_count
        self._position_rad: list[float | None] = [None] * wheel_count
        self._speed_rad_s: list[float | None] = [None] * wheel_count
        self._steered = steered_wheels(config.rover)
        self._force_m_s2: Triple | None = None
        self._offset = offset
        self._simulated_offset_ns = simulated_offset_ns
        self._yaw_unwatched = str(find_unwatched_yaw(config, config.device_roles()) or "")
        self._told: object = None
        self._due_ns = 0

    def record(self, view: CycleView, now_ns: int, extra: Mapping[str, object]) -> CycleRecord:
        """Return the record of a cycle.

        Args:
            view: The cycle.
            now_ns: Real monotonic time.
            extra: Further facts about the run by their names; a change is told at once.
        """
        output = view.output
        to_wall_ns = self._offset.at(now_ns) + self._simulated_offset_ns()
        cycle = estimate_record(output)
        wheels, imu, power = self._sort(view.samples, to_wall_ns)
        return {
            "time_ns": to_wall_ns + output.t_ns,
            "odometry": self._odometry.record(to_wall_ns, cycle),
            "map_to_odom": map_to_odom(cycle),
            "wheels": None if wheels is None else self._wheels_of(wheels, output),
            "imu": imu,
            "power": power,
            "status": self._status(view, cycle, now_ns, extra),
        }

    def _sort(
        self, samples: Sequence[Sample], to_wall_ns: int
    ) -> tuple[int | None, list[ImuRecord], list[PowerRecord]]:
        """Return the time of the newest wheel position, the readings of the IMU, and of the supply."""
        wheels_ns: int | None = None
        imu: list[ImuRecord] = []
        power: list[PowerRecord] = []
        for sample in samples:
            time_ns = to_wall_ns + sample.t_ns
            if isinstance(sample, WheelSample):
                if self._take_wheel(sample):
                    wheels_ns = time_ns
            elif isinstance(sample, AccelerationSample):
                if sample.device == self._gyro:
                    self._force_m_s2 = sample.x_m_s2, sample.y_m_s2, sample.z_m_s2
            elif isinstance(sample, RateSample):
                if sample.device == self._gyro:
                    rates = sample.rate_x_rad_s, sample.rate_y_rad_s, sample.rate_z_rad_s
                    imu.append({"time_ns": time_ns, "rate_rad_s": rates, "force_m_s2": self._force_m_s2})
            elif isinstance(sample, PowerSample):
                power.append(
                    {"time_ns": time_ns, "voltage_v": sample.voltage_v, "current_a": sample.current_a}
                )
        return wheels_ns, imu, power

    def _take_wheel(self, sample: WheelSample) -> bool:
        """Take a sample of a wheel; return whether it has a position."""
        if sample.device != self._wheels or not 0 <= sample.wheel < len(self._position_rad):
            return False
        if sample.speed_rad_s is not None:
            self._speed_rad_s[sample.wheel] = sample.speed_rad_s
        if sample.position_rad is None:
            return False
        self._position_rad[sample.wheel] = sample.position_rad
        return True

    def _wheels_of(self, time_ns: int, output: StepOutput) -> WheelsRecord:
        return {
            "time_ns": time_ns,
            "position_rad": self._position_rad,
            "speed_rad_s": self._speed_rad_s,
            "steering_rad": [output.steering_rad[wheel] for wheel in self._steered]
            if output.steering_rad
            else [],
        }

    def _status(
        self, view: CycleView, cycle: EstimateRecord, now_ns: int, extra: Mapping[str, object]
    ) -> list[StatusRecord] | None:
        output = view.output
        told = (output.mode, output.reason, output.suspicion, dict(extra))
        if told == self._told and now_ns < self._due_ns:
            return None
        self._told, self._due_ns = told, now_ns + STATUS_PERIOD_NS
        slip, _, slip_reason = slip_of(cycle)
        step = f"stepped by {self._offset.step_s:+.3f} s" if self._offset.step_s else ""
        values = {
            "mode": output.mode.value,
            "stop reason": output.reason,
            "suspicion": output.suspicion,
            "slip": "" if slip is None else f"{slip:.4f}",
            "slip not valid": slip_reason,
            "yaw": self._yaw_unwatched or "watched",
            "estimate": "" if output.estimate.is_finite else "not finite: no odometry is sent",
            "wall clock": step,
            **extra,
        }
        warnings = (output.reason, output.suspicion, step, values["estimate"])
        level = ERROR if output.mode is Mode.EMERGENCY_STOP else WARNING if any(warnings) else GOOD
        message = ": ".join(filter(None, (output.mode.value, output.reason or output.suspicion)))
        run: StatusRecord = {"level": level, "name": "run", "message": message, "values": values}
        return [run, *map(_device_status, view.healths)]


def _device_status(health: Health) -> StatusRecord:
    return {
        "level": LEVELS[health.state],
        "name": health.device,
        "message": health.state.value,
        "values": {
            "rate in Hz": f"{health.rate_hz:.1f}",
            "age in s": None if health.age_s is None else f"{health.age_s:.3f}",
            "accepted": health.accepted,
            "rejected": sum(health.rejected.values()),
            "lost": health.lost,
            "breaks": health.breaks,
            "link": health.last_link_reason,
        },
    }
