"""Scale of the gyro, by the two readings of one response.

Where traction neither falls nor stiffens with slip, the bound by lag and force is not below the secant
reading. A gyro that measures too little raises the secant reading and leaves the lag as it is. In place this
cannot be seen: wheels that swing by less than their contact springs back hardly move the body.
"""

from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.slip_bracket import SlipReading

TOO_SMALL = (
    "gyro measures less than the wheels turn, without the lag of slipping wheels: wrong scale: run "
    "`rover-hil calibrate imu`"
)


class GyroScaleWatch:
    """Averages the secant reading beyond the bound.

    Attributes:
        reason: Why slip cannot be read from the gyro; empty where it can.
    """

    def __init__(self) -> None:
        self._windows = 0
        self._excess = 0.0
        self.reason = ""

    def take(self, reading: SlipReading) -> None:
        """Take the reading of one window whose drive force was measured."""
        numbers = EFFORT.watch
        excess = reading.secant - numbers.bound_factor * reading.bound
        self._windows += 1
        self._excess += max(numbers.weight, 1.0 / self._windows) * (excess - self._excess)
        is_small = self._windows >= numbers.least_windows and self._excess > numbers.greatest_excess
        self.reason = TOO_SMALL if is_small else ""
