"""The same turn of the rover by gyro and by wheels, side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from controllers.motion.kinematics import BodyMotion


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelTurn:
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

    def add(self, effects: Sequence[BodyMotion], turned_rad: Sequence[float], duration_s: float) -> Self:
        """Return this turn with one more increment.

        Args:
            effects: Motion of the body per radian of each wheel.
            turned_rad: Angle of each wheel.
            duration_s: Of the increment.
        """
        parts = [effect[2] * angle for effect, angle in zip(effects, turned_rad, strict=True)]
        return type(self)(
            duration_s=self.duration_s + duration_s,
            left_rad=self.left_rad + sum(part for part in parts if part > 0.0),
            right_rad=self.right_rad - sum(part for part in parts if part < 0.0),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnEvidence:
    """One interval that both gyro and wheels have measured.

    Attributes:
        gyro_rad: Turn by the gyro, free of its bias.
        wheels: Turn by the wheels.
    """

    gyro_rad: float
    wheels: WheelTurn
