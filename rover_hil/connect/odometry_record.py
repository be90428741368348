"""Where the rover is and how it moves, with honest uncertainties: the record that other programs get."""

import math

from controllers.estimation.ground_settings import GroundSettings
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_prior import SlipPrior
from rover_hil.connect.records import OdometryRecord
from rover_hil.recording.schema import EstimateRecord, PoseEstimateRecord, PoseRecord

REST_M_S = 0.001
"""Least standard deviation of a velocity: encoders that do not count leave this much unseen."""
REST_RAD_S = 0.001
MEMORY_S = 0.5
"""A period of the yaw excitation."""
NANOSECONDS = 1_000_000_000
NO_COMPENSATION = "slip is not compensated"


class OdometryRecorder:
    """Makes the records of successive cycles.

    The variance of the velocity follows from the noise of the filter. Over a step of the wheels of length s
    in time t the position has the variance q^2 s of rolling and (d s)^2 of slip, where q is
    `filter.position_noise_m_sqrt_m` and d the standard deviation of the slip now. So the velocity has the
    variance q^2 s / t^2 + (d s / t)^2, along the travel and across it alike. Without valid slip d is that of
    [ground], of the ground and of its places together; that of unknown slip after a contradiction. The yaw
    rate has the variance of one gyro reading, and that of a reading which is late: E[a^2] (D^2 + t^2 / 3),
    with the yaw acceleration a over the last `MEMORY_S`, the delay D = `filter.gyro_delay_sd_s` and an age
    between 0 and t. By the wheels it has the variance of their turn, in the same way as the position.

    Args:
        settings: Noise of the filter.
        ground: What is assumed about slip that nothing measures.
    """

    def __init__(self, settings: FilterSettings, ground: GroundSettings) -> None:
        self._settings, self._ground = settings, ground
        self._before: tuple[int, PoseRecord] | None = None
        self._step = (0.0, 0.0, 1.0)
        self._rate_rad_s = self._yaw_acceleration_rad2_s4 = 0.0

    def record(self, wall_offset_ns: int, cycle: EstimateRecord) -> OdometryRecord | None:
        """Return the record of a cycle; None where the estimate is not newer or has no finite numbers.

        The pose is continuous: with pose fixes it is that of dead reckoning, which they do not correct.

        Args:
            wall_offset_ns: Wall-clock time since 1970 minus the monotonic time of the estimate.
            cycle: All that it computed.
        """
        pose = cycle["estimate"]
        place = cycle.get("dead_reckoned") or pose
        if not self._follow(cycle) or not is_finite(pose):
            return None
        slip, slip_sd, slip_reason = slip_of(cycle)
        return {
            "time_ns": wall_offset_ns + pose["t_ns"],
            "mode": cycle["mode"],
            "reason": cycle["reason"],
            "x_m": place["x_m"],
            "y_m": place["y_m"],
            "yaw_rad": place["yaw_rad"],
            "covariance": place["covariance"],
            "velocity_x_m_s": pose["velocity_x_m_s"],
            "velocity_y_m_s": pose["velocity_y_m_s"],
            "yaw_rate_rad_s": pose["yaw_rate_rad_s"],
            "velocity_variance": self._variance(
                slip_sd,
                self._ground.unknown() if cycle.get("is_ground_contradicted") else self._ground.prior(),
                is_sure=not slip_reason,
                by=pose["yaw_source"],
            ),
            "slip": slip,
            "slip_sd": slip_sd,
            "slip_reason": slip_reason,
        }

    def _follow(self, cycle: EstimateRecord) -> bool:
        """Take the step of the wheels alone, length, turn and time; return whether there was a new one."""
        t_ns, odometry = cycle["estimate"]["t_ns"], cycle["odometry"]
        before = self._before
        if before is not None and t_ns <= before[0]:
            return False
        self._before = t_ns, odometry
        if before is None:
            return t_ns > 0
        self._follow_rate(cycle["estimate"]["yaw_rate_rad_s"], (t_ns - before[0]) / NANOSECONDS)
        before_ns, pose = before
        self._step = (
            math.hypot(odometry["x_m"] - pose["x_m"], odometry["y_m"] - pose["y_m"]),
            abs(math.remainder(odometry["yaw_rad"] - pose["yaw_rad"], math.tau)),
            (t_ns - before_ns) / NANOSECONDS,
        )
        return True

    def _follow_rate(self, rate_rad_s: float, step_s: float) -> None:
        kept = math.exp(-step_s / MEMORY_S)
        acceleration_rad_s2 = (rate_rad_s - self._rate_rad_s) / step_s
        self._yaw_acceleration_rad2_s4 = (
            kept * self._yaw_acceleration_rad2_s4 + (1.0 - kept) * acceleration_rad_s2**2
        )
        self._rate_rad_s = rate_rad_s

    def _variance(
        self, slip_sd: float | None, prior: SlipPrior, *, is_sure: bool, by: str
    ) -> tuple[float, float, float]:
        settings = self._settings
        length_m, turn_rad, step_s = self._step
        noise = settings.position_noise_m_sqrt_m if is_sure else settings.unsure_position_noise_m_sqrt_m
        unknown = math.hypot(*((settings.slip_sd, slip_sd or 0.0) if is_sure else (prior.sd, prior.local_sd)))
        if not is_sure and prior.noise_m_sqrt_m is not None:
            noise = prior.noise_m_sqrt_m
        along_m2_s2 = (noise**2 * length_m + (unknown * length_m) ** 2) / step_s**2 + REST_M_S**2
        if by == YawSource.GYRO:
            late_s2 = settings.gyro_delay_sd_s**2 + step_s**2 / 3.0
            turn_rad2_s2 = settings.gyro_rate_noise_rad_s**2 + self._yaw_acceleration_rad2_s4 * late_s2
        else:
            turn_rad2_s2 = (
                settings.wheel_yaw_noise_rad_sqrt_rad**2 * turn_rad
                + settings.wheel_yaw_noise_rad_sqrt_m**2 * length_m
            ) / step_s**2
        return along_m2_s2, along_m2_s2, turn_rad2_s2 + REST_RAD_S**2


def map_to_odom(cycle: EstimateRecord) -> tuple[float, float, float] | None:
    """Return where the frame of dead reckoning is in that of the estimate; None without pose fixes.

    Returns:
        x and y in m, yaw in rad.
    """
    reckoned, pose = cycle.get("dead_reckoned"), cycle["estimate"]
    if reckoned is None:
        return None
    yaw_rad = math.remainder(pose["yaw_rad"] - reckoned["yaw_rad"], math.tau)
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    x_m, y_m = reckoned["x_m"], reckoned["y_m"]
    return pose["x_m"] - cosine * x_m + sine * y_m, pose["y_m"] - sine * x_m - cosine * y_m, yaw_rad


def is_finite(pose: PoseEstimateRecord) -> bool:
    """Return whether all numbers of an estimate that are published are finite."""
    velocity = pose["velocity_x_m_s"], pose["velocity_y_m_s"], pose["yaw_rate_rad_s"]
    return math.isfinite(sum((pose["x_m"], pose["y_m"], pose["yaw_rad"], *velocity, *pose["covariance"])))


def slip_of(cycle: EstimateRecord) -> tuple[float | None, float | None, str]:
    """Return the slip of the rover, its standard deviation where it is known, and why it is not valid."""
    ground, slip, drift = cycle.get("ground"), cycle.get("slip"), cycle.get("drift")
    if ground is not None and ground["slip"] is not None and not ground["reason"]:
        return ground["slip"], ground["slip_sd"], ""
    if slip is not None and (rover := slip.get("rover")) is not None:
        if rover["reason"]:
            return None, None, rover["reason"]
        return rover["slip"], rover["sd"], ""
    if slip is not None:
        reasons = [wheel["reason"] for wheel in slip["wheels"] if not wheel["valid"]]
        if reasons:
            return None, None, reasons[0]
        return sum(wheel["slip"] for wheel in slip["wheels"]) / len(slip["wheels"]), None, ""
    if drift is not None:
        return (None, None, drift["reason"]) if drift["reason"] else (drift["slip"], None, "")
    return None, None, NO_COMPENSATION if ground is None else ground["reason"] or NO_COMPENSATION
