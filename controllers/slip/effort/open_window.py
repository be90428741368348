"""What the wheels have done since the slip was last evaluated."""

import math
import operator
from collections.abc import Sequence

from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import Kinematics
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.surface_map import Travel


class OpenWindow:
    """Adds up the increments of a window, until its slip is found.

    Args:
        kinematics: Of the wheels.

    Attributes:
        turned_rad: Angle that each wheel turned.
        duration_s: Time of it.
        reported_m: Travel of the body that was reported with the slip before, x + i y.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        self._kinematics = kinematics
        self.begin()

    def begin(self) -> None:
        """Begin a window."""
        self.turned_rad: Sequence[float] = [0.0] * self._kinematics.wheel_count
        self.duration_s = 0.0
        self.reported_m = 0j
        self._work_j: float | None = 0.0

    def add(self, increment: BodyIncrement, work_j: float | None, reported_m: complex) -> None:
        """Take an increment of the wheels, their work, None where it is unknown, and what was reported."""
        self.turned_rad = list(map(operator.add, self.turned_rad, increment.turned_rad))
        self.duration_s += increment.duration_s
        self._work_j = None if self._work_j is None or work_j is None else self._work_j + work_j
        self.reported_m += reported_m

    def rolled(self) -> BodyMotion:
        """Return the motion of the body if the wheels rolled."""
        return self._kinematics.body_motion(self.turned_rad)

    def travel(self) -> Travel | None:
        """Return the motion of rolling wheels with their work; None where the work is unknown.

        With the excitation each setpoint falls below the speed four times in a second. Where the sign of a
        current is then unknown, it is taken to drive the wheel: on average the motors hardly brake.
        """
        return None if self._work_j is None else Travel(self.duration_s, *self.rolled(), self._work_j)

    def force_n(self) -> float | None:
        """Return the mean drive force; None where currents or travel do not give it."""
        x_m, y_m, _ = self.rolled()
        distance_m = math.hypot(x_m, y_m)
        if self._work_j is None or distance_m < EFFORT.excitation.least_distance_m:
            return None
        return self._work_j / distance_m
