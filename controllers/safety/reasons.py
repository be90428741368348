"""What a stop rule is: it sees samples and cycles, and gives reasons to stop."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import ClassVar, NamedTuple

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.ground.travel import GroundPair
from controllers.estimation.wheels.turn_evidence import TurnEvidence
from controllers.fault import Fault
from drivers.safety_event import SafetyEvent
from drivers.samples import Sample


class Cycle(NamedTuple):
    """What the stop rules see of one cycle.

    Attributes:
        now_ns: Time of the cycle.
        estimate_is_finite: Whether every number of the estimate is finite.
        motion_ns: When the motion of the wheels was last known; None before the first.
        innovations: Of this cycle.
        commanded_rad_s: Set-points of the cycle before.
        measured_rad_s: Measured speeds of the wheels.
        distance_m: Driven since the cycle before, by the wheels.
        travel_m: The same as a vector in the local frame, turned by the estimated yaw: x + i y.
        yaw_rad: The estimated yaw.
        is_still: Whether the wheels report, and have been at rest for a while.
        evidence: Turn of the rover by gyro and by wheels; None where one of them did not measure it.
        gyro_bias_rad_s: Estimated reading of the gyro at rest.
        rejected_rate_rad_s: Newest reading of the gyro if the rover cannot turn that fast; else None.
        unseen_m: Standard deviation of the position from motion that was not measured.
        unseen_rad: The same of the yaw.
        doubted_rad: Standard deviation of the yaw because gyro and wheels excluded each other and nothing
            decided, before the corrections of this cycle; these reduce it.
        jumped_m: By how much the places of each device have jumped, in the local frame; without those that
            agree with the estimate.
        ground_pairs: Motions over the ground that a camera has measured in this cycle.
        slip: Valid slip of the rover; None where it is unknown.
        lost_response: Why the yaw's response to the excitation shows that the rover may not get on; "" where
            it does not.
        unanswered_m: Travel of the wheels since the rover may have got stuck, by that response.
        odd_force: Why the drive force shows that the rover may not get on; "" where it does not.
        odd_force_m: Travel of the wheels since the rover may have got stuck, by that force.
        unmoved_m: Travel of the wheels on which a rear camera saw no motion of the ground; 0 for little.
        set_steering_rad: Steering set-points of the cycle before; empty where no wheel steers.
        steering_rad: Steering angles, one per wheel; empty where no wheel steers.
        steering_ns: Time of the newest reported steering angle of each wheel that has reported one.
        operator_reason: Why the operator's side must not let the rover move; "" for nothing.
        contradiction: How far redundant wheels contradict each other, above 1 where they do; None where they
            are not redundant.
        position_m: The estimated position in the local frame, x + i y.
        over_border_m: Greatest excess of the rover's region over the border of its area, negative inside.
        is_led_out: Whether the mission has just led a rover that is over the border farther out.
        is_confirmed: Whether an operator has just confirmed that the rover may move.
    """

    now_ns: int
    estimate_is_finite: bool = True
    motion_ns: int | None = None
    innovations: tuple[Innovation, ...] = ()
    commanded_rad_s: tuple[float, ...] = ()
    measured_rad_s: tuple[float, ...] = ()
    distance_m: float = 0.0
    travel_m: complex = 0j
    yaw_rad: float = 0.0
    is_still: bool = False
    evidence: TurnEvidence | None = None
    gyro_bias_rad_s: float = 0.0
    rejected_rate_rad_s: float | None = None
    unseen_m: float = 0.0
    unseen_rad: float = 0.0
    doubted_rad: float = 0.0
    jumped_m: Mapping[str, complex] = MappingProxyType({})
    ground_pairs: tuple[GroundPair, ...] = ()
    slip: float | None = None
    lost_response: str = ""
    unanswered_m: float = 0.0
    odd_force: str = ""
    odd_force_m: float = 0.0
    unmoved_m: float = 0.0
    set_steering_rad: tuple[float, ...] = ()
    steering_rad: tuple[float, ...] = ()
    steering_ns: Mapping[int, int] = MappingProxyType({})
    operator_reason: str = ""
    contradiction: float | None = None
    position_m: complex = 0j
    over_border_m: float = -math.inf
    is_led_out: bool = False
    is_confirmed: bool = False


class StopRule(ABC):
    """One rule that may stop the rover.

    Every sample is observed before the cycle is checked, and every cycle is checked, in every mode.

    Attributes:
        observes: Kinds of samples that `observe` takes.
        events: Its rows of the reference page of safety.
        is_for_missions: Whether it stops a mission.
        is_for_drives: Whether it also judges a drive that somebody else controls: it needs no set-points, and
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
