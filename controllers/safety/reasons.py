"""What a stop rule is: it sees samples and cycles, and gives reasons to stop."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import ClassVar, NamedTuple

from controllers.estimation.filter.error_budget import UncertaintyEvidence
from controllers.estimation.gyro.turn_source import GyroEvidence
from controllers.estimation.measurement_evidence import MeasurementEvidence
from controllers.estimation.pose_estimate import PoseEstimate
from controllers.estimation.slip_compensator import SlipEvidence
from controllers.estimation.wheels.evidence import WheelEvidence
from controllers.fault import Fault
from drivers.safety_event import SafetyEvent
from drivers.samples import Sample


class Operation(NamedTuple):
    """What operator, mission and area want of the rover.

    Attributes:
        stop_reason: Why the operator's side must not let the rover move; "" for nothing.
        over_border_m: Greatest excess of the rover's region over the border of its area, negative inside.
        is_led_out: Whether the mission has just led a rover that is over the border farther out.
        is_confirmed: Whether an operator has just confirmed that the rover may move.
        check_failure: Why the mission must not begin after the check manoeuvre; "" for nothing.
    """

    stop_reason: str = ""
    over_border_m: float = -math.inf
    is_led_out: bool = False
    is_confirmed: bool = False
    check_failure: str = ""


class Cycle(NamedTuple):
    """What the stop rules see of one cycle: the evidence of each part.

    Attributes:
        now_ns: Time of the cycle.
        estimate: The estimated motion.
        wheels: Motion of the wheels.
        gyro: Turn by the gyro.
        measurements: What became of the measurements.
        uncertainty: Uncertainty that was added.
        slip: By the slip estimator.
        operation: Of operator, mission and area.
    """

    now_ns: int
    estimate: PoseEstimate
    wheels: WheelEvidence = WheelEvidence()
    gyro: GyroEvidence = GyroEvidence()
    measurements: MeasurementEvidence = MeasurementEvidence()
    uncertainty: UncertaintyEvidence = UncertaintyEvidence()
    slip: SlipEvidence = SlipEvidence()
    operation: Operation = Operation()


class StopRule(ABC):
    """One rule that may stop the rover.

    Every sample is observed before the cycle is checked, and every cycle is checked, in every mode.

    Attributes:
        observes: Kinds of samples that `observe` takes.
        events: Its rows of the reference page of safety.
        is_for_missions: Whether it stops a mission.
        is_for_drives: Whether it also judges a drive that somebody else controls: it needs no setpoints, and
            its reason is none to wait for.
    """

    is_for_missions: ClassVar[bool] = True
    is_for_drives: ClassVar[bool] = True
    observes: ClassVar[tuple[type[Sample], ...]] = (Sample,)
    events: ClassVar[tuple[SafetyEvent, ...]]

    def observe(self, sample: Sample, t_ns: int) -> None:  # noqa: B027 (most rules need no samples)
        """Take one sample as of `t_ns`."""

    @abstractmethod
    def check(self, cycle: Cycle) -> Iterable[Fault]:
        """Return every reason of this rule that holds in this cycle."""
