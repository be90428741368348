"""Present steering angles of the wheels, measured or assumed."""

import math
from collections.abc import Sequence

from drivers.clock import seconds


class SteeringAngles:
    """Knows the steering angle of each wheel.

    An angle that the device reports is used as it is. Without a report the wheel is assumed to move from 0 to
    its setpoints at its greatest rate. A wheel whose reports have ended stays at the last one; the rover
    must stop then.

    Args:
        rates_rad_s: Greatest steering speed of each wheel; empty for a rover that does not steer.

    Attributes:
        angles_rad: Present angles, one per wheel; empty for a rover that does not steer.
        reported_ns: Time of the newest report of each wheel that has reported.
    """

    def __init__(self, rates_rad_s: Sequence[float]) -> None:
        self._rates_rad_s = tuple(rates_rad_s)
        self._moved_ns: int | None = None
        self._held_rad: tuple[float, ...] | None = None
        self.reported_ns: dict[int, int] = {}
        self.angles_rad = (0.0,) * len(self._rates_rad_s)

    def measure(self, wheel: int, t_ns: int, angle_rad: float) -> None:
        """Take the reported angle of a wheel.

        It has no effect if it is not finite or older than the newest, or if the wheel does not steer.
        """
        if not math.isfinite(angle_rad) or t_ns < self.reported_ns.get(wheel, t_ns):
            return
        if 0 <= wheel < len(self._rates_rad_s) and self._rates_rad_s[wheel] > 0.0:
            if wheel not in self.reported_ns:
                self._held_rad = None  # what was held was assumed
            self.reported_ns[wheel] = t_ns
            self.angles_rad = (*self.angles_rad[:wheel], angle_rad, *self.angles_rad[wheel + 1 :])

    def follow(self, now_ns: int, set_rad: Sequence[float]) -> None:
        """Move the wheels without a report towards their setpoints of the last cycle; empty for none."""
        elapsed_s = 0.0 if self._moved_ns is None else seconds(max(0, now_ns - self._moved_ns))
        self._moved_ns = now_ns
        if not set_rad:
            return
        self.angles_rad = tuple(
            angle
            if wheel in self.reported_ns
            else angle + min(max(target - angle, -rate * elapsed_s), rate * elapsed_s)
            for wheel, (angle, target, rate) in enumerate(
                zip(self.angles_rad, set_rad, self._rates_rad_s, strict=True)
            )
        )

    def hold(self) -> tuple[float, ...]:
        """Return the angles at which the wheels stay while the rover does not drive.

        They are those of the first call after `release`: angles that are measured anew in every cycle would
        creep where the drive does not reach its setpoint exactly.
        """
        if self._held_rad is None:
            self._held_rad = self.angles_rad
        return self._held_rad

    def release(self) -> None:
        """End the hold."""
        self._held_rad = None


def mean_steering_rad(steering_rad: Sequence[float]) -> float:
    """Return the direction in which steered wheels roll, forwards or backwards; 0 where none steers.

    It is that of the centre while they turn the rover, too: their angles differ from it to both sides.
    """
    if not steering_rad:
        return 0.0
    return sum(math.remainder(angle, math.pi) for angle in steering_rad) / len(steering_rad)
