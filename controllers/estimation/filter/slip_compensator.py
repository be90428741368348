"""What the estimator and the control loop require of a slip compensator."""

from collections.abc import Sequence
from typing import Protocol, TypeVar

from controllers.estimation.filter.slip_states import SlipEstimate, SlipStates
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.body_motion import BodyMotion
from drivers.samples import Sample

ReportT = TypeVar("ReportT", covariant=True)


class SlipCompensator(Protocol[ReportT]):
    """Removes wheel slip from the motion that the wheels report.

    It does so in `compensate`, or by states of its own in the pose filter. With states `compensate` leaves
    the motion as it is; the filter predicts the body's motion from it.
    """

    @property
    def states(self) -> SlipStates | None:
        """The states in the pose filter; None without."""
        ...

    @property
    def unsettled_m(self) -> complex:
        """Standard deviation of the travel that a later increment will correct.

        Along the travel, in the body frame, with the left as imaginary part; 0 where nothing is corrected.
        """
        ...

    def feed(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`; samples that the compensator does not need have no effect."""
        ...

    def compensate(
        self, increment: BodyIncrement, set_speed_rad_s: Sequence[float], gyro_rate_rad_s: float | None
    ) -> BodyIncrement:
        """Return the increment of the body for an increment of rolling wheels.

        Args:
            increment: Motion of the wheels, as if they rolled.
            set_speed_rad_s: Set-points of the wheels in that time.
            gyro_rate_rad_s: Newest yaw rate of the gyro, bias removed; None without a fresh one.
        """
        ...

    def forget_gyro(self) -> None:
        """Forget what the gyro has taught: it was wrong."""
        ...

    def correct(self, estimate: SlipEstimate) -> None:
        """Correct the states by what was measured since the last increment, after the filter's prediction."""
        ...

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body's motion for wheel speeds or angles, by the newest slip."""
        ...

    def report(self) -> ReportT | None:
        """Return the newest slip; None before the first increment."""
        ...
