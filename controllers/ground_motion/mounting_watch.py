"""Whether the camera is mounted, and built, as its rig says: pitch, focal length, yaw, mirrored pictures."""

import math
from dataclasses import dataclass

from controllers.ground_motion.parameters import MountingParameters

CONFIRMS_SD = 2.0
"""A rotation on the spot confirms a scale that is within so many standard deviations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MountingEffects:
    """What errors of a rig do to the motion of near and far ground.

    Ground that moves ahead then looks like a change of pitch.

    Attributes:
        pitch_per_rad: Change of pitch per metre, per rad of wrong pitch.
        pitch_per_focal: The same, per share of wrong focal length.
        tolerance: Standard deviation of it, by the tolerance of the rig.
        travel_per_rad: Share of the travel that is wrong, per rad of wrong pitch.
        travel_per_focal: The same, per share of wrong focal length.
    """

    pitch_per_rad: float
    pitch_per_focal: float
    tolerance: float
    travel_per_rad: float
    travel_per_focal: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MountedMotion:
    """Motion of a pair as the watch takes it.

    Attributes:
        duration_s: From frame to frame.
        forward_m: Of the measured point, as the pictures show it.
        left_m: To its left, less the motion by rolling wheels.
        turn_rad: By the gyro.
        seen_turn_rad: By the pictures.
        seen_turn_sd_rad: Standard deviation of it.
        pitch_rad: Change of pitch that the pictures show and the gyro does not.
    """

    duration_s: float
    forward_m: float
    left_m: float
    turn_rad: float
    seen_turn_rad: float
    seen_turn_sd_rad: float
    pitch_rad: float


class MountingWatch:
    """Sums up the motion of pairs while the rover drives.

    Pitch and focal length cannot be told apart by it, and the height not at all. A rover that drifts on a
    slope looks like a camera that is turned in yaw; so this is reported only where the angle is the same
    before and after a rotation.

    In a rotation on the spot the gyro measures how far the point below the camera moves: that is the only
    check of the height, and of the scale of the travel. Until then the travel may be wrong by a tenth.

    Args:
        effects: Of errors of this rig.
        scale_sd: Standard deviation of the travel's factor, if the rig is as stated.
        is_calibrated: Whether a drive has shown the scale already.
        parameters: Tuned numbers.

    Attributes:
        text: What contradicts the rig; "" for nothing.
        wrong_share: Share of the travel that may be wrong by it.
    """

    def __init__(
        self,
        effects: MountingEffects,
        scale_sd: float,
        parameters: MountingParameters,
        *,
        is_calibrated: bool,
    ) -> None:
        self._effects, self._scale_sd, self._numbers = effects, scale_sd, parameters
        self._is_confirmed = is_calibrated
        self._lever = _Slope()
        self._spun_rad = 0.0
        self._pitch = _Slope()
        self._turn = _Slope()
        self._aside = [_Slope()]
        self._heading_rad = self._from_rad = 0.0
        self._seen_sd_rad2 = self._duration_s = 0.0
        self.text = ""
        self.wrong_share = 0.0

    def rotate(self, turn_rad: float) -> None:
        """Take a rotation by the gyro, whether or not its pair is valid."""
        self._heading_rad += turn_rad

    @property
    def scale_sd(self) -> float:
        """Standard deviation of the travel's factor."""
        unconfirmed_sd = 0.0 if self._is_confirmed else self._numbers.unconfirmed_scale_sd
        return max(self._scale_sd, unconfirmed_sd)

    def spin(self, turn_rad: float, lever_m: complex, moved_m: complex) -> None:
        """Take a valid pair of a rotation on the spot.

        Args:
            turn_rad: By the gyro.
            lever_m: Motion of the measured point by it, forward and left.
            moved_m: Its motion as the pictures show it.
        """
        self._spun_rad += abs(turn_rad)
        self._lever.add(abs(lever_m), (moved_m * lever_m.conjugate()).real / abs(lever_m))
        if math.degrees(self._spun_rad) >= self._numbers.confirming_deg:
            self._is_confirmed |= abs(self._lever.slope - 1.0) <= CONFIRMS_SD * self._scale_sd

    def update(self, motion: MountedMotion) -> None:
        """Take a valid pair."""
        self._duration_s += motion.duration_s
        self._pitch.add(motion.forward_m, motion.pitch_rad)
        self._turn.add(motion.turn_rad, motion.seen_turn_rad)
        self._seen_sd_rad2 += (motion.turn_rad * motion.seen_turn_sd_rad) ** 2
        if abs(self._heading_rad - self._from_rad) > math.radians(self._numbers.rotation_deg):
            self._from_rad = self._heading_rad
            self._aside.append(_Slope())
        self._aside[-1].add(motion.forward_m, motion.left_m)
        self.text = self._mirrored() or self._near_and_far() or self._yaw() or self._scale()

    def _mirrored(self) -> str:
        sum_rad2, numbers = self._turn.xx, self._numbers
        if self._turn.length < math.radians(numbers.least_turn_deg):
            return ""
        if self._turn.slope > -numbers.deviations * math.sqrt(self._seen_sd_rad2) / sum_rad2:
            return ""
        return "pictures rotate against the gyro: check that they are not mirrored, and the sign of the gyro"

    def _scale(self) -> str:
        scale = self._lever.slope
        is_known = math.degrees(self._spun_rad) >= self._numbers.confirming_deg
        if not is_known or abs(scale - 1.0) <= self._numbers.deviations * self._scale_sd:
            return ""
        self.wrong_share = abs(scale - 1.0)
        return (
            f"in rotations on the spot the ground moves {scale:.2f} times as far as the gyro measures: check "
            "height and focal length of the camera, and contact_point or t_vehicle_camera of the rig"
        )

    def _near_and_far(self) -> str:
        if self._pitch.length < self._numbers.least_travel_m:
            return ""
        slope = self._pitch.slope
        by_bias = self._numbers.gyro_bias_rad_s * self._duration_s / self._pitch.length
        limit = self._numbers.deviations * math.hypot(self._pitch.sd, self._effects.tolerance, by_bias)
        if abs(slope) <= limit:
            return ""
        effects = self._effects
        pitch_rad, focal = slope / effects.pitch_per_rad, slope / effects.pitch_per_focal
        self.wrong_share = max(abs(pitch_rad * effects.travel_per_rad), abs(focal * effects.travel_per_focal))
        return (
            f"near and far ground move differently: check the pitch of the camera (about "
            f"{math.degrees(pitch_rad):+.1f} deg wrong) or its focal length (about {100 * focal:+.0f} %)"
        )

    def _yaw(self) -> str:
        numbers = self._numbers
        long = [each for each in self._aside if each.length >= numbers.least_travel_m]
        if len(long) < 2:
            return ""
        first_deg, last_deg = (math.degrees(math.atan(each.slope)) for each in (long[0], long[-1]))
        mean_deg = 0.5 * (first_deg + last_deg)
        is_alike = abs(first_deg - last_deg) < numbers.alike * abs(mean_deg)
        if abs(mean_deg) < numbers.least_yaw_deg or not is_alike:
            return ""
        return (
            f"ground moves {mean_deg:+.1f} deg aside on all headings: check the yaw of the camera's "
            "mounting, and that the pictures are not mirrored"
        )


class _Slope:
    """Least squares of y over x, through zero."""

    def __init__(self) -> None:
        self.xx = self._xy = self._yy = self.length = 0.0
        self._count = 0

    def add(self, x: float, y: float) -> None:
        self.xx, self._xy, self._yy = self.xx + x * x, self._xy + x * y, self._yy + y * y
        self.length += abs(x)
        self._count += 1

    @property
    def slope(self) -> float:
        return self._xy / self.xx if self.xx > 0.0 else 0.0

    @property
    def sd(self) -> float:
        if self._count < 2 or self.xx <= 0.0:
            return math.inf
        residual = max(0.0, self._yy - self._xy * self.slope)
        return math.sqrt(residual / (self._count - 1) / self.xx)
