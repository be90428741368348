"""Scale and sign of the gyro, by a slow turn back and forth in place before the rover travels.

A slow turn passes through the contacts nearly whole: wheels that turn a rover about its own centre bear no
load but its drag. The faster excitation of the travel does not: in place, contacts spring back from it.

The turn assumes that it is driven to its end: where it was interrupted it begins anew. Wheels that hardly
turned prove nothing.
"""

import math

from controllers.slip.effort.parameters import EFFORT

TOO_SMALL = (
    "gyro measures {share:.0%} of the turn of the wheels in place: wrong scale, or wheels without grip: run "
    "`rover-hil calibrate imu`"
)
OPPOSITE = (
    "gyro measures the opposite of the turn of the wheels in place: wrong sign: run `rover-hil calibrate imu`"
)
NOT_TURNED = "gyro not yet compared with the wheels in place"
GREATEST_ANGLE = 0.375 * math.sqrt(3.0)
"""Greatest value of sin(a) (1 - cos(a)) / 2, at a = 120 degrees."""


class GyroInPlace:
    """Turns the rover back and forth for one period, and compares the gyro with the wheels.

    Args:
        rim_arm_m: Distance of the wheels from the centre.

    Attributes:
        reason: Why slip cannot be read from the gyro; empty where it can.
    """

    def __init__(self, rim_arm_m: float) -> None:
        numbers = EFFORT.gyro_in_place
        fastest_rad_s = numbers.greatest_rad * math.tau / numbers.period_s / GREATEST_ANGLE
        self._amplitude_rad_s = min(numbers.rim_m_s / rim_arm_m, fastest_rad_s)
        self._is_over = False
        self._before_s = 0.0
        self._start_s: float | None = None
        self._product = self._wheel_square = self._gyro_square = 0.0
        self.reason = NOT_TURNED

    @property
    def is_turning(self) -> bool:
        """Whether the turn has begun and is not over."""
        return self._start_s is not None and not self._is_over

    def yaw_rate_rad_s(self, now_s: float, follower_rad_s: float) -> float | None:
        """Return the yaw rate to command in place; None once the turn is over.

        The angle, sin(a) (1 - cos(a)) / 2 with a from 0 to 2 pi, begins and ends at rest. Then the path
        follower turns the rover back to its heading.
        """
        if self._is_over:
            return None
        if self._start_s is None or now_s - self._before_s > EFFORT.gyro_in_place.settle_s:
            self._start_s = now_s
            self._product = self._wheel_square = self._gyro_square = 0.0
        self._before_s = now_s
        elapsed_s, period_s = now_s - self._start_s, EFFORT.gyro_in_place.period_s
        if elapsed_s < period_s:
            cosine = math.cos(math.tau * elapsed_s / period_s)
            return 0.5 * self._amplitude_rad_s * (1.0 - cosine) * (1.0 + 2.0 * cosine)
        if elapsed_s < period_s + EFFORT.gyro_in_place.settle_s:
            return follower_rad_s
        self._is_over = True
        self.reason = self._judge()
        return None

    def take(self, duration_s: float, wheel_rate_rad_s: float, gyro_rate_rad_s: float | None) -> None:
        """Take the yaw rates of a cycle, by rolling wheels and by the gyro; None without a fresh one."""
        if not self.is_turning or gyro_rate_rad_s is None:
            return
        self._product += gyro_rate_rad_s * wheel_rate_rad_s * duration_s
        self._wheel_square += wheel_rate_rad_s**2 * duration_s
        self._gyro_square += gyro_rate_rad_s**2 * duration_s

    def _judge(self) -> str:
        least_rad_s = EFFORT.gyro_in_place.least_turn * self._amplitude_rad_s
        if self._wheel_square < least_rad_s**2 * EFFORT.gyro_in_place.period_s:
            return NOT_TURNED
        if self._product < 0.0:
            return OPPOSITE
        # Of the sizes, not of what is in phase: soft contacts lag in slow turns, too.
        share = math.sqrt(self._gyro_square / self._wheel_square)
        return TOO_SMALL.format(share=share) if share < EFFORT.gyro_in_place.least_share else ""
