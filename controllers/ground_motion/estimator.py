"""Motion of the rover over the ground, frame by frame."""

from collections import deque
from dataclasses import dataclass, replace
from statistics import median

import cv2
import numpy as np

from controllers.ground_motion.flow import Followed, GroundFlow, PatchMotion, Tracks
from controllers.ground_motion.ground_patch import Floats, Mask, Patch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.motion import GroundMotion
from controllers.ground_motion.mounting_watch import MountedMotion, MountingWatch
from controllers.ground_motion.moving_parts import MovingParts
from controllers.ground_motion.parameters import DEFAULTS, GroundMotionParameters
from controllers.ground_motion.prior import MotionPrior
from controllers.ground_motion.repeats import RepeatWatch
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.rig_watch import RigWatch
from controllers.ground_motion.standing_proof import StandingProof
from controllers.ground_motion.static_pattern import StaticPattern
from controllers.ground_motion.tolerance import effects_of, scale_of
from drivers.clock import seconds
from drivers.errors import ModelError
from drivers.samples import Image

FREE_SHARES = (0.0, 0.5, 1.0, 1.5)
"""Of the last motion: starts of the search where no wheel measures the travel."""

MOST_CONTRADICTING = 2
"""A rover that rolls back, or is pushed, contradicts its wheels in every frame: so many are left out."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Past:
    """A frame to compare with.

    Attributes:
        picture: Fine structure in grey levels.
        pose: Of the measured point in the axes of the first frame of the chain: forward, left, turn, and roll
            and pitch since then.
        sd: Standard deviation of it, forward and left.
    """

    picture: Image
    pose: Floats
    sd: Floats


class GroundMotionEstimator:
    """Measures the motion between frames of one camera.

    A frame is compared with an earlier one that is some pixels of ground apart, where there is one: slow
    motion is then as certain as fast, and what is fixed in the picture is not taken for ground that stands.

    Args:
        view: The ground in the frames of the rig; others may look at it too.
        tolerance: What is not known about the rig.
        parameters: Tuned numbers.

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
    ) -> None:
        ground = view.ground
        self._view, self._ground, self._parameters = view, ground, parameters
        self._structure = view.structure
        self._flow = GroundFlow(ground, parameters.flow)
        self._factor, self._scale_sd = scale_of(ground, self._flow, tolerance or RigTolerance())
        self._visible = ground.visible.astype(np.uint8)
        self._pattern = StaticPattern(ground.shape, parameters.pattern)
        self.moving_parts = MovingParts(len(self._flow.points_m()), parameters.moving_parts)
        self._proof = StandingProof(ground.pixel_m, parameters.standing)
        self._repeats = RepeatWatch(parameters.repeats)
        self._watch = RigWatch(self._scale_sd, parameters.rig_watch)
        self._mounting = MountingWatch(
            effects_of(ground, self._flow, tolerance or RigTolerance()),
            self._scale_sd,
            parameters.mounting,
            is_calibrated=tolerance is not None and tolerance.scale_sd is not None,
        )
        self._most_travel_m = parameters.validity.most_travel_share * ground.shape[0] * ground.pixel_m
        validity = parameters.validity
        self._baseline_pixels = (
            validity.coarse_baseline_pixels if ground.is_coarse else validity.baseline_pixels
        )
        self._past: list[_Past] = []
        self._pose: Floats = np.zeros(5)
        self._last = _Past(picture=np.zeros(ground.shape, np.uint8), pose=self._pose, sd=np.zeros(2))
        self._next_pose, self._next_sd, self._pitch_rad = self._pose, np.zeros(2), 0.0
        self._is_fixed = self._has_contradicted = False
        self._ambiguous = 0.0
        self._ambiguities: deque[float] = deque(maxlen=parameters.validity.ambiguous_pairs)
        self._turned: Floats = np.zeros((2, 3))
        self._travel_m: Floats | None = np.zeros(2)
        self._last_m: Floats = np.zeros(2)
        self._left_out = 0
        self._t_ns: int | None = None
        self._grey: Image | None = None
        self.pair: PatchMotion | None = None

    @property
    def from_ns(self) -> int | None:
        """Time of the frame at which the next pair begins; None before the first."""
        return self._t_ns

    @property
    def fixed_in_picture(self) -> Mask:
        """Return the pixels of the rectified ground that hold something which never moves."""
        return self._pattern.mask

    @property
    def tracks(self) -> Tracks | None:
        """Return the points of the last pair that was measured; None before."""
        return self._flow.tracks

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
            self._restart(t_ns, patch, structure)
            self._proof.begin(structure)
            return None
        if self._is_repeated(t_ns, patch):
            self.pair = NO_MOTION
            self._left_out += 1
            return self._invalid(before_ns, t_ns, "frame repeated")
        picture = self._structure.picture(self._pattern.without(structure))
        motion, reason = self._measure(picture)
        if motion is None:
            self._watch.miss(0.0 if self._travel_m is None else float(np.hypot(*self._travel_m)))
            reason += self._watch.unfollowed
            self._restart(t_ns, patch, structure)
            self._proof.begin(structure)
            return self._invalid(before_ns, t_ns, reason)
        wheel_m = self._travel_m
        moved_m = np.array([motion.forward_m, motion.left_m])
        reason = self._proof.why_not(structure, wheel_m, moved_m, is_fixed=self._is_fixed)
        reason = reason or self._contradiction(motion)
        if reason:
            if not self._watch.is_confirmed:
                self._compare_with_wheels(motion, moved_m, seconds(t_ns - before_ns))
            self._skip(t_ns, patch, structure)
            return self._invalid(before_ns, t_ns, self._watch.text or reason)
        self.pair = motion
        self._last_m = moved_m
        self._compare_with_wheels(motion, moved_m, seconds(t_ns - before_ns))
        self._pattern.update(structure, motion.moved_pixels)
        if self._flow.tracks is not None:
            self.moving_parts.update(self._flow.tracks, motion.moved_pixels)
        self._remember(picture)
        self._begin(t_ns, patch)
        if doubt := self._watch.text or self._mounting.text or self._ambiguity():
            return self._invalid(before_ns, t_ns, doubt)
        return self._valid(before_ns, t_ns, motion)

    def _expect(self, prior: MotionPrior) -> None:
        """Add the motion by other sensors, in the axes of the patch."""
        self._turned = self._turned + np.array([prior.turn_rad, prior.turn_sd_rad])
        self._mounting.rotate(prior.turn_rad[2])
        if prior.forward_m is None or self._travel_m is None:
            self._travel_m = None
            return
        self._travel_m = self._travel_m + rotated(
            np.array([prior.forward_m, prior.left_m]), -self._ground.rig.steer_rad
        )

    def _is_repeated(self, t_ns: int, patch: Image) -> bool:
        """Return whether this is the frame before once more."""
        grey = self._grey
        if t_ns == self._t_ns:
            return True
        if grey is None:
            return False
        apart_grey = cv2.mean(cv2.absdiff(patch, grey), self._visible)[0]
        return self._repeats.is_repeated(apart_grey, may_wait=self._may_wait())

    def _compare_with_wheels(self, motion: PatchMotion, moved_m: Floats, duration_s: float) -> None:
        wheel_m = self._travel_m
        if wheel_m is None or not (length_m := float(np.hypot(*wheel_m))):
            return
        axes = np.array([[wheel_m[0], -wheel_m[1]], [wheel_m[1], wheel_m[0]]])
        along_m, across_m = self._factor * moved_m / length_m @ axes
        sd_m = float(np.hypot(motion.forward_sd_m, motion.left_sd_m))
        self._watch.update(length_m, complex(along_m, across_m), sd_m)
        turn_rad, rig = float(self._turned[0, 2]), self._ground.rig
        lever_m = turn_rad * rotated(np.array([-rig.point_m[1], rig.point_m[0]]), -rig.steer_rad)
        if np.hypot(*(wheel_m - lever_m)) < self._parameters.mounting.on_the_spot * np.hypot(*lever_m):
            self._mounting.spin(turn_rad, complex(*lever_m), complex(*(self._factor * moved_m)))
        self._mounting.update(
            MountedMotion(
                duration_s=duration_s,
                forward_m=motion.forward_m,
                left_m=motion.left_m - float(wheel_m[1]),
                turn_rad=turn_rad,
                seen_turn_rad=motion.turn_rad,
                seen_turn_sd_rad=motion.turn_sd_rad,
                pitch_rad=self._pitch_rad,
            )
        )

    def _ambiguity(self) -> str:
        """Return why the ground may also have moved otherwise; "" where it may not."""
        self._ambiguities.append(self._ambiguous)
        if median(self._ambiguities) <= self._parameters.validity.most_ambiguous:
            return ""
        return "several motions explain the ground, its pattern repeats: take more frames per second"

    def _may_wait(self) -> bool:
        """Return whether the pair may stay open for a frame more: by the last motion, else by the wheels."""
        if self._last_m.any():
            return (self._left_out + 2) * float(np.hypot(*self._last_m)) < self._most_travel_m
        wheel_m = self._travel_m
        return wheel_m is None or 2.0 * float(np.hypot(*wheel_m)) < self._most_travel_m

    def _skip(self, t_ns: int, patch: Image, structure: Patch) -> None:
        """Leave a frame out: the pair stays open, and its motion is measured with a later one."""
        self._left_out += 1
        if self._left_out > self._parameters.validity.most_left_out or not self._may_wait():
            self._restart(t_ns, patch, structure)

    def _contradiction(self, motion: PatchMotion) -> str:
        """Return why no rover on these wheels moves so: a frame out of order; "" where one may.

        One that rolls back, or is pushed, contradicts its wheels in every frame, and so does a wrong rig.
        """
        wheel_m = self._travel_m
        text = "" if wheel_m is None else self._against_wheels(motion, wheel_m)
        may_wait = self._left_out < MOST_CONTRADICTING and self._may_wait()
        if text and may_wait and not self._has_contradicted:
            return text
        self._has_contradicted = bool(text)
        return ""

    def _against_wheels(self, motion: PatchMotion, wheel_m: Floats) -> str:
        numbers, length_m = self._parameters.rig_watch, float(np.hypot(*wheel_m))
        along_m = (motion.forward_m * wheel_m[0] + motion.left_m * wheel_m[1]) / max(length_m, 1e-9)
        slack_m = numbers.slack_m + numbers.deviations * (motion.forward_sd_m + self._scale_sd * length_m)
        if along_m > (1.0 + numbers.skid) * length_m + slack_m:
            return "ground moves farther than the wheels: frames are missing, repeated or out of order"
        if along_m < -numbers.backwards * length_m - slack_m:
            return "ground moves against the wheels: frames are out of order"
        return ""

    def _measure(self, picture: Image) -> tuple[PatchMotion | None, str]:
        """Return the motion of the pair, and why there is none."""
        wheel_m = self._travel_m
        if wheel_m is not None and not self._left_out and np.hypot(*wheel_m) > self._most_travel_m:
            return None, self._too_far(float(np.hypot(*wheel_m)))
        reason = ""
        references, second = self._references()
        for past in references:
            for starts_m in self._starts(wheel_m):
                motion, reason = self._compare(past, picture, starts_m)
                if motion is None:
                    continue
                if second is not past:
                    motion = self._with_second(motion, second, picture)
                length_m = float(np.hypot(motion.forward_m, motion.left_m))
                if length_m > self._most_travel_m:
                    return None, self._too_far(length_m)
                return motion, ""
        return None, reason

    def _with_second(self, first: PatchMotion, second: _Past, picture: Image) -> PatchMotion:
        """Return the motion of a pair by two earlier frames, weighted by their variances.

        With one, frames that are compared with the same ones would form chains of their own, whose errors
        show in every pair. Where both differ by more than their deviations the mean is as uncertain as they
        differ (Birge's ratio).
        """
        pose, pose_sd, last_sd = self._next_pose, self._next_sd, self._last.sd
        pitch_rad, is_fixed, ambiguous = self._pitch_rad, self._is_fixed, self._ambiguous
        starts_m = np.array([[first.forward_m, first.left_m]])
        other, _ = self._compare(second, picture, starts_m)
        other_sd, self._next_pose, self._next_sd = self._next_sd, pose, pose_sd
        self._pitch_rad, self._is_fixed, self._ambiguous = pitch_rad, is_fixed, ambiguous
        first_sd = np.hypot(pose_sd, last_sd)
        if other is None:
            return replace(first, forward_sd_m=float(first_sd[0]), left_sd_m=float(first_sd[1]))
        pair_sd = other_sd if second is self._last else np.hypot(other_sd, last_sd)
        both = np.array([[each.forward_m, each.left_m] for each in (first, other)])
        weight = pair_sd**2 / (first_sd**2 + pair_sd**2)
        ratio = np.maximum(1.0, np.abs(both[0] - both[1]) / np.hypot(first_sd, pair_sd))
        forward_m, left_m = weight * both[0] + (1.0 - weight) * both[1]
        sd = ratio * first_sd * pair_sd / np.hypot(first_sd, pair_sd)
        self._next_sd = ratio / np.sqrt(1.0 / pose_sd**2 + 1.0 / (other_sd**2 + second.sd**2))
        self._next_pose[:2] = self._pose[:2] + rotated(np.array([forward_m, left_m]), pose[2])
        return replace(
            first,
            forward_m=float(forward_m),
            left_m=float(left_m),
            forward_sd_m=float(sd[0]),
            left_sd_m=float(sd[1]),
            moved_pixels=float(np.hypot(forward_m, left_m)) / self._ground.pixel_m,
        )

    def _too_far(self, travel_m: float) -> str:
        return (
            f"{travel_m:.2f} m between two frames, at most {self._most_travel_m:.2f} m: take more frames per "
            "second, or drive more slowly"
        )

    def _references(self) -> tuple[list[_Past], _Past]:
        """Return the frames to compare with, in this order, and the one for a second measurement."""
        expected = self._pose[:2] + self._last_m
        numbers = self._parameters.validity

        def newest(pixels: float) -> _Past | None:
            """Return the newest frame from which the ground has moved by this in the picture."""
            apart = (np.hypot(*(expected - past.pose[:2])) / self._ground.pixel_m for past in self._past)
            far = [past for past, each in zip(self._past, apart, strict=True) if each >= pixels]
            return far[-1] if far else None

        first = newest(self._baseline_pixels) or self._past[0]
        second = newest(numbers.second_pixels) or self._last
        return [first] if first is self._last else [first, self._last], second

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

    def _compare(self, past: _Past, picture: Image, starts_m: Floats) -> tuple[PatchMotion | None, str]:
        """Return the motion of the pair, by comparison with an earlier frame."""
        (roll, pitch, yaw), deviations = self._turned
        before = self._pose - past.pose
        angles = (float(before[3] + roll), float(before[4] + pitch), float(before[2] + yaw))
        # Motion between that frame and the one before, in the axes of this one.
        known_m = rotated(before[:2], -(self._pose[2] + yaw))
        wheel_m = self._travel_m
        reach_m = self._most_travel_m if wheel_m is None else float(np.hypot(*wheel_m))
        most_m = float(np.hypot(*known_m)) + self._parameters.flow.overrun * reach_m
        followed = self._flow.follow(
            past.picture,
            picture,
            known_m + starts_m,
            angles,
            tuple(deviations.tolist()),
            most_m,
            self.moving_parts.mask,
        )
        found, reason = self._choose(followed, float(np.hypot(*known_m)) / self._ground.pixel_m)
        if found is None:
            return None, reason
        pose = np.r_[
            past.pose[:2] + rotated(np.array([found.forward_m, found.left_m]), past.pose[2] + found.turn_rad),
            past.pose[2] + found.turn_rad,
            past.pose[3:] + found.tilt_rad,
        ]
        forward_m, left_m = rotated(pose[:2] - self._pose[:2], -pose[2]).tolist()
        turn_rad = float(pose[2] - self._pose[2])
        moved = float(np.hypot(forward_m, left_m)) / self._ground.pixel_m
        self._next_pose, self._next_sd = pose, np.array([found.forward_sd_m, found.left_sd_m])
        self._pitch_rad = found.tilt_rad[1] - angles[1]
        self._is_fixed = found.moved_pixels <= self._parameters.validity.still_pixels
        self._ambiguous = self._flow.ambiguity
        return (
            PatchMotion(
                forward_m=forward_m,
                left_m=left_m,
                turn_rad=turn_rad,
                tilt_rad=found.tilt_rad,
                forward_sd_m=found.forward_sd_m,
                left_sd_m=found.left_sd_m,
                turn_sd_rad=found.turn_sd_rad,
                points=found.points,
                share=found.share,
                moved_pixels=moved,
                moved_sd_pixels=found.moved_sd_pixels,
            ),
            "",
        )

    def _choose(self, followed: Followed, apart_pixels: float) -> tuple[PatchMotion | None, str]:
        """Return the motion that is the ground's, or why none is.

        Args:
            followed: The groups of motions.
            apart_pixels: Known motion between the earlier frame and the one before this.
        """
        numbers = self._parameters.validity
        moving, fixed = followed.moving, followed.fixed
        if moving is not None and moving.moved_pixels > numbers.still_pixels:
            most_sd_pixels = min(
                numbers.least_sd_pixels + numbers.sd_share * moving.moved_pixels, numbers.most_sd_pixels
            )
            if moving.points >= numbers.least_moving and moving.moved_sd_pixels < most_sd_pixels:
                return moving, ""
            reason = "too few points move alike"
        else:
            reason = "too few points follow the ground"
        still = max((m for m in (moving, fixed) if m is not None), key=lambda m: m.points, default=None)
        if still is None or still.moved_pixels > numbers.still_pixels:
            return None, reason
        if apart_pixels > 1.0:
            return None, "what is fixed in the picture hides the ground"
        # One that creeps is neither at rest nor clearly moving: it must be sharp, and of nearly all points.
        creeps = still.moved_pixels > numbers.creeping_pixels
        sharp = still.moved_sd_pixels < numbers.clear_still_sd_pixels
        least_share = numbers.clear_still_share if sharp and not creeps else numbers.least_still_share
        most_sd_pixels = numbers.creeping_sd_pixels if creeps else numbers.most_still_sd_pixels
        if still.share < least_share or still.moved_sd_pixels > most_sd_pixels:
            return None, "ground that stands cannot be distinguished from what is fixed in the picture"
        return still, ""

    def _remember(self, picture: Image) -> None:
        """Keep this frame to compare with, at the pose that was measured last."""
        self._pose = self._next_pose
        self._last = _Past(picture=picture, pose=self._pose, sd=self._next_sd)
        numbers = self._parameters.validity
        pixel_m = self._ground.pixel_m
        stored = self._past[-1]
        moved = float(np.hypot(*(self._pose - stored.pose)[:2])) / pixel_m
        turned = float(self._pose[2] - stored.pose[2]) * self._ground.shape[0]
        if np.hypot(moved, turned) < numbers.stored_pixels:
            return
        self._past.append(self._last)
        # All before the newest one that is far enough will not be compared with again.
        while len(self._past) > 2 and (
            len(self._past) > numbers.most_stored
            or np.hypot(*(self._pose - self._past[1].pose)[:2]) / pixel_m >= self._baseline_pixels
        ):
            del self._past[0]

    def _restart(self, t_ns: int, patch: Image, structure: Patch) -> None:
        """Begin a new chain of poses with this frame."""
        picture = self._structure.picture(self._pattern.without(structure))
        self._pose = np.zeros(5)
        self._last = _Past(picture=picture, pose=self._pose, sd=np.zeros(2))
        self._past = [self._last]
        self._begin(t_ns, patch)

    def _begin(self, t_ns: int, patch: Image) -> None:
        """Begin the next pair."""
        self._left_out = 0
        self._proof.begin_pair()
        self._t_ns, self._grey = t_ns, patch
        self._travel_m, self._turned = np.zeros(2), np.zeros((2, 3))

    def _valid(self, from_ns: int, to_ns: int, motion: PatchMotion) -> GroundMotion:
        rig = self._ground.rig
        cosine, sine = np.cos(rig.steer_rad), np.sin(rig.steer_rad)
        forward_m, left_m = (
            self._factor * rotated(np.array([motion.forward_m, motion.left_m]), rig.steer_rad)
        ).tolist()
        return GroundMotion(
            from_ns=from_ns,
            to_ns=to_ns,
            point_m=rig.point_m,
            forward_m=forward_m,
            left_m=left_m,
            turn_rad=motion.turn_rad,
            forward_sd_m=float(np.hypot(cosine * motion.forward_sd_m, sine * motion.left_sd_m)),
            left_sd_m=float(np.hypot(sine * motion.forward_sd_m, cosine * motion.left_sd_m)),
            turn_sd_rad=motion.turn_sd_rad,
            scale_sd=self._mounting.scale_sd,
        )

    def _invalid(self, from_ns: int, to_ns: int, reason: str) -> GroundMotion:
        return GroundMotion(
            from_ns=from_ns,
            to_ns=to_ns,
            point_m=self._ground.rig.point_m,
            forward_m=0.0,
            left_m=0.0,
            turn_rad=0.0,
            forward_sd_m=0.0,
            left_sd_m=0.0,
            turn_sd_rad=0.0,
            scale_sd=self._mounting.scale_sd,
            rig_fault=self._watch.fault,
            invalid_because=reason,
            is_open=self._t_ns == from_ns,
        )


def rotated(vector: Floats, angle_rad: float) -> Floats:
    """Return a plane vector, turned counter-clockwise."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]])
