"""What the estimator requires of a slip compensator, and the control loop of a slip estimator."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

from controllers.estimation.filter.reader import Reader
from controllers.estimation.filter.slip_states import SlipEstimate, SlipStates
from controllers.estimation.ground.travel import GroundPair, GroundReport
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.body_motion import BodyMotion
from controllers.motion.crab import DriftSource
from drivers.samples import Sample

ReportT = TypeVar("ReportT", covariant=True)


class SlipEvidence(NamedTuple):
    """What a slip estimator offers the stop rules as evidence.

    Attributes:
        slip: Valid slip of the rover; None where it is unknown.
        slip_sd: Its standard deviation.
        lost_response: Why the yaw's response to the excitation shows that the rover may make no progress; ""
            where it does not.
        unknown_share: Greatest error of the estimated travel, over that of the wheels, while the slip is
            unknown by that response; 0 where it is known.
        unanswered_m: Travel of the wheels since the rover may have got stuck, by that response.
        unusual_force: Why the drive force shows that the rover may make no progress; "" where it does not.
        unusual_force_m: Travel of the wheels since the rover may have got stuck, by that force.
        unmoved_m: Travel of the wheels on which a rear camera saw no motion of the ground; 0 for little.
    """

    slip: float | None = None
    slip_sd: float = 1.0
    lost_response: str = ""
    unknown_share: float = 0.0
    unanswered_m: float = 0.0
    unusual_force: str = ""
    unusual_force_m: float = 0.0
    unmoved_m: float = 0.0


NO_SLIP_EVIDENCE = SlipEvidence()


class SlipCompensator(Protocol):
    """Removes wheel slip from the motion that the wheels report.

    It does so in `compensate`, or by states of its own in the pose filter. With states `compensate` leaves
    the motion as it is; the filter predicts the body's motion from it.
    """

    @property
    def states(self) -> SlipStates | None:
        """The states in the pose filter; None without."""
        ...

    @property
    def evidence(self) -> SlipEvidence:
        """What the stop rules see of the slip in this cycle."""
        return NO_SLIP_EVIDENCE

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
            set_speed_rad_s: Setpoints of the wheels in that time.
            gyro_rate_rad_s: Newest yaw rate of the gyro, bias removed; None without a fresh one.
        """
        ...

    def forget_gyro(self) -> None:
        """Forget what the gyro has taught: it was wrong."""
        ...

    @property
    def readers(self) -> tuple[Reader[Any], ...]:
        """Of the measurements that correct its states in the pose filter."""
        return ()

    def follow(self, estimate: SlipEstimate) -> None:
        """Take the states at the end of a cycle, after the filter's prediction and corrections."""
        ...

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body's motion for wheel speeds or angles, by the newest slip."""
        ...


class SlipEstimator(SlipCompensator, Protocol[ReportT]):
    """A slip compensator that reports, offers evidence, and may change what is commanded."""

    @property
    def drift_rad(self) -> float:
        """Angle of the velocity from the direction in which the wheels roll, left positive; 0 if unknown."""
        return 0.0

    @property
    def drift_source(self) -> DriftSource:
        """What that angle comes from."""
        return DriftSource.NONE

    def report(self, ground: GroundReport | None = None) -> ReportT | None:
        """Return the newest slip; None before the first increment.

        Args:
            ground: Motion over the ground; a slip in it is reported instead of an inferred one.
        """
        ...

    def take_ground(self, pair: GroundPair) -> None:
        """Take a motion over the ground that a camera has measured."""
        return

    def excite(
        self, now_s: float, twist: BodyMotion, *, is_turning: bool, is_measured: bool
    ) -> tuple[BodyMotion, float]:
        """Return the commanded twist with the excitation that shows the slip, and the yaw rate of it.

        Args:
            now_s: Time of the cycle.
            twist: Commanded velocity x, y in m/s and yaw rate in rad/s.
            is_turning: Whether the rover turns on the spot for another reason.
            is_measured: Whether a camera measures the slip.
        """
        return twist, 0.0

    def set_point_changes(self, commanded_twist: BodyMotion) -> tuple[float, ...] | None:
        """Return what is added to the setpoint of each wheel, rad/s; None for nothing."""
        return None
