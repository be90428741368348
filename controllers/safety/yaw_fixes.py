"""Whether pose fixes or a camera watch the yaw."""

from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, Severity
from drivers.clock import nanoseconds

WATCHED_S = 3.0
"""A pose fix whose yaw was accepted, or a turn that the ground shows, watches the yaw for this long; chosen
by hand."""


class YawFixes:
    """Whether pose fixes, or the ground under a camera, agree with the yaw.

    Then they decide whether a gyro is wrong or wheels are without grip.
    """

    def __init__(self, roles: DeviceRoles) -> None:
        self._names = {f"{device} yaw" for device in roles.fixes} | {f"{roles.camera} turn"}
        self._agreed_ns: int | None = None

    def take(self, cycle: Cycle) -> None:
        """Take the fixes of a cycle; a rejected one ends the agreement."""
        for innovation in cycle.innovations:
            if innovation.name in self._names:
                self._agreed_ns = cycle.now_ns if innovation.accepted else None

    def severity(self, now_ns: int) -> Severity:
        """Return that of a gyro which measures no turn."""
        is_watched = self._agreed_ns is not None and now_ns - self._agreed_ns <= nanoseconds(WATCHED_S)
        return Severity.SUSPICION if is_watched else Severity.RECOVERABLE
