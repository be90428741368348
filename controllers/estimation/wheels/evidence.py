"""What the wheels offer the stop rules as evidence."""

import cmath
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from controllers.estimation.pose_estimate import PoseEstimate
from controllers.estimation.wheels.contradiction import WheelContradiction
from controllers.estimation.wheels.odometry import WheelOdometry
from controllers.motion.planar import Pose
from controllers.motion.steering import SteeringAngles


class WheelSetpoints(NamedTuple):
    """Setpoints of the cycle before.

    Attributes:
        speed_rad_s: Of the travel of each wheel, without the yaw excitation.
        steering_rad: Of the steering; empty where no wheel steers.
    """

    speed_rad_s: tuple[float, ...] = ()
    steering_rad: tuple[float, ...] = ()


class WheelEvidence(NamedTuple):
    """Motion of the wheels, measured and commanded.

    Attributes:
        motion_ns: When the motion of the wheels was last known; None before the first.
        set: Setpoints of the cycle before.
        measured_rad_s: Measured speeds.
        distance_m: Driven since the cycle before.
        travel_m: The same as a vector in the local frame, turned by the estimated yaw: x + i y.
        is_still: Whether the wheels report, and have been at standstill for a while.
        contradiction: How far redundant wheels contradict each other, above 1 where they do; None where they
            are not redundant.
        steering_rad: Steering angles, one per wheel; empty where no wheel steers.
        steering_ns: Time of the newest reported steering angle of each wheel that has reported one.
    """

    motion_ns: int | None = None
    set: WheelSetpoints = WheelSetpoints()
    measured_rad_s: tuple[float, ...] = ()
    distance_m: float = 0.0
    travel_m: complex = 0j
    is_still: bool = False
    contradiction: float | None = None
    steering_rad: tuple[float, ...] = ()
    steering_ns: Mapping[int, int] = MappingProxyType({})


def wheel_evidence(
    odometry: WheelOdometry,
    driven_from: Pose,
    estimate: PoseEstimate,
    contradiction: WheelContradiction,
    steering: SteeringAngles,
    setpoints: WheelSetpoints,
    motion_ns: int | None,
    *,
    is_still: bool,
) -> WheelEvidence:
    """Return what the parts of the wheels know; `driven_from` is the odometry of the cycle before."""
    pose, report = odometry.pose, contradiction.report
    driven_m = complex(pose.x_m - driven_from.x_m, pose.y_m - driven_from.y_m)
    return WheelEvidence(
        motion_ns=motion_ns,
        set=setpoints,
        measured_rad_s=odometry.wheel_speed_rad_s,
        distance_m=abs(driven_m),
        travel_m=driven_m * cmath.rect(1.0, estimate.yaw_rad - pose.yaw_rad),
        is_still=is_still,
        contradiction=None if report is None else report.scaled,
        steering_rad=steering.angles_rad,
        steering_ns=steering.reported_ns,
    )
