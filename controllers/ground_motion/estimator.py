"""Motion of the rover over the ground, frame by frame."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from controllers.ground_motion.choice import choose
from controllers.ground_motion.flow import GroundFlow, PatchMotion
from controllers.ground_motion.frame_order import OUT_OF_ORDER, Order
from controllers.ground_motion.ground_patch import Floats, Mask, Patch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.motion import GroundMotion
from controllers.ground_motion.moving_parts import MovingParts
from controllers.ground_motion.parameters import DEFAULTS, GroundMotionParameters
from controllers.ground_motion.prior import MotionPrior
from controllers.ground_motion.reference_frames import Reference, ReferenceFrames, rotated
from controllers.ground_motion.repeating_ground import REPEATS, RepeatingGround
from controllers.ground_motion.repeats import RepeatWatch
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.standing_proof import StandingProof
from controllers.ground_motion.static_pattern import StaticPattern
from controllers.ground_motion.wheel_comparison import ComparedPair, WheelComparison
from drivers.clock import seconds
from drivers.errors import ModelError
from drivers.samples import Image

FREE_SHARES = (0.0, 0.5, 1.0, 1.5)
"""Of the last motion: starts of the search where no wheel measures the travel."""

NO_MOTION = PatchMotion(
    forward_m=0.0,
    left_m=0.0,
    turn_rad=0.0,
    tilt_rad=(0.0, 0.0),
    forward_sd_m=0.0,
    left_sd_m=0.0,
    turn_sd_rad=0.0,
    points=0,
    share=1.0,
    moved_pixels=0.0,
    moved_sd_pixels=0.0,
)
"""Between a picture and the same once more."""


CONFLICT = 3.0
"""Two measurements of one motion that differ by more of their standard deviations are not averaged."""


class _Compared(NamedTuple):
    """A pair by comparison with an earlier frame.

    Attributes:
        motion: Of the pair.
        pose: Of the frame, as in `Reference`.
        sd: Standard deviation of the motion since the earlier frame, forward and left.
        pitch_rad: Change of pitch in the pair that the gyro does not measure.
        is_fixed: Whether the points that show it do not move in the picture.
    """

    motion: PatchMotion
    pose: Floats
    sd: Floats
    pitch_rad: float
    is_fixed: bool


class GroundMotionEstimator:
    """Measures the motion between frames of one camera.

    A frame is compared with an earlier one that is some pixels of ground apart, where there is one: slow
    motion is then as certain as fast, and what is fixed in the picture is not taken for ground that stands.

    Args:
        view: The ground in the frames of the rig; others may look at it too.
        tolerance: What is not known about the rig.
        parameters: Tuned numbers.
        rotates_about_origin: Whether the rover's origin is in its place in rotations on the spot; not where
            wheels skid in them.

    Attributes:
        pair: The last motion in the axes of the patch, as the pictures show it; None where not measured,
            no motion for a picture that is repeated.
        moving_parts: Points of the view that move with the rover, and are left out.
    """

    def __init__(
        self,
        view: GroundView,
        tolerance: RigTolerance | None = None,
        parameters: GroundMotionParameters = DEFAULTS,
        *,
        rotates_about_origin: bool = True,
    ) -> None:
        ground = view.ground
        self._view, self._ground, self._parameters = view, ground, parameters
        self._structure = view.structure
        self._flow = GroundFlow(ground, parameters.flow)
        self._wheels = WheelComparison(
            ground,
            self._flow,
            tolerance or RigTolerance(),
            parameters,
            rotates_about_origin=rotates_about_origin,
        )
        self._visible = ground.visible.astype(np.uint8)
        self._pattern = StaticPattern(ground.shape, parameters.pattern)
        self.moving_parts = MovingParts(len(self._flow.points_m()), parameters.moving_parts)
        self._repeating = RepeatingGround(ground, parameters.repeating)
        self._proof = StandingProof(ground.pixel_m, parameters.standing)
        self._repeats = RepeatWatch(self._visible, parameters.repeats)
        self._frames = ReferenceFrames(ground, parameters.validity)
        self._most_travel_m = parameters.validity.most_travel_share * ground.shape[0] * ground.pixel_m
        self._foot_m = (float(ground.rig.position_m[0]), float(ground.rig.position_m[1]))
        self._turned: Floats = np.zeros((2, 3))
        self._travel_m: Floats | None = np.zeros(2)
        self._last_m: Floats = np.zeros(2)
        self._has_gyro = True
        self._left_out = 0
        self._t_ns: int | None = None
        self._grey: Image | None = None
        self.pair: PatchMotion | None = None

    @property
    def from_ns(self) -> int | None:
        """Time of the frame at which the next pair begins; None before the first."""
        return self._t_ns

    @property
    def mounting(self) -> str:
        """Return what pictures and gyro show to be wrong about the rig; "" for nothing."""
        return self._wheels.mounting

    @property
    def fixed_in_picture(self) -> Mask:
        """Return the pixels of the rectified ground that hold something which never moves."""
        return self._pattern.mask

    def step(self, t_ns: int, image: Image, prior: MotionPrior) -> GroundMotion | None:
        """Return the motion since the frame before; None for the first frame.

        After a repeated frame the motion is that since the picture was new: `from_ns` says so.

        Args:
            t_ns: Time of the frame, middle of its exposure.
            image: Grey or BGR pixels, of the rig's size.
            prior: Motion since the frame before by other sensors.

        Raises:
            ModelError: Time goes backwards, or the frame has another size than the rig's.
        """
        seen = self._view.look(image)
        return self.step_patch(t_ns, seen.patch, seen.structure, prior)

    def step_patch(
        self, t_ns: int, patch: Image, structure: Patch, prior: MotionPrior
    ) -> GroundMotion | None:
        """Return the motion as `step` does, of ground that is rectified already, and its fine structure."""
        if self._t_ns is not None and t_ns < self._t_ns:
            raise ModelError(
                f"frame time {t_ns} ns is not after the one before, {self._t_ns} ns: give frames in order"
            )
        self._expect(prior)
        self.pair = None
        before_ns = self._t_ns
        if before_ns is None:
            self._repeats.begin(patch)
            self._restart(t_ns, patch, structure)
            return None
        if self._is_repeated(t_ns, patch):
            self.pair = NO_MOTION
            self._left_out += 1
            return self._invalid(before_ns, t_ns, "frame repeated")
        wheel_m = self._travel_m
        if self._repeats.is_undecided and (wheel_m is None or np.hypot(*wheel_m) > self._ground.pixel_m):
            self._begin(t_ns, patch)
            return self._invalid(before_ns, t_ns, "frames are repeated for long, or the ground stands")
        picture = self._structure.picture(self._pattern.without(structure))
        found, reason = self._measure(picture)
        self._repeating.take(structure, is_needed=found is None)
        period_m = self._repeating.period_m(self._travel_m)
        if found is None:
            repeats = bool(period_m) and not self._travels_too_far()
            reason = REPEATS if repeats else self._wheels.miss(self._travel_m, self._proof.doubt(reason))
            reason = self._mirrored(picture) or reason
            self._restart(t_ns, patch, structure)
            return self._invalid(before_ns, t_ns, reason)
        motion = found.motion
        compared = ComparedPair(
            motion=motion,
            pitch_rad=found.pitch_rad,
            gyro_pitch_rad=float(self._turned[0, 1]),
            wheel_m=self._travel_m,
            turn_rad=float(self._turned[0, 2]),
            has_gyro=self._has_gyro,
            duration_s=seconds(t_ns - before_ns),
            period_m=period_m,
        )
        moved_m = np.array([motion.forward_m, motion.left_m])
        reason = self._proof.why_not(structure, self._travel_m, moved_m, is_fixed=found.is_fixed)
        order = self._wheels.order(compared)
        if order is Order.WRONG:
            self._restart(t_ns, patch, structure)
            return self._invalid(before_ns, t_ns, OUT_OF_ORDER)
        reason = reason or self._wheels.contradiction(compared, order)
        if reason:
            self._leave_out(t_ns, patch, structure)
            return self._invalid(before_ns, t_ns, reason)
        self._last_m = moved_m
        self._pattern.update(structure, motion.moved_pixels)
        if motion.tracks is not None:
            self.moving_parts.update(motion.tracks, motion.moved_pixels)
        self._frames.add(Reference(picture=picture, pose=found.pose, sd=found.sd))
        self._begin(t_ns, patch)
        self.pair = motion
        if doubt := self._wheels.doubt(compared):
            return self._invalid(before_ns, t_ns, doubt)
        return self._valid(before_ns, t_ns, motion)

    def _expect(self, prior: MotionPrior) -> None:
        """Add the motion by other sensors, in the axes of the patch."""
        self._turned = self._turned + np.array([prior.turn_rad, prior.turn_sd_rad])
        self._has_gyro &= prior.has_gyro
        self._wheels.rotate(prior.turn_rad[2])
        if prior.forward_m is None or self._travel_m is None:
            self._travel_m = None
            return
        self._travel_m = self._travel_m + rotated(
            np.array([prior.forward_m, prior.left_m]), -self._ground.rig.steer_rad
        )

    def _is_repeated(self, t_ns: int, patch: Image) -> bool:
        """Return whether this is the frame before once more."""
        if t_ns == self._t_ns:
            return True
        if self._grey is None:
            return False
        return self._repeats.is_repeated(patch, self._grey, may_wait=self._may_wait())

    def _may_wait(self) -> bool:
        """Return whether the pair may stay open for a frame more: by the last motion, else by the wheels."""
        if self._last_m.any():
            return (self._left_out + 2) * float(np.hypot(*self._last_m)) < self._most_travel_m
        wheel_m = self._travel_m
        return wheel_m is None or 2.0 * float(np.hypot(*wheel_m)) < self._most_travel_m

    def _travels_too_far(self) -> bool:
        """Return whether the wheels have rolled too far for two frames in a row."""
        wheel_m = self._travel_m
        return wheel_m is not None and not self._left_out and bool(np.hypot(*wheel_m) > self._most_travel_m)

    def _leave_out(self, t_ns: int, patch: Image, structure: Patch) -> None:
        """Leave a frame out: the pair stays open, and its motion is measured with a later one."""
        self._left_out += 1
        if self._left_out > self._parameters.validity.most_left_out or not self._may_wait():
            picture = self._structure.picture(self._pattern.without(structure))
            self._frames.begin(picture)
            self._begin(t_ns, patch)

    def _measure(self, picture: Image) -> tuple[_Compared | None, str]:
        """Return the motion of the pair, and why there is none."""
        wheel_m = self._travel_m
        if wheel_m is not None and self._travels_too_far():
            return None, _too_far(float(np.hypot(*wheel_m)), self._most_travel_m)
        reason = ""
        order, second = self._frames.choose(self._last_m)
        for reference in order:
            for starts_m in self._starts(wheel_m):
                found, reason = self._compare(reference, picture, starts_m, self._turned)
                if found is None:
                    continue
                if second is not reference:
                    found = self._with_second(found, second, picture)
                length_m = float(np.hypot(found.motion.forward_m, found.motion.left_m))
                if length_m > self._most_travel_m:
                    return None, _too_far(length_m, self._most_travel_m)
                return found, ""
        return None, reason

    def _with_second(self, first: _Compared, second: Reference, picture: Image) -> _Compared:
        """Return a pair by two earlier frames, weighted by their variances.

        With one, frames that are compared with the same ones would form chains of their own, whose errors
        show in every pair. Where both differ by more than their deviations the mean is as uncertain as they
        differ (Birge's ratio); where they contradict each other the frame farther away decides, from which
        the ground has moved more.
        """
        last_sd = self._frames.last.sd
        first_sd = np.hypot(first.sd, last_sd)
        alone = first._replace(motion=_with_sd(first.motion, first_sd))
        other, _ = self._compare(second, picture, np.array([_moved(first.motion)]), self._turned)
        if other is None or (other.is_fixed and not first.is_fixed):
            return alone
        other_sd = other.sd if second is self._frames.last else np.hypot(other.sd, last_sd)
        both = np.array([_moved(first.motion), _moved(other.motion)])
        ratio = np.maximum(1.0, np.abs(both[0] - both[1]) / np.hypot(first_sd, other_sd))
        if (ratio > CONFLICT).any():
            return alone._replace(motion=_with_sd(first.motion, np.maximum(first_sd, abs(both[0] - both[1]))))
        weight = other_sd**2 / (first_sd**2 + other_sd**2)
        forward_m, left_m = weight * both[0] + (1.0 - weight) * both[1]
        pose = first.pose.copy()
        pose[:2] = self._frames.last.pose[:2] + rotated(np.array([forward_m, left_m]), float(pose[2]))
        moved_pixels = float(np.hypot(forward_m, left_m)) / self._ground.pixel_m
        motion = replace(
            first.motion, forward_m=float(forward_m), left_m=float(left_m), moved_pixels=moved_pixels
        )
        return first._replace(
            motion=_with_sd(motion, ratio * first_sd * other_sd / np.hypot(first_sd, other_sd)),
            pose=pose,
            sd=ratio / np.sqrt(1.0 / first.sd**2 + 1.0 / (other.sd**2 + second.sd**2)),
        )

    def _mirrored(self, picture: Image) -> str:
        """Take a pair that shows no motion; return whether rotations against the gyro show mirrored pictures.

        In a fast rotation the points of a mirrored picture fit the measured turn nowhere.
        """
        turn_rad, turn_sd_rad = self._turned[:, 2].tolist()
        if not self._has_gyro or abs(turn_rad) < CONFLICT * turn_sd_rad:
            return ""
        wheel_m = None if self._travel_m is None else self._travel_m * (1.0, -1.0)
        turned = self._turned * np.array([[-1.0, 1.0, -1.0], [1.0, 1.0, 1.0]])
        found, _ = self._compare(self._frames.last, picture, self._starts(wheel_m)[0], turned)
        return "" if found is None else self._wheels.see_mirrored(turn_rad, found.motion)

    def _starts(self, wheel_m: Floats | None) -> list[Floats]:
        """Return motions of the pair to start from: likely ones, and others for when these fail."""
        numbers, pixel_m = self._parameters.flow, self._ground.pixel_m
        if wheel_m is None:
            reach_m = self._most_travel_m
            count = max(round(reach_m / pixel_m / numbers.start_pixels), 1) + 1
            ahead = np.stack([np.linspace(0.0, reach_m, count), np.zeros(count)], axis=1)
            near = np.outer(FREE_SHARES, self._last_m)
            return [near, ahead, -ahead] if self._last_m.any() else [ahead, -ahead]
        reach = float(np.hypot(*wheel_m)) / pixel_m
        count = int(np.clip(np.ceil(reach / numbers.start_pixels) + 1, 2, numbers.most_starts))
        shares = np.linspace(1.0, 0.0, count)
        return [np.outer(shares, wheel_m), np.outer(-shares[:-1], wheel_m)]

    def _compare(
        self, reference: Reference, picture: Image, starts_m: Floats, turned: Floats
    ) -> tuple[_Compared | None, str]:
        """Return the pair by comparison with an earlier frame, and why there is none."""
        (roll, pitch, yaw), deviations = turned
        last = self._frames.last.pose
        before = last - reference.pose
        angles = (float(before[3] + roll), float(before[4] + pitch), float(before[2] + yaw))
        # Motion between that frame and the one before, in the axes of this one.
        known_m = rotated(before[:2], -float(last[2] + yaw))
        wheel_m = self._travel_m
        reach_m = self._most_travel_m if wheel_m is None else float(np.hypot(*wheel_m))
        most_m = float(np.hypot(*known_m)) + self._parameters.flow.overrun * reach_m
        followed = self._flow.follow(
            reference.picture,
            picture,
            known_m + starts_m,
            angles,
            tuple(deviations.tolist()),
            most_m,
            self.moving_parts.mask,
        )
        validity = self._parameters.validity
        found, reason = choose(followed, float(np.hypot(*known_m)) / self._ground.pixel_m, validity)
        if found is None:
            return None, reason
        turn_rad = float(reference.pose[2]) + found.turn_rad
        pose = np.r_[
            reference.pose[:2] + rotated(np.array(_moved(found)), turn_rad),
            turn_rad,
            reference.pose[3:] + found.tilt_rad,
        ]
        forward_m, left_m = rotated(pose[:2] - last[:2], -turn_rad).tolist()
        motion = replace(
            found,
            forward_m=forward_m,
            left_m=left_m,
            turn_rad=turn_rad - float(last[2]),
            moved_pixels=float(np.hypot(forward_m, left_m)) / self._ground.pixel_m,
        )
        sd = np.array([found.forward_sd_m, found.left_sd_m])
        is_fixed = found.moved_pixels <= validity.still_pixels
        return _Compared(motion, pose, sd, found.tilt_rad[1] - angles[1], is_fixed), ""

    def _restart(self, t_ns: int, patch: Image, structure: Patch) -> None:
        """Begin a new chain of poses with this frame; nothing before it is examined."""
        self._frames.begin(self._structure.picture(self._pattern.without(structure)))
        self._proof.begin(structure)
        self._begin(t_ns, patch)

    def _begin(self, t_ns: int, patch: Image) -> None:
        """Begin the next pair."""
        self._left_out = 0
        self._proof.begin_pair()
        self._wheels.begin_pair()
        self._t_ns, self._grey = t_ns, patch
        self._travel_m, self._turned, self._has_gyro = np.zeros(2), np.zeros((2, 3)), True

    def _valid(self, from_ns: int, to_ns: int, motion: PatchMotion) -> GroundMotion:
        rig = self._ground.rig
        cosine, sine = np.cos(rig.steer_rad), np.sin(rig.steer_rad)
        forward_m, left_m = (
            self._wheels.factor * rotated(np.array([motion.forward_m, motion.left_m]), rig.steer_rad)
        ).tolist()
        return GroundMotion(
            from_ns=from_ns,
            to_ns=to_ns,
            point_m=rig.point_m,
            foot_m=self._foot_m,
            forward_m=forward_m,
            left_m=left_m,
            turn_rad=motion.turn_rad,
            forward_sd_m=float(np.hypot(cosine * motion.forward_sd_m, sine * motion.left_sd_m)),
            left_sd_m=float(np.hypot(sine * motion.forward_sd_m, cosine * motion.left_sd_m)),
            turn_sd_rad=motion.turn_sd_rad,
            scale_sd=self._wheels.scale_sd,
            direction_sd_rad=self._wheels.direction_sd_rad,
            rig_fault=self._wheels.fault,
            unconfirmed=_listed(self._wheels.unconfirmed, self._repeating.limit),
        )

    def _invalid(self, from_ns: int, to_ns: int, reason: str) -> GroundMotion:
        """Return that the pair measures nothing; what contradicts the rig does so until it is gone."""
        return GroundMotion(
            from_ns=from_ns,
            to_ns=to_ns,
            point_m=self._ground.rig.point_m,
            foot_m=self._foot_m,
            forward_m=0.0,
            left_m=0.0,
            turn_rad=0.0,
            forward_sd_m=0.0,
            left_sd_m=0.0,
            turn_sd_rad=0.0,
            scale_sd=self._wheels.scale_sd,
            direction_sd_rad=self._wheels.direction_sd_rad,
            rig_fault=self._wheels.fault,
            unconfirmed=_listed(self._wheels.unconfirmed, self._repeating.limit),
            invalid_because=reason if self._wheels.text in reason else self._wheels.text,
            is_open=self._t_ns == from_ns,
        )


def _listed(*texts: str) -> str:
    return "; ".join(text for text in texts if text)


def _moved(motion: PatchMotion) -> tuple[float, float]:
    return motion.forward_m, motion.left_m


def _with_sd(motion: PatchMotion, sd: Floats) -> PatchMotion:
    return replace(motion, forward_sd_m=float(sd[0]), left_sd_m=float(sd[1]))


def _too_far(travel_m: float, most_m: float) -> str:
    return (
        f"{travel_m:.2f} m between two frames, at most {most_m:.2f} m: take more frames per second, or drive "
        "more slowly"
    )
