"""The same turn of the rover by gyro and by wheels, side by side."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from controllers.motion.body_motion import BodyMotion


class WheelTurn(NamedTuple):
    """Turn of the rover by its wheels, as if they rolled, in rad over `duration_s`.

    Attributes:
        left_rad: What the wheels add that turn the rover to the left.
        right_rad: What the wheels take off that turn it to the right, not negative.
    """

    duration_s: float = 0.0
    left_rad: float = 0.0
    right_rad: float = 0.0

    @property
    def turn_rad(self) -> float:
        """The turn, positive to the left."""
        return self.left_rad - self.right_rad

    @property
    def both_ways_rad(self) -> float:
        """Root of the sum of squares of both parts: the scale of what uneven slip does to the turn.

        A rover that drives straight ahead does not turn, but the wheels of its sides may slip differently.
        """
        return math.hypot(self.left_rad, self.right_rad)

    def with_increment(
        self, effects: Sequence[BodyMotion], turned_rad: Sequence[float], duration_s: float
    ) -> "WheelTurn":
        """Return this turn with one more increment.

        Args:
            effects: Motion of the body per radian of each wheel.
            turned_rad: Angle of each wheel.
            duration_s: Of the increment.
        """
        left_rad = right_rad = 0.0
        for effect, angle_rad in zip(effects, turned_rad, strict=True):
            part_rad = effect[2] * angle_rad
            if part_rad > 0.0:
                left_rad += part_rad
            elif part_rad < 0.0:
                right_rad -= part_rad
        return WheelTurn(
            duration_s=self.duration_s + duration_s,
            left_rad=self.left_rad + left_rad,
            right_rad=self.right_rad + right_rad,
        )


class TurnEvidence(NamedTuple):
    """One interval that both gyro and wheels have measured.

    Attributes:
        gyro_rad: Turn by the gyro, free of its bias.
        wheels: Turn by the wheels.
        by_wheel_rad: What each wheel adds to it, positive to the left; empty where it is not known.
    """

    gyro_rad: float
    wheels: WheelTurn
    by_wheel_rad: tuple[float, ...] = ()
