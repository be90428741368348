"""What pose fixes or a camera say of the yaw while gyro and wheels exclude each other."""

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.measurement_model import Measured
from controllers.fault import Severity
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle
from drivers.clock import nanoseconds

WATCHED_S = 3.0
"""A pose fix with a yaw, or a turn that the ground shows, speaks for this long; chosen by hand."""

AGREES = 2.0
CONTRADICTS = 3.5
"""A yaw agrees with that of the gyro within so many standard deviations, and contradicts it beyond so many:
19 of 20 right ones agree, 1 in 2000 contradicts."""


class YawWatch:
    """Whether pose fixes, or the ground under a camera, agree with the yaw by the gyro or contradict it.

    Then they decide whether the gyro is wrong or wheels are without grip. The yaw of the estimate may already
    be wide enough for both: a fix is compared with what the gyro alone leaves uncertain.

    Args:
        roles: Devices that give fixes, and the camera.
    """

    def __init__(self, roles: DeviceRoles) -> None:
        self._fixes = {Measured(device, "yaw") for device in roles.fixes}
        self._turn = Measured(str(roles.camera), "turn")
        self._agrees = False
        self._turn_rejections = 0
        self._said_ns: int | None = None
        self._is_watchable = bool(roles.fixes or roles.headings or roles.camera)

    def take(self, cycle: Cycle) -> None:
        """Take the fixes of a cycle; one that says neither ends the watch."""
        for innovation in cycle.measurements.innovations:
            if innovation.measured == self._turn:
                self._take_turn(innovation.accepted, cycle.now_ns)
            elif innovation.measured in self._fixes:
                said = _said(innovation, cycle.uncertainty.undecided_rad)
                self._agrees, self._said_ns = bool(said), None if said is None else cycle.now_ns

    def _take_turn(self, is_accepted: bool, now_ns: int) -> None:
        """Take a turn over the ground: a second against the gyro must follow the first before both count.

        One of 20 is rejected though nothing is wrong, and one may be of another ground than that in view.
        """
        before, self._turn_rejections = self._turn_rejections, 0 if is_accepted else self._turn_rejections + 1
        self._agrees = is_accepted
        self._said_ns = now_ns if is_accepted or before else None

    def severity(self, now_ns: int) -> Severity:
        """Return that of a gyro which measures no turn: a stop where it is known to be wrong."""
        if self._said_ns is None or now_ns - self._said_ns > nanoseconds(WATCHED_S):
            return Severity.UNCERTAIN
        return Severity.WARNING if self._agrees else Severity.STOP

    def consequence(self, severity: Severity) -> str:
        """Return the end of a text: what the severity of a gyro that measures no turn means."""
        if severity is Severity.STOP:
            return "; the rover turns otherwise than the gyro measures"
        if severity is not Severity.UNCERTAIN:
            return ""
        return "; the yaw is uncertain by both" + ("" if self._is_watchable else ", yaw unwatched")


def _said(innovation: Innovation, doubted_rad: float) -> bool | None:
    """Return whether a fix agrees with the yaw by the gyro; None where it says neither."""
    if innovation.residual is None or innovation.variance is None:
        return None
    sure_rad2 = innovation.variance - doubted_rad**2
    nis = innovation.residual**2 / sure_rad2 if sure_rad2 > 0.0 else 0.0
    if sure_rad2 <= 0.0 or AGREES**2 < nis <= CONTRADICTS**2:
        return None
    return nis <= AGREES**2
