"""Stop rule about a receiver whose position stays while the rover drives."""

import math
from collections.abc import Iterator

from controllers.fault import Bound, Cause, ClearedBy, Fault
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from controllers.safety.repeated_readings import LONGEST_OPERATION
from drivers.safety_event import Outcome, SafetyEvent
from drivers.samples import PoseFixSample, Sample

LEAST_PATH_SD = 3.0
"""A position may stay until the wheels have rolled by so many of its standard deviations, and by a digit."""


class _Receiver:
    """How often successive positions were equal while the wheels rolled, and how often the newest are.

    Attributes:
        place_m: The newest position.
        std_m: Its standard deviation.
        digit_m: Least distance between two different successive positions.
        measured_ns: Its time.
        equal: Successive positions that were equal before the newest; a half of one is assumed before.
        pairs: All successive positions; one pair is assumed before.
        count: How often the newest position has come again after the wheels rolled.
        path_m: Rolled since it first came.
        rolled_m: Rolled since the newest reading.
    """

    def __init__(self) -> None:
        self.place_m: complex | None = None
        self.std_m, self.digit_m = 0.0, math.inf
        self.measured_ns: int | None = None
        self.equal, self.pairs = 0.5, 1.0
        self.count = 0
        self.path_m = self.rolled_m = 0.0

    def take(self, fix: PoseFixSample, *, is_still: bool) -> None:
        """Take a position; at standstill it may stay. One with an old time is only sent again."""
        if self.measured_ns is not None and fix.t_capture_ns <= self.measured_ns:
            return
        place_m = complex(fix.x_m, fix.y_m)
        self.measured_ns, self.std_m = fix.t_capture_ns, fix.position_std_m
        rolled_m, self.rolled_m = self.rolled_m, 0.0
        if place_m == self.place_m:
            self.count += rolled_m > 0.0 and not is_still
            return
        if self.place_m is not None:
            self.digit_m = min(self.digit_m, abs(place_m - self.place_m))
            self.equal += self.count
            self.pairs += self.count + 1
        self.place_m, self.count, self.path_m = place_m, 0, 0.0

    @property
    def is_frozen(self) -> bool:
        """Whether chance does not explain that the position stays."""
        digit_m = self.digit_m if math.isfinite(self.digit_m) else 0.0
        has_moved = self.path_m > LEAST_PATH_SD * self.std_m + digit_m
        return has_moved and self.count * -math.log(self.equal / self.pairs) >= math.log(LONGEST_OPERATION)


class FrozenPositionRule(StopRule):
    """Stops while a receiver sends one position, with new times, although the wheels roll."""

    observes = (PoseFixSample,)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A receiver repeats one position while the wheels roll, although its positions differed before.",
            "`…: the same position … times while the wheels rolled … m: …`",
            (
                "tests/controllers/safety/test_frozen_position_rule.py::"
                "test_a_receiver_whose_position_stays_is_named",
            ),
            within="the positions that rule out chance (6 after 80 different ones, 34 from the start), and "
            "three standard deviations of a position",
            clears="another position, or an operator who confirms: at standstill a receiver may be right",
        ),
    )

    def __init__(self, roles: DeviceRoles) -> None:
        self._receivers = {device: _Receiver() for device in roles.fixes}
        self._is_still = True

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a position of a receiver."""
        if isinstance(sample, PoseFixSample) and sample.device in self._receivers:
            self._receivers[sample.device].take(sample, is_still=self._is_still)

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for each receiver whose position stays."""
        self._is_still = cycle.wheels.is_still
        for device, receiver in self._receivers.items():
            if cycle.operation.is_confirmed:
                receiver.count, receiver.path_m = 0, 0.0
            receiver.path_m += cycle.wheels.distance_m
            receiver.rolled_m += cycle.wheels.distance_m
            if receiver.is_frozen:
                text = (
                    f"{device}: the same position {receiver.count} times while the wheels rolled "
                    f"{receiver.path_m:.2f} m: look at the receiver"
                )
                bound = Bound(position_m=receiver.path_m)
                yield Fault(device, Cause.FROZEN_POSITION, text, bound=bound, cleared_by=ClearedBy.OPERATOR)
