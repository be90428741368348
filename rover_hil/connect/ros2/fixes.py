"""Poses of the rover that arrive over ROS 2, checked before they correct anything."""

import math
from typing import NamedTuple

from controllers.motion.planar import wrap_angle
from drivers.clock import nanoseconds
from drivers.samples import PoseFixSample
from rover_hil.config.ros2_settings import POSE_FIX
from rover_hil.connect.ros2.mapping import yaw_of
from rover_hil.connect.ros2.messages import PoseWithCovarianceStamped

LATEST_NS = nanoseconds(2.0)
"""Older ones are of no use: the motion since is not remembered for longer."""
EARLIEST_NS = -nanoseconds(0.05)
"""A stamp from further in the future is one of another clock."""
LEAST_M, LEAST_RAD = 0.001, 0.001
"""A source that claims to be more certain is not believed."""
MOST_M, MOST_RAD = 10.0, math.pi


class Fix(NamedTuple):
    """A pose that has arrived, with its age then."""

    arrival_ns: int
    age_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    position_std_m: float
    yaw_std_rad: float

    def sample(self, simulated_offset_ns: int) -> PoseFixSample:
        """Return it as a measurement, on the clock of the loop."""
        t_ns = self.arrival_ns - simulated_offset_ns
        return PoseFixSample(
            device=POSE_FIX,
            t_ns=t_ns,
            x_m=self.x_m,
            y_m=self.y_m,
            yaw_rad=self.yaw_rad,
            position_std_m=self.position_std_m,
            yaw_std_rad=self.yaw_std_rad,
            t_capture_ns=t_ns - max(0, self.age_ns),
        )


def read_fix(message: PoseWithCovarianceStamped, map_frame: str, arrival_ns: int, wall_ns: int) -> Fix | str:
    """Return the pose of a message, or why it is not used.

    Args:
        message: The message; the stamp 0 is that of its arrival.
        map_frame: The frame that it must have.
        arrival_ns: Real monotonic time of its arrival.
        wall_ns: The same since 1970.
    """
    frame = message.header.frame_id.removeprefix("/")
    if frame != map_frame:
        return f"pose fixes in the frame '{frame[:40]}' instead of '{map_frame}'"
    place = message.pose.pose.position
    yaw_rad = yaw_of(message.pose.pose.orientation)
    if not all(map(math.isfinite, (place.x, place.y, yaw_rad))):
        return "pose fixes with numbers that are not finite, or an orientation that is none"
    covariance = message.pose.covariance
    xx, xy, yy, yaw_yaw = covariance[0], covariance[1], covariance[7], covariance[35]
    if not all(map(math.isfinite, (xx, xy, yy, yaw_yaw))) or min(xx, yy, yaw_yaw) <= 0.0:
        return "pose fixes without a covariance of x, y and yaw"
    # Along the most uncertain axis.
    position_m = math.sqrt(0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy))
    yaw_std_rad = math.sqrt(yaw_yaw)
    if position_m > MOST_M or yaw_std_rad > MOST_RAD:
        return f"pose fixes that are less certain than {MOST_M:g} m or half a turn"
    stamp_ns = message.header.stamp.time_ns
    age_ns = wall_ns - stamp_ns if stamp_ns else 0
    if not EARLIEST_NS <= age_ns <= LATEST_NS:
        return "pose fixes that are older than 2 s or from the future: set the clocks of both computers"
    return Fix(
        arrival_ns,
        age_ns,
        place.x,
        place.y,
        wrap_angle(yaw_rad),
        max(LEAST_M, position_m),
        max(LEAST_RAD, yaw_std_rad),
    )
