"""How a sample corrects the pose filter."""

from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from typing import ClassVar, Protocol, TypeVar

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.filter.motion_history import MotionHistory, WayBack
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.settings import FilterSettings
from drivers.samples import Sample

SampleT = TypeVar("SampleT", bound=Sample, contravariant=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """What a reader may need to know.

    Attributes:
        pose_filter: Is corrected.
        settings: Noise.
        history: Recorded motion.
        measured_ns: When the sample was measured.
        way_back: From the present pose to that at this time.
        yaw_rate_rad_s: Of the rover.
    """

    pose_filter: PoseFilter
    settings: FilterSettings
    history: MotionHistory
    measured_ns: int
    way_back: WayBack
    yaw_rate_rad_s: float


class Reader(Protocol[SampleT]):
    """Corrects the pose filter by samples of one kind.

    Attributes:
        kind: Type of these samples.
    """

    kind: ClassVar[type[Sample]]

    def source(self, sample: SampleT) -> Hashable | None:
        """Return what the sample is one of: only newer ones are read. None for a device that is not used."""
        ...

    def measured_ns(self, sample: SampleT, t_ns: int) -> int:
        """Return when a sample that arrived at `t_ns` was measured."""
        ...

    def correct(self, sample: SampleT, now: Situation) -> Iterable[Innovation]:
        """Correct by a sample; return what became of its measurements."""
        ...

    def miss(self, sample: SampleT) -> None:
        """Take that a sample is older than the recorded motion, so that it cannot be read."""
        ...


def late(sample: Sample) -> Innovation:
    """Return that a sample is older than the recorded motion."""
    return Innovation(measured=Measured(sample.device, "too late"), outcome=Outcome.LATE)
