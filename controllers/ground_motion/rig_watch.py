"""Contradictions of ground and wheels by a wrong rig: camera turned, upside down, other focal length."""

import math

from controllers.fault import Bound, Cause, Fault, Severity
from controllers.ground_motion.parameters import RigWatchParameters


class RigWatch:
    """Compares the travel of the ground with that of the wheels. A wheel slips, it does not lag behind.

    The direction of the camera is confirmed once the ground has moved along with the wheels for some travel,
    less that over which it did not. Until then any direction that is not theirs contradicts the rig, and so
    does ground that is hardly ever followed; later a rover may slide. Ground that hardly moves along is
    measured, but over the first metre the wheels may be right. Ground that outruns the wheels contradicts the
    rig for the whole drive, and slip may have hidden that before, and hides it again: it is reported until
    the wheels have rolled on.

    Args:
        scale_sd: Standard deviation of the travel's factor.
        parameters: Tuned numbers.

    Attributes:
        fault: What contradicts the rig after the newest pair, and by how much the travel of the pairs before
            may be wrong then; that grows while the contradiction becomes clear. Its text is empty where the
            direction is not confirmed. None where nothing contradicts the rig.
    """

    def __init__(self, scale_sd: float, parameters: RigWatchParameters) -> None:
        self._numbers = parameters
        self._most = 1 + parameters.skid + parameters.deviations * scale_sd
        self._wheel_m, self._ground_m = 0.0, 0j
        self._confirmed_m = self._missed_m = 0.0
        self._used_m = self._apart_m = 0.0
        self._apart = self._rolled_m = 0.0
        self._since_outrun_m = math.inf
        self.fault: Fault | None = None

    @property
    def is_confirmed(self) -> bool:
        """Return whether the ground has moved along with the wheels for long enough."""
        return self._confirmed_m >= self._numbers.confirmed_travel_m

    @property
    def text(self) -> str:
        """Return what contradicts the rig; "" for nothing."""
        return "" if self.fault is None else self.fault.text

    def miss(self, wheel_m: float) -> None:
        """Take a pair whose pictures show no motion of the ground, and the travel of the wheels.

        The estimate goes on as the pairs before show.
        """
        if self.is_confirmed:
            return
        self._confirmed_m = max(0.0, self._confirmed_m - wheel_m)
        self._missed_m += wheel_m
        self._apart_m += self._apart * wheel_m
        if unfollowed := self.unfollowed:
            self._report(unfollowed, self._apart_m)

    @property
    def unfollowed(self) -> str:
        """Return a hint where the ground has hardly ever been followed, "" otherwise."""
        if self.is_confirmed or self._missed_m < self._numbers.unfollowed_m:
            return ""
        return (
            f"the ground was not followed over {self._missed_m:.1f} m of the wheels: check that the camera "
            "is not upside down, its rig, focus and light"
        )

    def update(self, wheel_m: float, ground_m: complex, sd_m: float) -> None:
        """Take a pair.

        Args:
            wheel_m: Travel by the wheels, positive.
            ground_m: That of the ground along it, and to its left as imaginary part.
            sd_m: Standard deviation of this. Errors of pairs do not add up while the rover is slow.
        """
        numbers = self._numbers
        kept = math.exp(-wheel_m / numbers.memory_m)
        self._wheel_m = kept * self._wheel_m + wheel_m
        self._ground_m = kept * self._ground_m + ground_m
        slack_m = numbers.deviations * sd_m
        is_confirmed = self.is_confirmed
        text = "" if is_confirmed else self._wrong_course(slack_m)
        wrong_m = self._apart_m
        if not text and self._outruns(slack_m, is_confirmed=is_confirmed):
            self._since_outrun_m = 0.0
            ratio = self._ground_m.real / self._wheel_m
            wrong_m = (1.0 - 1.0 / ratio) * self._used_m
            text = (
                f"ground moves {ratio:.2f} times as far as the wheels: check focal length, height and pitch "
                "of the rig, and the wheels' radius"
            )
        self._confirm(wheel_m, ground_m)
        text = text or self.unfollowed
        if text:
            self._report(text, wrong_m)
            return
        self._since_outrun_m += wheel_m
        if self._since_outrun_m < numbers.memory_m:
            return
        self._use(wheel_m, ground_m)

    def _confirm(self, wheel_m: float, ground_m: complex) -> None:
        """Count a pair for or against the direction of the camera."""
        if self.is_confirmed:
            return
        if ground_m.real > self._numbers.backwards * wheel_m:
            self._confirmed_m += wheel_m
            self._missed_m = max(0.0, self._missed_m - wheel_m)
        elif ground_m.real < 0.0:
            self._confirmed_m = max(0.0, self._confirmed_m - wheel_m)

    def _use(self, wheel_m: float, ground_m: complex) -> None:
        """Count a pair that is used: while the direction is not confirmed, the wheels may be right."""
        self._rolled_m += wheel_m
        # A camera that is upside down contradicts wheels or gyro before.
        may_be_wrong = not self.is_confirmed and self._rolled_m < self._numbers.confirmed_travel_m
        may_be_wrong &= self._ground_m.real < self._numbers.backwards * self._wheel_m
        if self.text or (self.fault is not None and not may_be_wrong):
            self._used_m = self._apart_m = 0.0
        self.fault = None
        self._used_m += abs(ground_m)
        self._apart_m += abs(ground_m - wheel_m)
        self._apart = abs(ground_m - wheel_m) / wheel_m
        if may_be_wrong:
            self._report("", self._apart_m)

    def _report(self, text: str, wrong_m: float) -> None:
        before_m = 0.0 if self.fault is None else self.fault.bound.position_m
        bound = Bound(position_m=max(before_m, wrong_m))
        self.fault = Fault("rig", Cause.RIG, text, Severity.UNCERTAIN, bound)

    def _wrong_course(self, slack_m: float) -> str:
        """Return which direction of the ground contradicts the mounting of the camera; "" for none."""
        numbers, along_m, across_m = self._numbers, self._ground_m.real, abs(self._ground_m.imag)
        if along_m < -numbers.skid * self._wheel_m - slack_m:
            return (
                "ground moves against the wheels: check that the camera is not upside down, or whether the "
                "rover slides back"
            )
        if across_m > max(numbers.across * self._wheel_m, abs(along_m)) + slack_m:
            return "ground moves across the wheels' course: check that the camera is not turned"
        return ""

    def _outruns(self, slack_m: float, *, is_confirmed: bool) -> bool:
        """Return whether the ground has moved further than the wheels can have moved it."""
        if is_confirmed and self._wheel_m < self._numbers.least_travel_m:
            return False
        return self._ground_m.real > self._most * self._wheel_m + slack_m + self._numbers.slack_m
