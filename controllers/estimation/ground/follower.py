"""The pose filter follows the motion over the ground that a camera measures."""

from collections.abc import Iterator
from typing import ClassVar

from controllers.estimation.filter.error_budget import ErrorBudget
from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.reader import Situation
from controllers.estimation.ground.frame_pose import FramePose
from controllers.estimation.ground.travel import GroundPair, GroundReport, GroundTravel
from controllers.estimation.gyro.turn_source import TurnSource
from controllers.estimation.pose_estimate import YawSource
from controllers.fault import Bound, Cause
from drivers.samples import FrameSample, Sample


class GroundFollower:
    """Corrects the pose filter by the motion between frames; inflates it where wheels contradict that.

    Args:
        travel: Measures the motion; None without a camera: nothing is then corrected.
        camera: Device that sends the frames.
        pose_filter: Is corrected.
        budget: Inflates the covariance.
        turns: Where the turn of the rover comes from.

    Attributes:
        pairs: Motions over the ground that the last cycle took.
        is_measured: Whether the motion over the ground is measured, so that the slip need not be inferred.
    """

    kind: ClassVar[type[Sample]] = FrameSample

    def __init__(
        self,
        travel: GroundTravel | None,
        camera: str | None,
        pose_filter: PoseFilter,
        budget: ErrorBudget,
        turns: TurnSource,
    ) -> None:
        self._travel, self._camera = travel, camera or ""
        self._budget, self._turns = budget, turns
        self._frame = FramePose(pose_filter)
        self.pairs: tuple[GroundPair, ...] = ()
        self.is_measured = False

    def source(self, sample: FrameSample) -> str | None:
        """Return the camera; None for other cameras, and where nothing measures the motion."""
        return self._camera if self._travel is not None and sample.device == self._camera else None

    def measured_ns(self, sample: FrameSample, t_ns: int) -> int:
        """Return the middle of the exposure."""
        return t_ns if self._travel is None else self._travel.exposed_ns(sample, t_ns)

    def correct(self, sample: FrameSample, now: Situation) -> Iterator[Innovation]:
        """Correct by the motion over the ground since the frame before; yield the innovations."""
        if self._travel is None:
            return
        pair, is_begin, rig_fault = self._travel.measure(
            sample, now.measured_ns, now.way_back, now.history.way_back
        )
        fault = None if pair is None else pair.fault
        if pair is not None and fault is not None:
            apart_m = fault.bound.position_m
            yield Innovation(
                measured=Measured(self._camera, "forward"), outcome=Outcome.CONTRADICTING, residual=apart_m
            )
            # One after the other they err in one direction: the errors add up, not their variances.
            sum_m = self._budget.greatest(fault.cause).position_m + apart_m
            self._budget.raise_to(fault.cause, Bound(position_m=sum_m))
        elif pair is not None:
            self._budget.clear(Cause.GROUND_AGAINST_WHEELS)
            corrects_yaw = self._turns.yaw_source is not YawSource.GYRO
            yield from self._frame.correct(self._camera, pair.motion, now.way_back, corrects_yaw=corrects_yaw)
            self.pairs += (pair,)
        # Before, the pair would remove it, and after the frame is marked, the next one.
        if rig_fault is None:
            self._budget.clear(Cause.RIG)
        else:
            self._budget.raise_to(Cause.RIG, rig_fault.bound)
        if is_begin:
            self._frame.mark(now.way_back)

    def miss(self, sample: FrameSample) -> None:
        """Take that a frame is older than the recorded motion."""
        if self._travel is not None:
            self._travel.miss()

    def compare(self, now_ns: int, *, is_at_standstill: bool) -> Iterator[Innovation]:
        """Compare the turn over the ground with that by the gyro, once in a second; it corrects nothing."""
        if self._travel is None:
            return
        is_gyro = self._turns.yaw_source is YawSource.GYRO or is_at_standstill
        yield from self._travel.compare_turns(self._camera, is_gyro=is_gyro)
        self.is_measured = self._travel.is_valid(now_ns)

    @property
    def sees_rotation(self) -> bool:
        """Return whether the turn that was last compared with that by the gyro is none of noise."""
        return self._travel is not None and self._travel.sees_rotation

    @property
    def measured_slip(self) -> complex:
        """What is added to the wheels' travel while the motion is measured, as a share; left imaginary."""
        return self._frame.measured_slip

    def moved_m(self, from_ns: int, to_ns: int) -> float:
        """Return how far a camera has seen the rover move in a time; 0 without one."""
        return 0.0 if self._travel is None else self._travel.moved_m(from_ns, to_ns)

    def report(self, now_ns: int) -> GroundReport | None:
        """Return the motion over the ground; None without a camera that measures it."""
        return None if self._travel is None else self._travel.report(now_ns)
