"""Runs the estimator of the motion over the ground over recorded frames."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.motion import GroundMotion
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.prior import MotionPrior, turned
from drivers.clock import nanoseconds, seconds
from drivers.errors import ConfigError
from drivers.samples import Image
from rover_hil.ftrace.frames import to_grey
from rover_hil.ftrace.inputs import FrameInputs

HEADER = (
    "frame,t,valid,forward_m,left_m,turn_rad,forward_sd_m,left_sd_m,turn_sd_rad,scale_sd,duration_s,"
    "wheel_travel_m,slip,slip_sd,x_m,y_m,yaw_rad,reason"
)
WHEELS_SD = 0.005
"""Of the travel of rolling wheels, as a share: radius and encoders."""

Changed = Callable[[Image, int], Image]
"""From the grey pixels of a frame and its number to those that are used."""


@dataclass(frozen=True, slots=True)
class FrameMotion:
    """A frame, and the motion of the measured point since an earlier one.

    Attributes:
        number: Of the frame.
        t_s: Its time.
        grey: Its pixels.
        motion: None for the first frame.
        wheel_m: Travel by the wheels in the time of the motion; None where it is not known.
        pose: Forward and left in m and yaw in rad since the first frame: the sum of the valid motions.
    """

    number: int
    t_s: float
    grey: Image
    motion: GroundMotion | None
    wheel_m: float | None
    pose: tuple[float, float, float]

    @property
    def slip(self) -> tuple[float, float] | None:
        """Slip ratio and its standard deviation; None where it is not known, or the wheels hardly move."""
        motion, wheel_m = self.motion, self.wheel_m
        if motion is None or not motion.is_valid or not wheel_m or abs(wheel_m) < motion.forward_sd_m:
            return None
        share = motion.forward_m / wheel_m
        sd = math.hypot(motion.forward_sd_m / wheel_m, share * motion.scale_sd, share * WHEELS_SD)
        return 1.0 - share, sd


def measure(
    inputs: FrameInputs, estimator: GroundMotionEstimator, change: Changed | None = None, every: int = 1
) -> Iterator[FrameMotion]:
    """Yield the motion of each frame.

    Args:
        inputs: Frames, rig, telemetry.
        estimator: For this rig.
        change: Changes the pixels; None for not at all.
        every: Only every so many frames are used; the wheels count in all.

    Raises:
        ConfigError: A frame has another size than the rig's, no row in the telemetry, or an earlier time.
    """
    rolled = _Rolled(inputs)
    pose, before = (0.0, 0.0, 0.0), None
    for place, frame in enumerate(inputs.source):
        row = inputs.row(frame.number)
        rolled.add(frame.number)
        if place % every:
            continue
        if before is not None and row.t_s <= before.t_s:
            raise ConfigError(
                f"time goes backwards: frame {frame.number} at {row.t_s:g} s follows one at {before.t_s:g} s"
            )
        grey = to_grey(frame, inputs.rig.image.width, inputs.rig.image.height)
        grey = grey if change is None else change(grey, frame.number)
        dt_s = 0.0 if before is None else row.t_s - before.t_s
        turn, turn_sd = turned(
            row.rates_rad_s, None if before is None else before.rates_rad_s, dt_s, DEFAULTS.turn
        )
        wheel_m = None if before is None else rolled.since(nanoseconds(before.t_s))
        t_ns = nanoseconds(row.t_s)
        motion = estimator.step(
            t_ns, grey, MotionPrior(forward_m=wheel_m, left_m=0.0, turn_rad=turn, turn_sd_rad=turn_sd)
        )
        if motion is not None:
            wheel_m = rolled.since(motion.from_ns)
            pose = _moved(pose, motion) if motion.is_valid else pose
        before = row
        yield FrameMotion(frame.number, row.t_s, grey, motion, wheel_m, pose)


class _Rolled:
    """Travel by the wheels at the times of the frames: trapezoids of their speed."""

    def __init__(self, inputs: FrameInputs) -> None:
        self._inputs = inputs
        self._t_s, self._speed_m_s = 0.0, 0.0
        self._rolled_m = 0.0
        self._at_ns: dict[int, float] = {}
        self._is_known = inputs.telemetry is not None

    def add(self, number: int) -> None:
        row = self._inputs.row(number)
        self._is_known &= row.wheel_speed_m_s is not None
        speed_m_s = row.wheel_speed_m_s or 0.0
        if self._at_ns:
            self._rolled_m += 0.5 * (speed_m_s + self._speed_m_s) * (row.t_s - self._t_s)
        self._t_s, self._speed_m_s = row.t_s, speed_m_s
        self._at_ns[nanoseconds(row.t_s)] = self._rolled_m

    def since(self, t_ns: int) -> float | None:
        """Return the travel since a frame; None where the wheels are not measured."""
        return self._rolled_m - self._at_ns[t_ns] if self._is_known else None


def _moved(pose: tuple[float, float, float], motion: GroundMotion) -> tuple[float, float, float]:
    """Return a pose after a motion that is given in the axes of its end."""
    yaw_rad = pose[2] + motion.turn_rad
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    x_m = pose[0] + cosine * motion.forward_m - sine * motion.left_m
    y_m = pose[1] + sine * motion.forward_m + cosine * motion.left_m
    return x_m, y_m, yaw_rad


def csv_row(item: FrameMotion) -> str:
    """Return a line of the output: m, s and rad; empty cells where nothing is known."""
    motion, slip = item.motion, item.slip
    numbers: list[float | None] = [None] * 8
    valid, reason = 0, "first frame"
    if motion is not None:
        valid, reason = int(motion.is_valid), motion.invalid_because
        duration_s = seconds(motion.to_ns - motion.from_ns)
        measured = (
            *(motion.forward_m, motion.left_m, motion.turn_rad),
            *(motion.forward_sd_m, motion.left_sd_m, motion.turn_sd_rad, motion.scale_sd),
        )
        numbers = [*(measured if valid else [None] * 7), duration_s]
    numbers += [item.wheel_m, *(slip or (None, None)), *item.pose]
    cells = ["" if value is None else f"{value:.6f}" for value in numbers]
    return f'{item.number},{item.t_s:.6f},{valid},{",".join(cells)},"{reason}"'
