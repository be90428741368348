"""Runs the estimator of the motion over the ground over recorded frames."""

import cmath
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from controllers.estimation.ground.travel import WHEELS_SD
from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.motion import GroundMotion
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.prior import MotionPrior, turned
from drivers.clock import nanoseconds, seconds
from drivers.errors import ConfigError
from drivers.samples import Image
from rover_hil.ftrace.frames import to_grey
from rover_hil.ftrace.inputs import FrameInputs
from rover_hil.ftrace.telemetry import TelemetryRow

HEADER = (
    "frame,t,valid,forward_m,left_m,turn_rad,forward_sd_m,left_sd_m,turn_sd_rad,scale_sd,duration_s,"
    "wheel_travel_m,slip,slip_sd,x_m,y_m,yaw_rad,reason"
)
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
        wheel_m: Travel of this point by the wheels in the time of the motion; None where it is not known.
        pose: Of the rover's origin since the first frame: forward and left in m, yaw in rad; None after a
            motion that was not measured.
    """

    number: int
    t_s: float
    grey: Image
    motion: GroundMotion | None
    wheel_m: float | None
    pose: tuple[float, float, float] | None

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
    path = _Path(inputs)
    pose: tuple[float, float, float] | None = (0.0, 0.0, 0.0)
    before: TelemetryRow | None = None
    for place, frame in enumerate(inputs.source):
        row = inputs.row(frame.number)
        path.add(row)
        if place % every:
            continue
        if before is not None and row.t_s <= before.t_s:
            raise ConfigError(
                f"time goes backwards: frame {frame.number} at {row.t_s:g} s follows one at {before.t_s:g} s"
            )
        grey = to_grey(frame, inputs.rig.image.width, inputs.rig.image.height)
        grey = grey if change is None else change(grey, frame.number)
        dt_s = 0.0 if before is None else row.t_s - before.t_s
        rates = None if before is None else before.rates_rad_s
        turn, turn_sd = turned(row.rates_rad_s, rates, dt_s, DEFAULTS.turn)
        moved_m = None if before is None else path.since(nanoseconds(before.t_s))
        prior = MotionPrior(
            forward_m=None if moved_m is None else moved_m.real,
            left_m=0.0 if moved_m is None else moved_m.imag,
            turn_rad=turn,
            turn_sd_rad=turn_sd,
            has_gyro=row.rates_rad_s is not None and rates is not None,
        )
        motion = estimator.step(nanoseconds(row.t_s), grey, prior)
        wheel_m = None
        if motion is not None:
            rolled_m = path.since(motion.from_ns)
            wheel_m = None if rolled_m is None else rolled_m.real
            if motion.is_valid and pose is not None:
                pose = _moved(pose, motion)
            elif not motion.is_open:
                pose = None
        if estimator.from_ns is not None:
            path.forget(estimator.from_ns)
        before = row
        yield FrameMotion(frame.number, row.t_s, grey, motion, wheel_m, pose)


class _Path:
    """Path of the measured point by wheels and gyro: trapezoids of speed and yaw rate."""

    def __init__(self, inputs: FrameInputs) -> None:
        point = inputs.rig.geometry().point_m
        self._arm_m = complex(*point) if inputs.is_of_rover else 0j
        self._before: TelemetryRow | None = None
        self._yaw_rad = 0.0
        self._place_m: complex | None = None
        self._begins: dict[int, tuple[complex | None, float, int]] = {}
        self._gaps = 0

    def add(self, row: TelemetryRow) -> None:
        before, self._before = self._before, row
        if before is not None:
            dt_s = row.t_s - before.t_s
            rates = [each[2] for each in (before.rates_rad_s, row.rates_rad_s) if each is not None]
            turn_rad = dt_s * sum(rates) / len(rates) if rates else 0.0
            speeds = [each.wheel_speed_m_s for each in (before, row)]
            if speeds[0] is None or speeds[1] is None:
                self._gaps += 1
            else:
                step_m = 0.5 * (speeds[0] + speeds[1]) * dt_s
                place_m = self._place_m or 0j
                self._place_m = place_m + cmath.rect(step_m, self._yaw_rad + 0.5 * turn_rad)
            self._yaw_rad += turn_rad
        self._begins[nanoseconds(row.t_s)] = (self._place_m, self._yaw_rad, self._gaps)

    def forget(self, before_ns: int) -> None:
        """Forget the frames before a time."""
        for earlier_ns in [each for each in self._begins if each < before_ns]:
            del self._begins[earlier_ns]

    def since(self, t_ns: int) -> complex | None:
        """Return the motion since a frame in the present axes; None where the wheels were not measured."""
        place_m, yaw_rad, gaps = self._begins[t_ns]
        if self._place_m is None or gaps != self._gaps:
            return None
        turn_rad = self._yaw_rad - yaw_rad
        moved_m = (self._place_m - (place_m or 0j)) * cmath.rect(1.0, -self._yaw_rad)
        return moved_m + self._arm_m * (1.0 - cmath.rect(1.0, -turn_rad))


def _moved(pose: tuple[float, float, float], motion: GroundMotion) -> tuple[float, float, float]:
    """Return a pose of the origin after a motion of the measured point, in the axes of its end."""
    yaw_rad = pose[2] + motion.turn_rad
    arm_m = complex(*motion.point_m) * (1.0 - cmath.rect(1.0, -motion.turn_rad))
    place_m = (complex(motion.forward_m, motion.left_m) - arm_m) * cmath.rect(1.0, yaw_rad)
    return pose[0] + place_m.real, pose[1] + place_m.imag, yaw_rad


def csv_row(item: FrameMotion) -> str:
    """Return a line of the output: m, s and rad; empty cells where nothing is known."""
    motion, slip = item.motion, item.slip
    numbers: list[float | None] = [None] * 9
    is_valid, reason = False, "first frame"
    if motion is not None:
        is_valid, reason = motion.is_valid, motion.invalid_because
        if is_valid:
            numbers = [
                *(motion.forward_m, motion.left_m, motion.turn_rad),
                *(motion.forward_sd_m, motion.left_sd_m, motion.turn_sd_rad, motion.scale_sd),
                *(seconds(motion.to_ns - motion.from_ns), item.wheel_m),
            ]
    numbers += [*(slip or (None, None)), *(item.pose or (None, None, None))]
    cells = ["" if value is None else f"{value:.6f}" for value in numbers]
    return f'{item.number},{item.t_s:.6f},{int(is_valid)},{",".join(cells)},"{reason}"'
