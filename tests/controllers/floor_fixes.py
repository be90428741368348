"""What an overhead camera says of a rover on a floor."""

import cmath
from collections.abc import Sequence
from dataclasses import replace

from controllers.estimation.filter.late_readings import LateReadings
from controllers.estimation.filter.motion_history import MotionHistory, Step, WayBack
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.slip_states import SlipStates
from controllers.estimation.filter.transition import Turn
from controllers.estimation.positions.frames import PositionFrames
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_prior import UNKNOWN, SlipPrior
from controllers.estimation.wheels.odometry import BodyIncrement
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


NO_SLIP = SlipPrior("none", 0.0, 0.0, 0.0, 1.0, 0.0)
"""Wheels that roll."""


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
        prior: SlipPrior = UNKNOWN,
    ) -> None:
        super().__init__(
            settings, heading_devices, position_devices, is_compensated=is_compensated, slip=slip, prior=prior
        )
        self.positions = PositionFrames(self, settings, prior)

    def predict(self, increment: BodyIncrement, turn: Turn) -> Step:
        """Move by the wheels' increment, also by dead reckoning."""
        step = super().predict(increment, turn)
        self.positions.drive(complex(increment.x_m, increment.y_m), step.turn_rad)
        return step


class PositionQueue:
    """Positions by one device that wait for the recorded motion."""

    def __init__(self) -> None:
        self.history = MotionHistory()
        frames = PositionFrames(PoseFilter(FilterSettings(), (), ("overhead",)), FilterSettings())
        self._readings = LateReadings((frames,))

    def add(self, fix: PoseFixSample, t_ns: int) -> None:
        """Take a position that arrived at `t_ns`."""
        self._readings.add(fix, t_ns)

    def move(self, t_ns: int, step: Step) -> None:
        """Record a step of the motion."""
        self.history.move(t_ns, step)

    def take(self) -> list[tuple[PoseFixSample, WayBack | None]]:
        """Return the positions that the motion has reached, with the motion back to each."""
        ready = self._readings.take(self.history.known_ns)
        return [
            (sample, self.history.way_back(t_ns))
            for t_ns, _, sample in ready
            if isinstance(sample, PoseFixSample)
        ]
