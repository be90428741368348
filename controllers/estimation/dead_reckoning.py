"""The pose by dead reckoning: motion of the estimate without its corrections, so that it never jumps."""

import math

from controllers.estimation.filter.motion_history import Step
from controllers.motion.planar import Pose, move, wrap_angle
from drivers.record import record


@record(frozen=True, slots=True, kw_only=True)
class DeadReckoned:
    """Pose from the start on, and its covariance: upper triangle over (x, y, yaw) by rows."""

    x_m: float
    y_m: float
    yaw_rad: float
    covariance: tuple[float, float, float, float, float, float]


class DeadReckoning:
    """Adds up the steps of the estimate.

    The variances are upper bounds. The noise of the steps adds up as variances. What is correlated adds up as
    standard deviations: the slip that remains (a share of the travel), the bias of the gyro (over time), and
    the drift of the position by a wrong yaw.

    Attributes:
        pose: The pose.
    """

    def __init__(self) -> None:
        self.pose = Pose()
        self._position_m2 = self._yaw_rad2 = 0.0
        self._slip_m = self._bias_rad = self._aside_m = 0.0

    def add(self, step: Step, gyro_bias_sd_rad_s: float) -> None:
        """Add a step of the estimate."""
        self._position_m2 += step.position_m2
        self._yaw_rad2 += step.yaw_rad2
        self._slip_m += step.slip_sd * abs(step.rolled_m)
        self._bias_rad += gyro_bias_sd_rad_s * step.duration_s
        self._aside_m += min(math.pi, math.sqrt(self._yaw_variance_rad2)) * math.hypot(step.x_m, step.y_m)
        self.pose = move(self.pose, step.x_m, step.y_m, step.turn_rad)

    def add_slip(self, slip_m: float) -> None:
        """Add a standard deviation of the position by slip."""
        self._slip_m += slip_m

    @property
    def _yaw_variance_rad2(self) -> float:
        return self._yaw_rad2 + self._bias_rad**2

    def report(self, waiting_rad: float, waiting_rad2: float) -> DeadReckoned:
        """Return the present pose.

        Args:
            waiting_rad: Turn that waits for motion of the wheels.
            waiting_rad2: Its variance.
        """
        position_m2 = self._position_m2 + self._slip_m**2 + self._aside_m**2
        yaw_rad2 = self._yaw_variance_rad2 + waiting_rad2
        return DeadReckoned(
            x_m=self.pose.x_m,
            y_m=self.pose.y_m,
            yaw_rad=wrap_angle(self.pose.yaw_rad + waiting_rad),
            covariance=(position_m2, 0.0, 0.0, position_m2, 0.0, yaw_rad2),
        )
