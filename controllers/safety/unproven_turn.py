"""Turn on which the gyro has not been seen to measure anything, and whether it is known to be dead."""

import math

from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.wheels.turn_evidence import WheelTurn


class UnprovenTurn:
    """Turn of the wheels since the gyro was last seen to follow them, by any of the rules that share this.

    A gyro that does not follow now may have lost its signal at any time since. On all of this turn the yaw
    is only as certain as the wheels.

    Attributes:
        path_m: Distance driven meanwhile.
        is_dead: Whether the rover was known to turn without a signal of the gyro, which has shown none since.
    """

    def __init__(self) -> None:
        self._rad = self.path_m = 0.0
        self.is_dead = False

    def add(self, wheels: WheelTurn, distance_m: float = 0.0) -> None:
        """Add a turn of the wheels, and the distance that they drove meanwhile."""
        self._rad += wheels.both_ways_rad
        self.path_m += distance_m

    def prove(self) -> None:
        """Forget the turn: the gyro follows."""
        self._rad = self.path_m = 0.0
        self.is_dead = False

    def error_rad(self, missed_rad: float) -> float:
        """Return the greatest error of the yaw, 0 to pi.

        Args:
            missed_rad: Turn by the wheels that the gyro has not measured, not negative.
        """
        return min(math.pi, missed_rad + ESTIMATION.pose.gap_turn_error * self._rad)
