"""How far the body can have moved by angles of its wheels."""

from collections.abc import Sequence

from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import Kinematics, greatest_motion


class WheelBounds:
    """The effects of the wheels on the body, as they are steered now.

    Args:
        kinematics: Geometry of the wheels.
        steering_rad: Steering angles at the start; empty without steering.
        speed_limit_rad_s: Greatest setpoint of a wheel.
        has_gyro: Whether a gyro measures the turn of the body.

    Attributes:
        effects: Motion of the body per radian of each wheel.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        steering_rad: Sequence[float],
        speed_limit_rad_s: float,
        *,
        has_gyro: bool,
    ) -> None:
        self._kinematics, self._has_gyro = kinematics, has_gyro
        self._speed_limit_rad_s = speed_limit_rad_s
        self._steering_rad = steering_rad
        # The start: the wheels have their middle angles until the first report.
        self.effects = kinematics.wheel_effects()

    @property
    def fastest_turn_rad_s(self) -> float:
        """Turn rate of the body at the greatest setpoints; straight wheels that steer do not turn it."""
        if self._kinematics.steering_rates_rad_s:
            return self._speed_limit_rad_s / max(map(abs, self._kinematics.wheel_speeds(0.0, 0.0, 1.0)))
        return self._speed_limit_rad_s * sum(abs(effect[2]) for effect in self.effects)

    def steer(self, steering_rad: Sequence[float]) -> bool:
        """Take the steering angles; return whether they have changed."""
        if steering_rad == self._steering_rad:
            return False
        self._steering_rad = steering_rad
        self.effects = self._kinematics.wheel_effects(steering_rad)
        return True

    def greatest(self, wheel_rad: Sequence[float]) -> BodyMotion:
        """Return how far the body moves at most along each axis when each wheel turns by 0 to `wheel_rad`."""
        return greatest_motion(self.effects, wheel_rad)

    def beside_gyro(self, wheel_rad: Sequence[float]) -> BodyMotion:
        """Return the same without the turn where the gyro measures it."""
        x_m, y_m, yaw_rad = greatest_motion(self.effects, wheel_rad)
        return x_m, y_m, 0.0 if self._has_gyro else yaw_rad

    def at_limit_rad(self, duration_s: float) -> list[float]:
        """Return the angle of each wheel after driving at its greatest setpoint."""
        return [self._speed_limit_rad_s * duration_s] * len(self.effects)
