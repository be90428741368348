"""Stop rules about the estimate: wheel motion that is known, numbers that are finite."""

from collections.abc import Iterator

from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopReason, StopRule
from drivers.clock import nanoseconds


class MotionRule(StopRule):
    """Stops when no motion of the wheels has been measured for `motion_age_s` of the roles.

    Positions may be fresh and jump so much that none is a motion: the pose would stay where it is.
    """

    def __init__(self, roles: DeviceRoles) -> None:
        self._roles = roles

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Return a reason when the motion is unknown for too long."""
        age_s = self._roles.motion_age_s
        if cycle.motion_ns is None or cycle.now_ns - cycle.motion_ns > nanoseconds(age_s):
            yield StopReason("no motion", f"{self._roles.wheels}: no wheel motion measured for {age_s:g} s")


class FiniteEstimateRule(StopRule):
    """Stops when a number of the estimate is not finite."""

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Return a reason when the estimate is not finite."""
        if not cycle.estimate_is_finite:
            yield StopReason("not finite", "pose filter: the estimate is not finite")
