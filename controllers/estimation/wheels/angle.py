"""Continuous angle of one wheel: by its position, or by its speed where there is no position."""

import math
from typing import NamedTuple

from controllers.estimation.parameters import ESTIMATION
from drivers.clock import nanoseconds, seconds

TURN_RAD = 2.0 * math.pi
MOST_TURNS = 4
"""Joint angles that a driver or a simulator wraps do so after one to four turns."""
ROUNDING = 1e-3
"""Angles with few digits may exceed the range after which they wrap by this share."""


class Angle(NamedTuple):
    """Angle of a wheel after one more sample.

    Attributes:
        is_new_base: The motion since the angle before is unknown.
        error_rad: Greatest error that this step adds to an integral of speeds; 0 for a position.
    """

    angle_rad: float
    is_new_base: bool = False
    error_rad: float = 0.0


class WheelAngle:
    """Angle of one wheel that neither wraps nor depends on what a message happens to hold.

    Where positions come, they lead. Without one for `silent_s` the speeds are integrated by the trapezoid
    rule. Between two readings the speed may have changed at any moment, so the error of a step is at most
    half the change of the speed times the time. A position that returns leads again: its difference to the
    one before the gap counts where the speeds agree with it, or where it never wraps. Else the drive may have
    wrapped or restarted meanwhile: the motion is that of the speeds, and a new base.

    A position that jumps by one to four turns has wrapped where the wheel then went on by its last step,
    within half of it. Any other jump is left to the odometry. Positions whose range is known come unwrapped
    by their codec; the turns are then counted rightly where the speed limit allows no other number of them.

    Args:
        speed_limit_rad_s: Greatest setpoint.
        silent_s: Readings that are further apart do not show the motion between them.
        wrap_rad: Range of the device's own position; None where it is not known, inf where it never wraps.

    Attributes:
        speed_rad_s: Newest reported speed; None before the first.
    """

    def __init__(self, speed_limit_rad_s: float, silent_s: float, wrap_rad: float | None = None) -> None:
        self._limit_rad_s = speed_limit_rad_s
        self._plausible_rad_s = ESTIMATION.odometry.plausible_speed * speed_limit_rad_s
        self._silent_ns = nanoseconds(silent_s)
        self._wrap_rad = wrap_rad
        self._angle_rad = 0.0
        self._offset_rad = 0.0
        self.speed_rad_s: float | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the readings, as after a break of the link; the device may count from zero."""
        self._position: tuple[int, float] | None = None
        self._is_by_speed = False
        self._by_speed_error_rad = 0.0
        self._rate_rad_s = 0.0
        self._range_rad = (math.inf, -math.inf)
        self._speed_ns: int | None = None
        self._integral_rad = 0.0
        self._error_rad = 0.0
        self._has_gap = False
        self._offset_rad = 0.0

    def take(self, t_ns: int, position_rad: float | None, speed_rad_s: float | None) -> Angle | None:
        """Return the angle at `t_ns`; None where the sample adds nothing to it.

        Args:
            t_ns: Time of the sample.
            position_rad: As reported; None, or not finite, where there is none.
            speed_rad_s: The same.
        """
        if speed_rad_s is not None and abs(speed_rad_s) <= self._plausible_rad_s:
            self._integrate(t_ns, speed_rad_s)
        if position_rad is not None and math.isfinite(position_rad):
            return self._by_position(t_ns, position_rad)
        if self._speed_ns != t_ns or (self._position is not None and t_ns <= self._leads_until_ns):
            return None
        return self._by_speed()

    @property
    def contradicts_rest(self) -> bool:
        """Whether the device reports a speed beside the position; at standstill, one of them is wrong."""
        position, speed_ns = self._position, self._speed_ns
        if self._is_by_speed or self.speed_rad_s is None or position is None or speed_ns is None:
            return False
        if abs(position[0] - speed_ns) > self._silent_ns:  # one of them is no longer reported
            return False
        return abs(self.speed_rad_s) > ESTIMATION.odometry.reported_speed * self._limit_rad_s

    @property
    def _leads_until_ns(self) -> int:
        return -1 if self._position is None else self._position[0] + self._silent_ns

    def _integrate(self, t_ns: int, speed_rad_s: float) -> None:
        before_ns, before_rad_s = self._speed_ns, self.speed_rad_s
        if before_ns is not None and t_ns <= before_ns:
            return
        if before_ns is not None and before_rad_s is not None and t_ns - before_ns <= self._silent_ns:
            elapsed_s = seconds(t_ns - before_ns)
            self._integral_rad += 0.5 * (before_rad_s + speed_rad_s) * elapsed_s
            self._error_rad += 0.5 * abs(speed_rad_s - before_rad_s) * elapsed_s
        else:
            self._has_gap = before_ns is not None
        self._speed_ns, self.speed_rad_s = t_ns, speed_rad_s

    def _by_speed(self) -> Angle:
        self._angle_rad += self._integral_rad
        angle = Angle(self._angle_rad, self._has_gap, self._error_rad)
        self._by_speed_error_rad += self._error_rad
        self._is_by_speed = True
        self._begin_integral()
        return angle

    def _begin_integral(self) -> None:
        self._integral_rad = self._error_rad = 0.0
        self._has_gap = False

    def _by_position(self, t_ns: int, position_rad: float) -> Angle | None:
        before = self._position
        if before is not None and t_ns <= before[0]:
            return None
        is_new_base, error_rad = False, 0.0
        if self._is_by_speed:
            # The wheel went on since its last speed.
            self._angle_rad += self._integral_rad
            self._by_speed_error_rad += self._error_rad
            is_new_base, error_rad = self._return_to(t_ns, position_rad)
            self._rate_rad_s = self._by_speed_error_rad = 0.0
        elif before is not None:
            is_new_base = self._continue(seconds(t_ns - before[0]), position_rad - before[1])
        self._range_rad = _extended(self._range_rad, position_rad)
        self._position, self._is_by_speed = (t_ns, position_rad), False
        self._angle_rad = position_rad + self._offset_rad
        self._begin_integral()
        return Angle(self._angle_rad, is_new_base, error_rad)

    def _return_to(self, t_ns: int, position_rad: float) -> tuple[bool, float]:
        """Let the position lead again; return whether the motion is unknown, and its greatest error."""
        before = self._position
        if before is None:
            self._begin_at(position_rad)
            return self._has_gap, self._error_rad
        step_rad, by_speed_rad = position_rad - before[1], self._angle_rad - before[1] - self._offset_rad
        never_wraps = self._wrap_rad == math.inf
        turns = self._turns_of_wrap(step_rad, by_speed_rad) if self._wrap_rad is None else 0
        apart_rad = abs(step_rad + turns * TURN_RAD - by_speed_rad)
        late_rad = abs(self.speed_rad_s or 0.0) * ESTIMATION.odometry.arrival_jitter_s
        agrees = apart_rad <= self._by_speed_error_rad + late_rad + ESTIMATION.odometry.still_rad
        if agrees or never_wraps:
            self._offset_rad += turns * TURN_RAD
            return False, 0.0 if agrees else apart_rad
        self._begin_at(position_rad)
        # No wheel is further from its speeds than the way at the limit against them.
        most_rad = abs(by_speed_rad) + self._plausible_rad_s * seconds(t_ns - before[0])
        return True, min(apart_rad, most_rad)

    def _begin_at(self, position_rad: float) -> None:
        self._offset_rad = self._angle_rad - position_rad
        self._range_rad = (position_rad, position_rad)

    def _continue(self, elapsed_s: float, step_rad: float) -> bool:
        """Add the turns that a wrap took off; return whether it is unknown how many these are."""
        expected_rad = self._rate_rad_s * elapsed_s
        reach_rad = self._plausible_rad_s * (elapsed_s + ESTIMATION.odometry.arrival_jitter_s)
        if self._wrap_rad is not None:
            self._rate_rad_s = step_rad / elapsed_s
            return self._limit_rad_s * elapsed_s >= self._wrap_rad - abs(step_rad)
        turns = self._turns_of_wrap(step_rad, expected_rad) if abs(step_rad) > 0.5 * TURN_RAD else 0
        going_on_rad = step_rad + turns * TURN_RAD
        is_like_before = (
            abs(going_on_rad - expected_rad) <= 0.5 * abs(expected_rad) + ESTIMATION.odometry.still_rad
        )
        is_jump = abs(step_rad) > reach_rad
        if turns and is_jump and is_like_before:
            self._offset_rad += turns * TURN_RAD
            step_rad = going_on_rad
        self._rate_rad_s = step_rad / elapsed_s
        return bool(turns) and not is_jump and is_like_before

    def _turns_of_wrap(self, step_rad: float, expected_rad: float) -> int:
        """Return after how many turns the position may just have wrapped, signed; 0 for none."""
        missing_rad = expected_rad - step_rad
        if not math.isfinite(missing_rad):  # positions that no wheel has
            return 0
        turns = round(missing_rad / TURN_RAD)
        before = self._position
        if before is None or not 0 < abs(turns) <= MOST_TURNS:
            return 0
        low_rad, high_rad = _extended(self._range_rad, before[1] + step_rad)
        return turns if high_rad - low_rad <= abs(turns) * TURN_RAD * (1.0 + ROUNDING) else 0


def _extended(range_rad: tuple[float, float], value_rad: float) -> tuple[float, float]:
    return min(range_rad[0], value_rad), max(range_rad[1], value_rad)
