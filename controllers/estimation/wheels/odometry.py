"""Motion of the rover by its wheels."""

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass

from controllers.estimation.parameters import ESTIMATION
from controllers.motion.kinematics import Kinematics
from controllers.motion.planar import Pose, move
from drivers.clock import nanoseconds, seconds
from drivers.record import record


@record(frozen=True, slots=True, kw_only=True)
class BodyIncrement:
    """Motion of the wheels since the last increment, in the body frame: m, m, rad, s.

    Attributes:
        turned_rad: Angle of each wheel; of one without an encoder as it rolls in this motion.
        steering_rad: Steering angle of each wheel half-way; empty where none steers.
        is_sure: False where the wheels slip by an unknown amount.
        rolled_m: Motion of rolling wheels, before slip was removed, to the left as imaginary part; None where
            none was.
        slip_sd: Standard deviation of the slip that was removed; None where it is not known.
        is_slip_one_sided: Whether that slip errs to one side, anywhere between none and a limit.
        is_measured: Whether a camera measures the motion over the ground: the slip of the wheels is then a
            state that it corrects.
    """

    x_m: float
    y_m: float
    turn_rad: float
    duration_s: float
    turned_rad: tuple[float, ...] = ()
    is_sure: bool = True
    steering_rad: tuple[float, ...] = ()
    rolled_m: complex | None = None
    slip_sd: float | None = None
    is_slip_one_sided: bool = False
    is_measured: bool = False


@dataclass(slots=True)
class _Track:
    """The last two positions of one wheel; the same one twice after a restart.

    Attributes:
        changed_ns: Since when the position is the newest one.
    """

    before_ns: int
    before_rad: float
    newest_ns: int
    newest_rad: float
    changed_ns: int

    def add(self, t_ns: int, position_rad: float) -> None:
        """Append a newer position."""
        if position_rad != self.newest_rad:
            self.changed_ns = t_ns
        self.before_ns, self.before_rad = self.newest_ns, self.newest_rad
        self.newest_ns, self.newest_rad = t_ns, position_rad

    def position_at(self, t_ns: int) -> float:
        """Return the position at `t_ns`, interpolated, never beyond the two."""
        if t_ns >= self.newest_ns:
            return self.newest_rad
        if t_ns <= self.before_ns:
            return self.before_rad
        share = (t_ns - self.before_ns) / (self.newest_ns - self.before_ns)
        return self.before_rad + share * (self.newest_rad - self.before_rad)


class WheelOdometry:
    """Turns wheel positions into body increments, velocities and the pose of wheel odometry.

    The wheels report one by one. An increment is taken when all have reported, between positions interpolated
    to a common time: positions at different times would appear as a turn.

    Args:
        kinematics: Geometry of the wheels.
        wheel_speed_limit_rad_s: Greatest setpoint. A position that differs from the one before by more than
            1.5 times the angle at that speed in the elapsed time (plus 0.05 s of arrival jitter) is not
            motion: the device has restarted or its counter was reset. The odometry then rebases.

    Attributes:
        t_ns: Time up to which the motion is known; None while there is no base.
        pose: The integral of the increments: wheel odometry alone.
        velocity: Body velocity in m/s, m/s, rad/s, smoothed over 0.05 s; from zero after a rebase.
        wheel_speed_rad_s: Speed of each wheel, smoothed in the same way.
        rebases: Number of times the base was lost, together with the motion in between.
        lost_s: Time between the last base and the newest one where the last increment was lost; else 0.
        frozen_s: Time before, for which a wheel repeated its position until it jumped; else 0.
    """

    def __init__(self, kinematics: Kinematics, wheel_speed_limit_rad_s: float) -> None:
        count = kinematics.wheel_count
        self._kinematics = kinematics
        self._plausible_rad_s = ESTIMATION.odometry.plausible_speed * wheel_speed_limit_rad_s
        self._tracks: list[_Track | None] = [None] * count
        self._all = frozenset(range(count)) - kinematics.unmeasured
        self._missing = set(self._all)
        self._base_rad = [0.0] * count
        self._still_rad = [0.0] * count
        self._moved_ns = 0
        self.t_ns: int | None = None
        self.pose = Pose()
        self.velocity = (0.0, 0.0, 0.0)
        self.wheel_speed_rad_s = (0.0,) * count
        self.rebases = 0
        self.lost_s = 0.0
        self.frozen_s = 0.0
        self._lost_ns: int | None = None
        self._steering_rad: tuple[float, ...] = ()

    def feed(self, wheel: int, t_ns: int, position_rad: float) -> bool:
        """Take the position of a wheel; return False when it is not finite or newer, or the wheel unknown."""
        if wheel not in self._all or not math.isfinite(position_rad):
            return False
        track = self._tracks[wheel]
        if track is not None and t_ns <= track.newest_ns:
            return False
        if track is not None and self._is_current(wheel) and self._is_jump(track, t_ns, position_rad):
            self.rebase()
            self.frozen_s = seconds(track.newest_ns - track.changed_ns)
        if track is not None and self._is_current(wheel):
            track.add(t_ns, position_rad)
        else:
            self._tracks[wheel] = _Track(t_ns, position_rad, t_ns, position_rad, t_ns)
        self._missing.discard(wheel)
        return True

    def take(self, steering_rad: tuple[float, ...] = ()) -> BodyIncrement | None:
        """Return the motion since the last increment; None until all wheels have reported again.

        Args:
            steering_rad: Present steering angle of each wheel; empty where none steers.
        """
        if self.lost_s:
            self.lost_s = self.frozen_s = 0.0
        if self._missing:
            return None
        before_steering_rad = self._steering_rad or steering_rad
        self._steering_rad = steering_rad
        tracks = self._tracks
        before_ns, self.t_ns = self.t_ns, min([track.newest_ns for track in tracks if track is not None])
        before_rad, self._base_rad = (
            self._base_rad,
            [0.0 if track is None else track.position_at(self.t_ns) for track in tracks],
        )
        self._missing.update(self._all)
        self._watch_standstill(is_new_base=before_ns is None)
        if before_ns is None:
            if self._lost_ns is not None:
                self.lost_s = max(0.0, seconds(self.t_ns - self._lost_ns))
            return None
        turned_rad = list(map(operator.sub, self._base_rad, before_rad))
        middle_rad = steering_rad and tuple(
            0.5 * (before + now) for before, now in zip(before_steering_rad, steering_rad, strict=True)
        )
        return self._integrate(turned_rad, seconds(self.t_ns - before_ns), middle_rad)

    def rebase(self) -> None:
        """Forget the base, as after a broken link: the motion in between is unknown."""
        if self.t_ns is not None:
            self.rebases += 1
            self._lost_ns = self.t_ns
        self.t_ns = None
        self._missing.update(self._all)
        self.velocity = (0.0, 0.0, 0.0)
        self.wheel_speed_rad_s = (0.0,) * len(self._tracks)

    @property
    def still_since_ns(self) -> int:
        """Time since which the wheels have not moved."""
        return self._moved_ns

    def is_still(self, now_ns: int, for_s: float) -> bool:
        """Return whether all wheels report and have not moved for `for_s` seconds."""
        if self.t_ns is None:
            return False
        for_ns = nanoseconds(for_s)
        return self.t_ns - self._moved_ns >= for_ns and now_ns - self.t_ns <= for_ns

    def _is_current(self, wheel: int) -> bool:
        """Return whether the wheel has reported since the base was lost."""
        return self.t_ns is not None or wheel not in self._missing

    def _is_jump(self, track: _Track, t_ns: int, position_rad: float) -> bool:
        elapsed_s = seconds(t_ns - track.newest_ns) + ESTIMATION.odometry.arrival_jitter_s
        return abs(position_rad - track.newest_rad) > self._plausible_rad_s * elapsed_s

    def _integrate(
        self, turned_rad: list[float], elapsed_s: float, steering_rad: tuple[float, ...]
    ) -> BodyIncrement:
        x_m, y_m, turn_rad = motion = self._kinematics.body_motion(turned_rad, steering_rad)
        turned_rad = list(self._kinematics.with_unmeasured(turned_rad, motion, steering_rad))
        self.pose = move(self.pose, x_m, y_m, turn_rad)
        velocity_x, velocity_y, yaw_rate = _smoothed(self.velocity, (x_m, y_m, turn_rad), elapsed_s)
        self.velocity = (velocity_x, velocity_y, yaw_rate)
        self.wheel_speed_rad_s = tuple(_smoothed(self.wheel_speed_rad_s, turned_rad, elapsed_s))
        return BodyIncrement(
            x_m=x_m,
            y_m=y_m,
            turn_rad=turn_rad,
            duration_s=elapsed_s,
            turned_rad=tuple(turned_rad),
            steering_rad=steering_rad,
        )

    def _watch_standstill(self, is_new_base: bool) -> None:
        moved_rad = max(map(abs, map(operator.sub, self._base_rad, self._still_rad)))
        if is_new_base or moved_rad > ESTIMATION.odometry.still_rad:
            self._still_rad = self._base_rad
            self._moved_ns = self.t_ns or 0


def _smoothed(rates: Sequence[float], increments: Sequence[float], elapsed_s: float) -> list[float]:
    # Low-pass fed with the increment, not with increment / time: two messages that arrive in one burst
    # would otherwise divide by almost nothing.
    time_s = ESTIMATION.odometry.velocity_time_s
    sum_s = time_s + elapsed_s
    return [(time_s * rate + increment) / sum_s for rate, increment in zip(rates, increments, strict=True)]
