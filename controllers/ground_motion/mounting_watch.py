"""Whether the camera is mounted, and built, as its rig says: pitch, focal length, yaw, mirrored pictures."""

import math
from dataclasses import dataclass

from controllers.ground_motion.heading_drifts import HeadingDrifts
from controllers.ground_motion.parameters import MountingParameters
from controllers.ground_motion.slope import Slope, SlopeWithBias


@dataclass(frozen=True, slots=True, kw_only=True)
class MountingEffects:
    """What errors of a rig do to the motion of near and far ground.

    Ground that moves ahead then looks like a change of pitch.

    Attributes:
        pitch_per_rad: Change of pitch per metre, per rad of wrong pitch.
        pitch_per_focal: The same, per share of wrong focal length.
        pitch_per_bend: The same of ground that curves, per change of pitch that a gyro measures.
        tolerance: Standard deviation of it, by the tolerance of the rig.
    """

    pitch_per_rad: float
    pitch_per_focal: float
    pitch_per_bend: float
    tolerance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MountedMotion:
    """Motion of a pair as the watch takes it.

    Attributes:
        duration_s: From frame to frame.
        forward_m: Of the measured point, as the pictures show it; by the wheels, where it hardly moves along.
        drift_m: Of the point below the camera, as the pictures show it, ahead, and to the left beyond that of
            rolling wheels as imaginary part; None where the wheels do not roll ahead.
        turn_rad: By the gyro.
        seen_turn_rad: By the pictures.
        seen_turn_sd_rad: Standard deviation of it.
        pitch_rad: Change of pitch that the pictures show and the gyro does not.
        gyro_pitch_rad: That by the gyro.
    """

    duration_s: float
    forward_m: float
    drift_m: complex | None
    turn_rad: float
    seen_turn_rad: float
    seen_turn_sd_rad: float
    pitch_rad: float
    gyro_pitch_rad: float


class MountingWatch:
    """Sums up the motion of valid pairs while the rover drives.

    Older pairs fade, but not rotations on the spot.

    Pitch and focal length cannot be distinguished by it, and the height not at all.

    In a rotation on the spot the gyro measures how far the point below the camera moves: that is the only
    check of the height, and of the scale of the travel. Until then the travel may be wrong by a tenth. Wheels
    that skid in rotations do not show about which point the rover rotates: a camera that is turned, or higher
    than its rig says, looks like a rover that rotates about another point.

    Args:
        effects: Of errors of this rig.
        scale_sd: Standard deviation of the travel's factor, if the rig is as stated.
        parameters: Tuned numbers.
        is_calibrated: Whether a drive has shown the scale already.
        rotates_about_origin: Whether the rover's origin is in its place in rotations on the spot.
        yaw_sd_deg: Standard deviation of the camera's yaw.

    Attributes:
        text: What contradicts the rig; "" for nothing.
    """

    def __init__(
        self,
        effects: MountingEffects,
        scale_sd: float,
        parameters: MountingParameters,
        *,
        is_calibrated: bool,
        rotates_about_origin: bool,
        yaw_sd_deg: float,
    ) -> None:
        self._effects, self._scale_sd, self._numbers = effects, scale_sd, parameters
        self._is_confirmed, self._rotates_about_origin = is_calibrated, rotates_about_origin
        self._swing, self._aside, self._spun_rad = Slope(), Slope(), 0.0
        self._pitch, self._bend = (SlopeWithBias(parameters.gyro_bias_rad_s) for _ in range(2))
        self._turn = Slope()
        self._drifts = HeadingDrifts(yaw_sd_deg, parameters)
        self._seen_rad2 = 0.0
        self.text = ""

    @property
    def scale_sd(self) -> float:
        """Standard deviation of the travel's factor; as large as a rotation has shown it to be wrong."""
        if not self._is_confirmed:
            return max(self._scale_sd, self._numbers.unconfirmed_scale_sd)
        return max(self._scale_sd, abs(self._swing.slope - 1.0) if self._has_rotated else 0.0)

    @property
    def unconfirmed(self) -> str:
        """What the drive has not confirmed, and how it does; "" for nothing."""
        if self._is_confirmed:
            return ""
        if not self._rotates_about_origin:
            return "scale not confirmed: rotations do not show it, run `rover-hil calibrate scale`"
        if not self._has_rotated:
            return f"scale not confirmed: rotate by {self._numbers.confirming_deg:.0f} deg on the spot"
        if not self._rotated():
            beyond = f"rotations show errors beyond {100.0 * self._scale_limit:.0f} % only"
            return f"scale not confirmed: {beyond}, run `rover-hil calibrate scale`"
        return f"scale not confirmed: {self._spun}"

    @property
    def direction_sd_rad(self) -> float:
        """Standard deviation of the direction of the travel."""
        return self._drifts.sd_rad

    def rotate(self, turn_rad: float) -> None:
        """Take a rotation by the gyro, whether or not its pair is valid."""
        self._drifts.rotate(turn_rad)

    def spin(self, turn_rad: float, swing_m: complex, moved_m: complex) -> None:
        """Take a pair of a rotation on the spot.

        Args:
            turn_rad: By the gyro.
            swing_m: Motion of the point below the camera by it, forward and left.
            moved_m: Its motion as the pictures show it.
        """
        if not self._rotates_about_origin:
            return
        self._spun_rad += abs(turn_rad)
        along_m = moved_m * swing_m.conjugate() / abs(swing_m)
        self._swing.add(abs(swing_m), along_m.real)
        self._aside.add(abs(swing_m), along_m.imag)
        if self._has_rotated and self._scale_limit < self._numbers.unconfirmed_scale_sd:
            self._is_confirmed |= not self._rotated()

    def update(self, motion: MountedMotion) -> None:
        """Take a pair."""
        kept = math.exp(-abs(motion.forward_m) / self._numbers.memory_m)
        for slope in (self._pitch, self._bend, self._turn):
            slope.fade(kept)
        self._seen_rad2 *= kept
        self._pitch.add_over(motion.forward_m, motion.duration_s, motion.pitch_rad)
        self._bend.add_over(motion.forward_m, motion.duration_s, motion.gyro_pitch_rad)
        if motion.drift_m is not None:
            self._drifts.add(motion.drift_m)
        self.compare_turn(motion.turn_rad, motion.seen_turn_rad, motion.seen_turn_sd_rad)

    def compare_turn(self, turn_rad: float, seen_turn_rad: float, seen_turn_sd_rad: float) -> None:
        """Take a rotation by the gyro, and by the pictures with its standard deviation."""
        self._turn.add(turn_rad, seen_turn_rad)
        self._seen_rad2 += (turn_rad * seen_turn_sd_rad) ** 2
        self.text = self._mirrored() or self._near_and_far() or self._drifts.text or self._rotated()

    def _mirrored(self) -> str:
        numbers = self._numbers
        if self._turn.length < math.radians(numbers.least_turn_deg):
            return ""
        if self._turn.slope > -numbers.deviations * math.sqrt(self._seen_rad2) / self._turn.xx:
            return ""
        return "pictures rotate against the gyro: check that they are not mirrored, and the sign of the gyro"

    def _near_and_far(self) -> str:
        numbers, effects = self._numbers, self._effects
        if self._pitch.length < numbers.least_reversed_m:
            return ""
        (slope, sd), (bend, bend_sd) = self._pitch.fitted, self._bend.fitted
        # Ground that curves is not in the plane of the wheels.
        slope -= effects.pitch_per_bend * bend
        by_bend = effects.pitch_per_bend * bend_sd
        limit = numbers.deviations * math.hypot(sd, effects.tolerance, by_bend)
        if abs(slope) - limit > numbers.reversed_rad * abs(effects.pitch_per_rad):
            return "near and far ground move against each other: check that the camera is not upside down"
        if self._pitch.length < numbers.least_travel_m or abs(slope) <= limit:
            return ""
        causes = []
        if abs(effects.pitch_per_rad) > self._numbers.least_effect:
            wrong_deg = math.degrees(slope / effects.pitch_per_rad)
            causes.append(f"the pitch of the camera (about {wrong_deg:+.1f} deg wrong)")
        if abs(effects.pitch_per_focal) > self._numbers.least_effect:
            causes.append(f"its focal length (about {100.0 * slope / effects.pitch_per_focal:+.0f} %)")
        if not causes:
            return ""
        return f"near and far ground move differently: check {' or '.join(causes)}"

    @property
    def _spun(self) -> str:
        return (
            f"in rotations on the spot the ground moves {self._swing.slope:.2f} times as far as the gyro "
            "measures"
        )

    @property
    def _has_rotated(self) -> bool:
        return math.degrees(self._spun_rad) >= self._numbers.confirming_deg

    def _rotated(self) -> str:
        """Return what a rotation on the spot shows to be wrong: the direction, else the scale."""
        if not self._has_rotated:
            return ""
        return self._turned_aside() or self._scale()

    @property
    def _centre_sd(self) -> float:
        """Standard deviation of the place about which the rover rotates, over the arm of the camera."""
        return self._numbers.centre_sd_m * self._spun_rad / self._swing.length

    def _turned_aside(self) -> str:
        """Return that the ground moves aside of the swing: the centre of the rotation is off by as much."""
        aside_rad = math.atan2(self._aside.slope, self._swing.slope)
        limit_rad = self._numbers.aside_deviations * math.hypot(self._aside.sd, self._centre_sd)
        if abs(aside_rad) <= max(limit_rad, math.radians(self._numbers.least_yaw_deg)):
            return ""
        return (
            f"in rotations on the spot the ground moves {math.degrees(aside_rad):+.1f} deg aside: check the "
            "yaw of the camera's mounting, t_vehicle_camera of the rig, and where the rover rotates about"
        )

    @property
    def _scale_limit(self) -> float:
        """Error of the scale from which on rotations on the spot show it."""
        numbers = self._numbers
        # The rover rotates about a point that is off along the arm as far as it is across, which shows.
        by_centre = math.hypot(abs(self._aside.slope) + self._aside.sd, self._centre_sd)
        # Pictures that rotate as the gyro says show its scale.
        by_gyro, turn_sd = numbers.gyro_scale_sd, self._turn.sd
        if turn_sd < by_gyro:
            by_gyro = abs(self._turn.slope - 1.0) + turn_sd
        return numbers.scale_deviations * math.hypot(self._scale_sd, self._swing.sd, by_gyro, by_centre)

    def _scale(self) -> str:
        if abs(self._swing.slope - 1.0) <= self._scale_limit:
            return ""
        return f"{self._spun}: check height and focal length of the camera, and t_vehicle_camera of the rig"
