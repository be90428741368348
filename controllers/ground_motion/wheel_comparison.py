"""The motion of the ground beside that of the wheels and the gyro: frames out of order, and a wrong rig."""

from collections import deque
from statistics import median
from typing import NamedTuple

import numpy as np

from controllers.fault import Fault
from controllers.ground_motion.flow import GroundFlow, PatchMotion
from controllers.ground_motion.frame_order import OUT_OF_ORDER, FrameOrder, Order
from controllers.ground_motion.ground_patch import Floats, GroundPatch
from controllers.ground_motion.mounting_watch import MountedMotion, MountingWatch
from controllers.ground_motion.parameters import GroundMotionParameters
from controllers.ground_motion.reference_frames import rotated
from controllers.ground_motion.repeating_ground import REPEATS
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.rig_watch import RigWatch
from controllers.ground_motion.tolerance import effects_of, scale_of


class ComparedPair(NamedTuple):
    """A pair that was measured, and the other sensors in its time.

    Attributes:
        motion: By the pictures, in the axes of the patch.
        pitch_rad: Change of pitch in it that the gyro does not measure.
        gyro_pitch_rad: That by the gyro.
        wheel_m: By the wheels, likewise; None where they are not measured.
        turn_rad: By the gyro.
        has_gyro: Whether it has measured all axes.
        duration_s: From frame to frame.
        period_m: Of a pattern that repeats along the motion; 0 for none.
    """

    motion: PatchMotion
    pitch_rad: float
    gyro_pitch_rad: float
    wheel_m: Floats | None
    turn_rad: float
    has_gyro: bool
    duration_s: float
    period_m: float


class WheelComparison:
    """Compares each pair with wheels and gyro.

    Args:
        ground: The rectified ground.
        flow: Its points.
        tolerance: What is not known about the rig.
        parameters: Tuned numbers.
        rotates_about_origin: Whether the rover's origin is in its place in rotations on the spot.

    Attributes:
        factor: True travel over that by the rig.
    """

    def __init__(
        self,
        ground: GroundPatch,
        flow: GroundFlow,
        tolerance: RigTolerance,
        parameters: GroundMotionParameters,
        *,
        rotates_about_origin: bool,
    ) -> None:
        self._rig, self._parameters = ground.rig, parameters
        self.factor, self._scale_sd = scale_of(ground, flow, tolerance)
        self._rig_watch = RigWatch(self._scale_sd, parameters.rig_watch)
        self._mounting = MountingWatch(
            effects_of(ground, flow, tolerance),
            self._scale_sd,
            parameters.mounting,
            is_calibrated=tolerance.scale_sd is not None,
            rotates_about_origin=rotates_about_origin,
            yaw_sd_deg=tolerance.yaw_sd_deg,
        )
        self._order = FrameOrder(parameters.order)
        self._contradictions = 0
        self._contradicting = ""
        self._ambiguities: deque[float] = deque(maxlen=parameters.validity.ambiguous_pairs)

    @property
    def scale_sd(self) -> float:
        """Standard deviation of the travel's factor."""
        return self._mounting.scale_sd

    @property
    def direction_sd_rad(self) -> float:
        """Standard deviation of the travel's direction."""
        return self._mounting.direction_sd_rad

    @property
    def unconfirmed(self) -> str:
        """What the drive has not confirmed about the rig, and how it does; "" for nothing."""
        return self._mounting.unconfirmed

    @property
    def mounting(self) -> str:
        """What pictures and gyro show to be wrong about the rig; "" for nothing."""
        return self._mounting.text

    @property
    def text(self) -> str:
        """What contradicts the rig, by the wheels or by the gyro; "" for nothing."""
        return self._rig_watch.text or self._mounting.text

    @property
    def fault(self) -> Fault | None:
        """What contradicts the rig, or does not confirm it, and by how much the travel may be wrong by it."""
        return self._rig_watch.fault

    def rotate(self, turn_rad: float) -> None:
        """Take a rotation by the gyro, whether or not its pair is valid."""
        self._mounting.rotate(turn_rad)

    def see_mirrored(self, turn_rad: float, motion: PatchMotion) -> str:
        """Take a pair that fits only the reverse of the gyro's turn; return what contradicts the rig."""
        self._mounting.compare_turn(turn_rad, motion.turn_rad, motion.turn_sd_rad)
        return self._mounting.text

    def miss(self, wheel_m: Floats | None, reason: str) -> str:
        """Take a pair that shows no motion for a reason; return that, and what to check in addition."""
        self._rig_watch.miss(0.0 if wheel_m is None else float(np.hypot(*wheel_m)))
        unfollowed = self._rig_watch.unfollowed
        return f"{reason}; {unfollowed}" if unfollowed else reason

    def begin_pair(self) -> None:
        """Take that the next frames are compared with the newest one."""
        self._order.begin()

    def order(self, pair: ComparedPair) -> Order:
        """Return whether the frame, or the one at which the pair began, is out of order."""
        if pair.wheel_m is None:
            return Order.RIGHT
        along_m, length_m = _along(pair.motion, pair.wheel_m)
        return self._order.judge(
            along_m, length_m, float(np.hypot(pair.motion.forward_sd_m, pair.motion.left_sd_m))
        )

    def contradiction(self, pair: ComparedPair, order: Order) -> str:
        """Return why no rover on these wheels moves so: a frame out of order; "" where one may.

        One that rolls back, or is pushed, contradicts its wheels in every frame, and so does a wrong rig:
        after some of one kind in a row the next ones count.
        """
        text = "" if pair.wheel_m is None else self._against_wheels(pair.motion, pair.wheel_m)
        self._contradictions = self._contradictions + 1 if text == self._contradicting else 1
        self._contradicting = text
        if order is Order.UNDECIDED:
            return OUT_OF_ORDER
        if not text or self._contradictions > MOST_CONTRADICTING:
            return ""
        if not self._rig_watch.is_confirmed and self._contradictions == 1:
            self._update_rig(pair)
        return self._rig_watch.text or text

    def doubt(self, pair: ComparedPair) -> str:
        """Take a pair that is used; return what speaks against it, "" for nothing."""
        if pair.wheel_m is not None:
            self._order.use(*_along(pair.motion, pair.wheel_m))
        self._update_mounting(pair)
        if not self._mounting.text:
            self._update_rig(pair)
        self._ambiguities.append(pair.motion.ambiguity)
        return self.text or (REPEATS if self._is_ambiguous(pair) else "")

    def _is_ambiguous(self, pair: ComparedPair) -> bool:
        """Return whether several motions explain the ground.

        Where its period is known: whether one that is a period longer or shorter is possible on these wheels.
        """
        period_m = pair.period_m
        if pair.wheel_m is None or not period_m:
            return median(self._ambiguities) > self._parameters.validity.most_ambiguous
        numbers = self._parameters.rig_watch
        along_m, length_m = _along(pair.motion, pair.wheel_m)
        least_m, most_m = -numbers.backwards * length_m, (1.0 + numbers.skid) * length_m
        return along_m - period_m > least_m or along_m + period_m < most_m

    def _against_wheels(self, motion: PatchMotion, wheel_m: Floats) -> str:
        numbers = self._parameters.rig_watch
        along_m, length_m = _along(motion, wheel_m)
        slack_m = numbers.slack_m + numbers.deviations * (motion.forward_sd_m + self._scale_sd * length_m)
        if along_m > (1.0 + numbers.skid) * length_m + slack_m:
            return (
                "ground moves farther than the wheels: frames are missing, repeated or out of order, or "
                "check camera_delay_s and the wheels' radius"
            )
        if along_m < -numbers.backwards * length_m - slack_m:
            return "ground moves against the wheels: frames are out of order, or the rover is pushed"
        return ""

    def _update_rig(self, pair: ComparedPair) -> None:
        """Compare the travel with that of the wheels.

        In a rotation on the spot it is what the swing of the camera leaves, so that a wrong rig gives it any
        direction; the mounting is compared instead.
        """
        wheel_m, motion = pair.wheel_m, pair.motion
        if wheel_m is None or not (length_m := float(np.hypot(*wheel_m))) or self._is_on_the_spot(pair):
            return
        axes = np.array([[wheel_m[0], -wheel_m[1]], [wheel_m[1], wheel_m[0]]])
        moved_m = np.array([motion.forward_m, motion.left_m])
        along_m, across_m = self.factor * moved_m / length_m @ axes
        sd_m = float(np.hypot(motion.forward_sd_m, motion.left_sd_m))
        self._rig_watch.update(length_m, complex(along_m, across_m), sd_m)

    def _levers(self, pair: ComparedPair) -> tuple[complex, complex]:
        """Return the motion of the measured point, and of the point below the camera, by the rotation."""
        point, foot = (
            complex(*rotated(np.array(each, np.float64), -self._rig.steer_rad))
            for each in (self._rig.point_m, tuple(self._rig.position_m[:2].tolist()))
        )
        return 1j * pair.turn_rad * point, 1j * pair.turn_rad * foot

    def _is_on_the_spot(self, pair: ComparedPair) -> bool:
        if pair.wheel_m is None or not pair.has_gyro:
            return False
        lever_m, swing_m = self._levers(pair)
        return abs(complex(*pair.wheel_m) - lever_m) < self._parameters.mounting.on_the_spot * abs(swing_m)

    def _update_mounting(self, pair: ComparedPair) -> None:
        """Compare the motion of the rover's origin, and in rotations that of the point below the camera."""
        if pair.wheel_m is None or not pair.has_gyro:
            return
        motion = pair.motion
        lever_m, swing_m = self._levers(pair)
        moved_m = self.factor * complex(motion.forward_m, motion.left_m) - lever_m
        wheel_m = complex(*pair.wheel_m) - lever_m
        # A rover that steers rolls ahead at its origin, or at the measured wheel. Below the camera the angle
        # by a wrong yaw is the same in rotations.
        rolls_ahead = any(
            abs(each.imag) <= self._parameters.mounting.ahead * each.real
            for each in (wheel_m, wheel_m + lever_m)
        )
        drift_m = complex((moved_m + swing_m).real, (moved_m - wheel_m).imag)
        # Near and far ground of a camera that is upside down may seem to tilt, and not to move.
        along_m, length_m = _along(motion, pair.wheel_m)
        is_along = along_m > self._parameters.rig_watch.backwards * length_m
        if self._is_on_the_spot(pair):
            self._mounting.spin(pair.turn_rad, swing_m, moved_m - wheel_m + swing_m)
        self._mounting.update(
            MountedMotion(
                duration_s=pair.duration_s,
                forward_m=motion.forward_m if is_along else float(pair.wheel_m[0]),
                drift_m=drift_m if rolls_ahead and drift_m.real > 0.0 else None,
                turn_rad=pair.turn_rad,
                seen_turn_rad=motion.turn_rad,
                seen_turn_sd_rad=motion.turn_sd_rad,
                pitch_rad=pair.pitch_rad,
                gyro_pitch_rad=pair.gyro_pitch_rad,
            )
        )


def _along(motion: PatchMotion, wheel_m: Floats) -> tuple[float, float]:
    """Return the motion along that of the wheels, and their travel."""
    length_m = float(np.hypot(*wheel_m))
    return float(motion.forward_m * wheel_m[0] + motion.left_m * wheel_m[1]) / max(length_m, 1e-9), length_m


MOST_CONTRADICTING = 2
"""Frames out of order in a row: a rover that rolls back contradicts its wheels in every frame."""
