"""Present steering angles of the wheels, measured or assumed."""

from collections.abc import Sequence

from drivers.clock import seconds


class SteeringAngles:
    """Knows the steering angle of each wheel.

    An angle that the device reports is used as it is. Without a report the wheel is assumed to move from 0 to
    its set-points at its greatest rate.

    Args:
        rates_rad_s: Greatest steering speed of each wheel; empty for a rover that does not steer.

    Attributes:
        angles_rad: Present angles, one per wheel; empty for a rover that does not steer.
    """

    def __init__(self, rates_rad_s: Sequence[float]) -> None:
        self._rates_rad_s = tuple(rates_rad_s)
        self._measured: set[int] = set()
        self._moved_ns: int | None = None
        self.angles_rad = (0.0,) * len(self._rates_rad_s)

    def measure(self, wheel: int, angle_rad: float) -> None:
        """Take the reported angle of a wheel; of a wheel that does not steer it has no effect."""
        if 0 <= wheel < len(self._rates_rad_s) and self._rates_rad_s[wheel] > 0.0:
            self._measured.add(wheel)
            self.angles_rad = (*self.angles_rad[:wheel], angle_rad, *self.angles_rad[wheel + 1 :])

    def follow(self, now_ns: int, set_rad: Sequence[float]) -> None:
        """Move the wheels without a report towards their set-points of the last cycle; empty for none."""
        elapsed_s = 0.0 if self._moved_ns is None else seconds(max(0, now_ns - self._moved_ns))
        self._moved_ns = now_ns
        if not set_rad:
            return
        self.angles_rad = tuple(
            angle
            if wheel in self._measured
            else angle + min(max(target - angle, -rate * elapsed_s), rate * elapsed_s)
            for wheel, (angle, target, rate) in enumerate(
                zip(self.angles_rad, set_rad, self._rates_rad_s, strict=True)
            )
        )
