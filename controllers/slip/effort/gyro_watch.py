"""Whether the gyro follows turns as it is assumed to: with what does not go through a slipping contact.

Where the rover turns to and fro in place, its wheels roll over the ground so slowly that the lag of the
contact nearly vanishes: tau_c = I_z v / (L^2 sum C N) is proportional to the speed v of travel. What is
left of the lag between wheels and gyro belongs to the sensors. At speed the lag of the contact adds up,
and is never negative.
"""

from controllers.slip.effort.parameters import EFFORT

NOT_COMPARED = "gyro not yet compared with the wheels in place"
LATER_THAN_FAST = "gyro reads turns later than a fast one, low-pass or delay: run `rover-hil calibrate imu`"
EARLIER_THAN_FAST = "gyro reads turns before the wheels can make them: run `rover-hil calibrate imu`"
LATER_THAN_CALIBRATED = "gyro reads turns later than calibrated: run `rover-hil calibrate imu` again"
EARLIER_THAN_CALIBRATED = "gyro reads turns earlier than calibrated: run `rover-hil calibrate imu` again"


class GyroWatch:
    """Compares the lag of the gyro in place with the one that it is assumed to have.

    Args:
        is_calibrated: Whether the constants of the gyro were identified.
        lag_sd_s: Standard deviation of the assumed lag.
        wheels_may_be_old: Whether the age of the wheels' positions is unknown: the gyro may then be ahead.

    Attributes:
        lag_s: Mean lag in place beyond the assumed one; None before the first comparison.
        reason: Why slip cannot be read from the gyro; empty where it can.
    """

    def __init__(self, *, is_calibrated: bool, lag_sd_s: float, wheels_may_be_old: bool) -> None:
        self._is_calibrated = is_calibrated
        self._latest_s = max(EFFORT.watch.greatest_lag_s, 3.0 * lag_sd_s)
        self._earliest_s = EFFORT.watch.greatest_wheel_age_s if wheels_may_be_old else self._latest_s
        self._windows = 0
        self.lag_s: float | None = None
        self.reason = NOT_COMPARED

    @property
    def is_compared(self) -> bool:
        """Whether enough windows in place were compared for a verdict."""
        return self._windows >= EFFORT.watch.least_windows

    def take(self, speed_m_s: float, lag_s: float, share: float) -> None:
        """Take one window.

        Args:
            speed_m_s: Speed of travel by the wheels.
            lag_s: Of the gyro behind the wheels, beyond the assumed one.
            share: Of the wheels' oscillation that the gyro reads, corrected for the assumed constants.
        """
        if share > EFFORT.watch.greatest_share:
            return  # the contact springs near its resonance, where its lag is of any size
        if speed_m_s <= EFFORT.watch.in_place_m_s:
            self._windows += 1
            before_s = lag_s if self.lag_s is None else self.lag_s
            self.lag_s = before_s + EFFORT.watch.weight * (lag_s - before_s)
        if self.is_compared and self.lag_s is not None:
            self.reason = self._judge(self.lag_s)

    def _judge(self, lag_s: float) -> str:
        if -self._earliest_s <= lag_s <= self._latest_s:
            return ""
        if self._is_calibrated:
            return LATER_THAN_CALIBRATED if lag_s > 0.0 else EARLIER_THAN_CALIBRATED
        return LATER_THAN_FAST if lag_s > 0.0 else EARLIER_THAN_FAST
