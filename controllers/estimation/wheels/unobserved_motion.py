"""Motion that no device measured: how far the rover can have moved."""

from collections.abc import Sequence

from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import greatest_motion


class UnobservedMotion:
    """Bounds of the motion while the wheels were not measured.

    A wheel that is not measured may go on at its last speed or at the last setpoint that it was sent,
    whichever is faster, or stop at once.

    Args:
        effects: Motion of the body per radian of each wheel.
    """

    def __init__(self, effects: Sequence[BodyMotion]) -> None:
        self._effects = effects
        self._speeds_rad_s: tuple[Sequence[float], ...] = ([0.0] * len(effects),)

    def turn_wheels(self, effects: Sequence[BodyMotion]) -> None:
        """Take the effects of wheels that have steered."""
        self._effects = effects

    def note_speeds(self, *speeds_rad_s: Sequence[float], is_measured: bool) -> None:
        """Take measured speeds and setpoints; while the wheels are not measured the fastest ones hold."""
        self._speeds_rad_s = speeds_rad_s if is_measured else (self._fastest_rad_s(), *speeds_rad_s)

    def greatest_motion(
        self, duration_s: float, turn_unknown_s: float, turned_rad: float = 0.0
    ) -> BodyMotion:
        """Return how far the rover can have moved.

        Args:
            duration_s: Time without a measurement of the wheels.
            turn_unknown_s: Part of it without one of the gyro.
            turned_rad: Turn by the gyro in the other part.
        """
        x_m, y_m, _ = self._reach(duration_s)
        yaw_rad = self._reach(turn_unknown_s)[2]
        return x_m, y_m + 0.5 * x_m * min(yaw_rad + abs(turned_rad), 1.0), yaw_rad

    def _fastest_rad_s(self) -> list[float]:
        return [max(speeds, key=abs) for speeds in zip(*self._speeds_rad_s, strict=True)]

    def _reach(self, duration_s: float) -> BodyMotion:
        return greatest_motion(self._effects, [speed * duration_s for speed in self._fastest_rad_s()])
