"""Stop rule about wheels that do not turn when they are commanded to."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from controllers.safety.reasons import Cycle, Severity, StopReason, StopRule
from drivers.clock import nanoseconds
from drivers.settings import Settings


class StallSettings(Settings):
    """When a wheel that does not turn stops the rover.

    Attributes:
        stall_s: The rover stops when a wheel has not followed its set-points for this long.
        stall_set_point_rad_s: Least set-point that every wheel follows under its greatest load. Friction and
            the droop of the drive's speed loop may take up smaller ones, so they are no evidence. 306 runs of
            a Robotino on four surfaces: a set-point of 0.43 rad/s turns every wheel.
        stall_ratio: A wheel follows when it turns faster than this share of what its set-point exceeds
            `stall_set_point_rad_s` by, and faster than `stall_speed_rad_s`.
        stall_speed_rad_s: A slower wheel does not turn. Not more: a loaded wheel creeps, and moves the rover.
    """

    stall_s: Annotated[float, Field(ge=0.1, le=10.0)] = 1.0
    stall_set_point_rad_s: Annotated[float, Field(ge=0.01, le=50.0)] = 0.5
    stall_ratio: Annotated[float, Field(ge=0.01, le=0.9)] = 0.1
    stall_speed_rad_s: Annotated[float, Field(ge=0.001, le=1.0)] = 0.02


class StallMonitor(StopRule):
    """Measures for how long each wheel has not followed its set-points.

    Only set-points from `stall_set_point_rad_s` on count. Smaller ones neither count nor clear: a set-point
    that swings through zero must not hide a stall. Motion clears, and so does a rover commanded to rest.
    """

    def __init__(self, settings: StallSettings, wheel_count: int) -> None:
        self._settings = settings
        self._longest_cycle_ns = nanoseconds(0.5 * settings.stall_s)
        self._stalled_ns = [0] * wheel_count
        self._checked_ns: int | None = None

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Return a reason for every wheel that does not follow the set-points of the cycle before."""
        checked_ns = cycle.now_ns if self._checked_ns is None else self._checked_ns
        # After a pause of the loop the set-points have expired: the pause is no stall.
        elapsed_ns = min(cycle.now_ns - checked_ns, self._longest_cycle_ns)
        self._checked_ns = cycle.now_ns
        is_at_rest = not any(cycle.commanded_rad_s)
        settings = self._settings
        least_rad_s = settings.stall_set_point_rad_s
        wheels = enumerate(zip(cycle.commanded_rad_s, cycle.measured_rad_s, strict=True))
        for wheel, (commanded, measured) in wheels:
            share_rad_s = settings.stall_ratio * (abs(commanded) - least_rad_s)
            if is_at_rest or abs(measured) > max(settings.stall_speed_rad_s, share_rad_s):
                self._stalled_ns[wheel] = 0
            elif abs(commanded) >= least_rad_s:
                self._stalled_ns[wheel] += elapsed_ns
            if self._stalled_ns[wheel]:
                text = (
                    f"wheel {wheel}: has not followed its set-point for {settings.stall_s:g} s: "
                    f"commanded {commanded:.2f} rad/s, measured {measured:.2f} rad/s"
                )
                is_stalled = self._stalled_ns[wheel] >= 2 * self._longest_cycle_ns
                yield StopReason("stall", text, Severity.STOP if is_stalled else Severity.SIGN)
