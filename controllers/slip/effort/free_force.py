"""Whether the drive force is far from that of free driving, or none: the rover may not get on."""

import math

from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.slip.effort.parameters import EFFORT


class FreeForce:
    """Compares the drive force with that of the travel before.

    Wheels in the air bear hardly any force; those that push a wall or dig in bear as much as the ground
    holds. A slope or another ground changes the force, too: it is a suspicion. The rover is assumed to drive
    freely at first: one that is lifted from the start is not noticed, nor one on a ground whose free driving
    takes half of what it holds.

    Args:
        rim_arm_m: Distance of the wheels from the centre of the rover.

    Attributes:
        reason: Why the rover may not get on; empty where the force is that of free driving, or unknown.
        far_m: Travel of the wheels since the begin of the last window with the force of free driving.
    """

    def __init__(self, rim_arm_m: float) -> None:
        self._rim_arm_m = rim_arm_m
        self._windows = 0
        self._free_n = 0.0
        self.reason = ""
        self.far_m = 0.0
        self._begin()

    def _begin(self) -> None:
        self._work_j: float | None = 0.0
        self._distance_m = self._turn_rad = 0.0

    def move(self, increment: BodyIncrement, work_j: float | None) -> None:
        """Take the motion of the wheels and their work in one cycle; None where it is unknown."""
        distance_m = math.hypot(increment.x_m, increment.y_m)
        self._distance_m += distance_m
        self._turn_rad += increment.turn_rad
        self.far_m += distance_m
        self._work_j = None if self._work_j is None or work_j is None else self._work_j + work_j
        if self._distance_m < EFFORT.free.window_m:
            return
        is_straight = abs(self._turn_rad) * self._rim_arm_m <= EFFORT.surface.turning_share * self._distance_m
        if self._work_j is not None and is_straight:
            self._judge(self._work_j / self._distance_m)
        self._begin()

    def _judge(self, force_n: float) -> None:
        numbers = EFFORT.free
        if self._windows >= numbers.windows and self._free_n >= EFFORT.learning.least_force_n:
            share = force_n / self._free_n
            if not numbers.none <= share <= numbers.far:
                self.reason = (
                    f"drive force {force_n:.1f} N by the currents, {self._free_n:.1f} N in the travel before"
                )
                return
        self.reason, self.far_m = "", self._distance_m
        self._windows += 1
        self._free_n += (force_n - self._free_n) / self._windows
