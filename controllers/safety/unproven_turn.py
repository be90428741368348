"""Turn on which the gyro has not been seen to measure anything."""

import math

from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.turn_evidence import WheelTurn


class UnprovenTurn:
    """Turn of the wheels since the gyro was last seen to follow them, by any of the rules that share this.

    A gyro that does not follow now may have lost its signal at any time since. On all of this turn the yaw
    is only as certain as the wheels.
    """

    def __init__(self) -> None:
        self._rad = 0.0

    def add(self, wheels: WheelTurn) -> None:
        """Add a turn of the wheels."""
        self._rad += wheels.both_ways_rad

    def prove(self) -> None:
        """Forget the turn: the gyro follows."""
        self._rad = 0.0

    def error_rad(self, missed_rad: float) -> float:
        """Return the greatest error of the yaw, 0 to pi.

        Args:
            missed_rad: Turn by the wheels that the gyro has not measured, not negative.
        """
        return min(math.pi, missed_rad + ESTIMATION.pose.gap_turn_error * self._rad)
