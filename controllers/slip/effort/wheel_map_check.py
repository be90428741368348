"""Whether the map of single wheels agrees with what is known of the ground."""

import operator
from collections.abc import Sequence

from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import Kinematics
from controllers.slip.effort.ground_knowledge import KnownSlip
from controllers.slip.effort.motor_model import WheelEffort
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.slip_map import WheelMap, wheel_slip


def travel_slip(kinematics: Kinematics, turned_rad: Sequence[float], moved: BodyMotion) -> float:
    """Return which share of the travel by the wheels is missing in a motion; 0 without travel."""
    x_m, y_m, _ = kinematics.body_motion(turned_rad)
    square_m2 = x_m**2 + y_m**2
    return 1.0 - (moved[0] * x_m + moved[1] * y_m) / square_m2 if square_m2 > 0.0 else 0.0


class WheelMapCheck:
    """Compares the slip of the rover by a wheel map in half a second with that of the ground.

    Args:
        name: Of the map.
        kinematics: Of the rover.
        problem: Why the map may not hold, before the first comparison.

    Attributes:
        slip: By the map in the last half second.
        problem: Why the map may not hold; empty where it does.
    """

    def __init__(self, name: str, kinematics: Kinematics, problem: str) -> None:
        self._name = name
        self._kinematics = kinematics
        self.slip = 0.0
        self.problem = problem
        self.begin()

    def begin(self) -> None:
        """Begin a half second."""
        self._turned_rad = self._rolled_rad = (0.0,) * self._kinematics.wheel_count

    def add(self, wheel_map: WheelMap, efforts: Sequence[WheelEffort], turned_rad: Sequence[float]) -> None:
        """Add the angles that the wheels turned."""
        slips = [wheel_slip(wheel_map, effort).slip for effort in efforts]
        rolled_rad = [angle * (1.0 - slip) for angle, slip in zip(turned_rad, slips, strict=True)]
        self._turned_rad = tuple(map(operator.add, self._turned_rad, turned_rad))
        self._rolled_rad = tuple(map(operator.add, self._rolled_rad, rolled_rad))

    def compare(self, known: KnownSlip, *, has_map: bool) -> None:
        """Compare with what is known of the ground, and begin the next half second."""
        self.problem = known.reason
        if not has_map:
            return
        turned_rad, rolled_rad = self._turned_rad, self._rolled_rad
        self.begin()
        self.slip = travel_slip(self._kinematics, turned_rad, self._kinematics.body_motion(rolled_rad))
        if not known.reason and abs(self.slip - known.slip) > EFFORT.recognition.contradiction:
            self.problem = f"{self._name} gives a slip of {self.slip:.2f}, the ground has {known.slip:.2f}"
