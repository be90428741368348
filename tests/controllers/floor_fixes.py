"""What an overhead camera says of a rover on a floor."""

import cmath
from dataclasses import replace

from controllers.motion.planar import Pose, wrap_angle
from drivers.samples import PoseFixSample

FIX = PoseFixSample(
    device="overhead",
    t_ns=0,
    x_m=0.0,
    y_m=0.0,
    yaw_rad=0.0,
    position_std_m=0.003,
    yaw_std_rad=0.005,
    t_capture_ns=0,
)
FLOOR = Pose(x_m=2.0, y_m=-1.0, yaw_rad=2.5)


def on_floor(place: complex, yaw_rad: float, floor: Pose = FLOOR) -> PoseFixSample:
    """Return an exact fix of a rover that is at `place` in the local frame."""
    seen = complex(floor.x_m, floor.y_m) + place * cmath.rect(1.0, floor.yaw_rad)
    return replace(FIX, x_m=seen.real, y_m=seen.imag, yaw_rad=wrap_angle(yaw_rad + floor.yaw_rad))
