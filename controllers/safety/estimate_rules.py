"""Stop rules about the estimate: motion that is known, numbers that are finite."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from controllers.estimation.pose_fixes import DISPLACED, TURNED
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, Severity, StopReason, StopRule
from drivers.clock import nanoseconds
from drivers.settings import Settings


class UnseenSettings(Settings):
    """How much of the rover's motion may be unknown.

    Attributes:
        unseen_position_m: The rover stays stopped while motion that was not measured leaves the position with
            a standard deviation above this.
        unseen_yaw_rad: The same for the yaw.

    The rover also stops when it takes a pose fix that is displaced by more against the estimate.
    """

    unseen_position_m: Annotated[float, Field(ge=0.001, le=1000.0)] = 0.15
    unseen_yaw_rad: Annotated[float, Field(ge=0.001, le=1000.0)] = 0.1


class UnseenMotionRule(StopRule):
    """Stops when too much motion was not measured, until a fix or a heading gives the pose again.

    Where no device can, only the user knows: the stop is final.
    """

    is_for_drives = False

    def __init__(self, settings: UnseenSettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._position_severity = Severity.STOP if roles.fixes else Severity.FINAL
        self._yaw_severity = Severity.STOP if roles.fixes or roles.headings else Severity.FINAL

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Return a reason for position and yaw where they are too uncertain."""
        if cycle.unseen_m > self._settings.unseen_position_m:
            yield _unseen("position", f"{cycle.unseen_m:.2f} m", self._position_severity)
        if cycle.unseen_rad > self._settings.unseen_yaw_rad:
            yield _unseen("yaw", f"{cycle.unseen_rad:.2f} rad", self._yaw_severity)


def _unseen(what: str, by: str, severity: Severity) -> StopReason:
    needed = "a fix" if severity is Severity.STOP else "a restart at a known pose"
    text = f"pose filter: {what} uncertain by {by}, motion was not measured: needs {needed}"
    return StopReason(f"unseen {what}", text, severity)


class DisplacedFixRule(StopRule):
    """Stops when fixes that contradict the estimate by much were taken after all.

    The estimate follows them, as after slip that was greater than its uncertainty. But as well the rover may
    have been carried, or the device that gives the fixes may have been moved: only the user sees which.
    """

    def __init__(self, settings: UnseenSettings) -> None:
        self._limits = {
            DISPLACED: (settings.unseen_position_m, "m"),
            TURNED: (settings.unseen_yaw_rad, "rad"),
        }

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Return a reason for each fix of this cycle that is displaced by too much."""
        for innovation in cycle.innovations:
            for end, (limit, unit) in self._limits.items():
                if innovation.name.endswith(end) and (innovation.residual or 0.0) > limit:
                    device = innovation.name.removesuffix(end)
                    text = f"{device}: fixes{end} by {innovation.residual:.2f} {unit} against the estimate"
                    cause = "rover carried, device moved, or wheels slipped more than [filter] expects"
                    yield StopReason(f"{device} displaced", f"{text}: {cause}")


class MotionRule(StopRule):
    """Stops when no motion of the wheels has been measured for `motion_age_s` of the roles.

    Positions may be fresh and jump so much that none is a motion: the pose would stay where it is.
    """

    is_for_drives = False

    def __init__(self, roles: DeviceRoles) -> None:
        self._limit_ns = nanoseconds(roles.motion_age_s)
        self._text = f"{roles.wheels}: no wheel motion measured for {roles.motion_age_s:g} s"

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Return a reason when the motion is unknown for too long."""
        if cycle.motion_ns is None or cycle.now_ns - cycle.motion_ns > self._limit_ns:
            yield StopReason("no motion", self._text)


class FiniteEstimateRule(StopRule):
    """Stops when a number of the estimate is not finite."""

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Return a reason when the estimate is not finite."""
        if not cycle.estimate_is_finite:
            yield StopReason("not finite", "pose filter: the estimate is not finite")
