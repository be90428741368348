"""A slip compensator beside a pose filter, with the late readings of an estimator."""

from controllers.estimation.filter.late_readings import LateReadings
from controllers.estimation.filter.motion_history import MotionHistory, Step
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.reader import Situation
from controllers.estimation.settings import FilterSettings
from controllers.slip.scomp.compensator import ScompCompensator
from drivers.samples import Sample


class SlipReadings:
    """Passes samples on, and corrects the states of slip as the estimator does."""

    def __init__(self, slip: ScompCompensator, pose_filter: PoseFilter) -> None:
        self._slip, self._filter = slip, pose_filter
        self._late = LateReadings(slip.readers)
        self._history = MotionHistory()

    def take(self, sample: Sample) -> None:
        """Take a sample when it is measured."""
        self._slip.feed(sample, sample.t_ns)
        self._late.add(sample, sample.t_ns)

    def move(self, t_ns: int, step: Step) -> None:
        """Correct by what was measured up to the end of a step of the filter."""
        self._history.move(t_ns, step)
        for measured_ns, reader, sample in self._late.take(t_ns):
            way_back = self._history.way_back(measured_ns)
            assert way_back is not None
            now = Situation(
                pose_filter=self._filter,
                settings=FilterSettings(),
                history=self._history,
                measured_ns=measured_ns,
                way_back=way_back,
                yaw_rate_rad_s=0.0,
            )
            tuple(reader.correct(sample, now))
        self._slip.follow(self._filter)
