"""What an overhead camera says of a rover on a floor."""

import cmath
from collections.abc import Sequence
from dataclasses import replace

from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.slip_states import SlipStates
from controllers.estimation.positions.frames import PositionFrames
from controllers.estimation.settings import FilterSettings
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


class PositionFilter(PoseFilter):
    """A pose filter, and the frames of the devices that measure positions."""

    def __init__(
        self,
        settings: FilterSettings,
        heading_devices: Sequence[str],
        position_devices: Sequence[str] = (),
        *,
        is_compensated: bool = False,
        slip: SlipStates | None = None,
    ) -> None:
        super().__init__(
            settings, heading_devices, position_devices, is_compensated=is_compensated, slip=slip
        )
        self.positions = PositionFrames(self, settings.gate_probability)
