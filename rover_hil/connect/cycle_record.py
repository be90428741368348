"""Makes the record of a cycle that other programs get while the rover drives."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from controllers.motion.kinematics import make_kinematics
from controllers.safety import Mode
from controllers.unwatched_yaw import find_unwatched_yaw
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.driver import DeviceState
from rover_hil.config import Config
from rover_hil.config.ros2_joints import steered_wheels
from rover_hil.connect.cycle_bytes import FORCE, POWER, RATE, WHEEL, CycleFacts, SampleFacts, or_none
from rover_hil.connect.odometry_record import OdometryRecorder, is_finite, map_to_odom, slip_of
from rover_hil.connect.records import (
    CycleRecord,
    ImuRecord,
    PowerRecord,
    StatusRecord,
    Triple,
    WheelsRecord,
)
from rover_hil.connect.wall_clock import WallOffset
from rover_hil.recording.schema import EstimateRecord

STATUS_PERIOD_NS = NANOSECONDS_PER_SECOND
GOOD, WARNING, ERROR, STALE = range(4)
LEVELS = {
    DeviceState.STREAMING: GOOD,
    DeviceState.CONNECTED: WARNING,
    DeviceState.DEGRADED: STALE,
    DeviceState.CLOSED: STALE,
    DeviceState.FAILED: ERROR,
}


class CycleRecorder:
    """Makes the records of successive cycles of a run.

    Args:
        config: The rover.
        offset: From real monotonic time to the wall clock.
    """

    def __init__(self, config: Config, offset: WallOffset) -> None:
        self._odometry = OdometryRecorder(config.filter, config.ground)
        wheel_count = make_kinematics(config.rover).wheel_count
        self._position_rad: list[float | None] = [None] * wheel_count
        self._speed_rad_s: list[float | None] = [None] * wheel_count
        self._steered = steered_wheels(config.rover)
        self._force_m_s2: Triple | None = None
        self._offset = offset
        self._ground = config.ground
        self._yaw_unwatched = str(find_unwatched_yaw(config, config.device_roles()) or "")
        self._told: object = None
        self._due_ns = 0

    def record(self, facts: CycleFacts, now_ns: int) -> CycleRecord:
        """Return the record of a cycle.

        Args:
            facts: The cycle. A change of its further facts about the run is reported at once.
            now_ns: Real monotonic time.
        """
        to_wall_ns = self._offset.at(now_ns) + facts.offset_ns
        cycle = facts.cycle
        wheels_ns, imu, power = self._sort(facts.samples, to_wall_ns)
        return {
            "time_ns": to_wall_ns + cycle["t_ns"],
            "odometry": self._odometry.record(to_wall_ns, cycle),
            "map_to_odom": map_to_odom(cycle),
            "wheels": None if wheels_ns is None else self._wheels_of(wheels_ns, cycle),
            "imu": imu,
            "power": power,
            "status": self._status(cycle, now_ns, facts),
        }

    def _sort(
        self, samples: Sequence[SampleFacts], to_wall_ns: int
    ) -> tuple[int | None, list[ImuRecord], list[PowerRecord]]:
        """Return the time of the newest wheel position, the readings of the IMU, and of the supply."""
        wheels_ns: int | None = None
        imu: list[ImuRecord] = []
        power: list[PowerRecord] = []
        for kind, t_ns, (first, second, third) in samples:
            time_ns = to_wall_ns + t_ns
            if kind == WHEEL:
                if self._take_wheel(int(first), second, third):
                    wheels_ns = time_ns
            elif kind == POWER:
                power.append({"time_ns": time_ns, "voltage_v": first, "current_a": or_none(second)})
            elif kind == FORCE:
                self._force_m_s2 = first, second, third
            elif kind == RATE:
                rate_rad_s = or_none(first), or_none(second), third
                imu.append({"time_ns": time_ns, "rate_rad_s": rate_rad_s, "force_m_s2": self._force_m_s2})
        return wheels_ns, imu, power

    def _take_wheel(self, wheel: int, position_rad: float, speed_rad_s: float) -> bool:
        """Take a sample of a wheel; return whether it has a position."""
        if not 0 <= wheel < len(self._position_rad):
            return False
        if not math.isnan(speed_rad_s):
            self._speed_rad_s[wheel] = speed_rad_s
        if math.isnan(position_rad):
            return False
        self._position_rad[wheel] = position_rad
        return True

    def _wheels_of(self, time_ns: int, cycle: EstimateRecord) -> WheelsRecord:
        angles_rad = cycle["steering_rad"]
        return {
            "time_ns": time_ns,
            "position_rad": self._position_rad,
            "speed_rad_s": self._speed_rad_s,
            "steering_rad": [angles_rad[wheel] for wheel in self._steered] if angles_rad else [],
        }

    def _status(self, cycle: EstimateRecord, now_ns: int, facts: CycleFacts) -> list[StatusRecord] | None:
        extra = facts.extra
        mode, reason, suspicion = cycle["mode"], cycle["reason"], cycle["suspicion"]
        told = (mode, reason, suspicion, extra)
        if told == self._told and now_ns < self._due_ns:
            return None
        self._told, self._due_ns = told, now_ns + STATUS_PERIOD_NS
        slip, _, slip_reason = slip_of(cycle)
        ground = self._ground
        step = f"stepped by {self._offset.step_s:+.3f} s" if self._offset.step_s else ""
        values = {
            "mode": mode,
            "stop reason": reason,
            "suspicion": suspicion,
            "slip": "" if slip is None else f"{slip:.4f}",
            "slip not valid": slip_reason,
            "yaw": self._yaw_unwatched or "watched",
            "ground": ground.contradicted_words if cycle.get("is_ground_contradicted") else ground.words,
            "estimate": "" if is_finite(cycle["estimate"]) else "not finite: no odometry is sent",
            "wall clock": step,
            **extra,
        }
        warnings = (reason, suspicion, step, values["estimate"])
        level = ERROR if mode == Mode.EMERGENCY_STOP else WARNING if any(warnings) else GOOD
        message = ": ".join(filter(None, (mode, reason or suspicion)))
        run: StatusRecord = {"level": level, "name": "run", "message": message, "values": values}
        return [run, *map(_device_status, facts.healths)]


def _device_status(health: Mapping[str, Any]) -> StatusRecord:
    return {
        "level": LEVELS[health["state"]],
        "name": health["device"],
        "message": health["state"],
        "values": {
            "rate in Hz": f"{health['rate_hz']:.1f}",
            "age in s": None if health["age_s"] is None else f"{health['age_s']:.3f}",
            "accepted": health["accepted"],
            "rejected": sum(health["rejected"].values()),
            "lost": health["lost"],
            "breaks": health["breaks"],
            "link": health["last_link_reason"],
        },
    }
