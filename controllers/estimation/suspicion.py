"""Why the wheels may not measure the motion of the rover."""

from enum import StrEnum
from typing import NamedTuple


class Contradiction(StrEnum):
    """What contradicts the wheels, by its fixed name."""

    MOTION_AT_REST = "motion at rest"
    STUCK_ENCODER = "stuck encoder"


class Suspicion(NamedTuple):
    """Why the wheels may not measure the motion; two with the same cause and parts are the same.

    Attributes:
        cause: What contradicts them.
        parts: What reports the motion, or which wheels do not.
    """

    cause: Contradiction
    parts: tuple[str, ...]

    @property
    def text(self) -> str:
        """The sentence for the user."""
        if self.cause is Contradiction.MOTION_AT_REST:
            moving = " and ".join(self.parts)
            return f"the wheels are at rest, but motion is reported by {moving}; the estimate is wider"
        wheels = ", ".join(self.parts)
        return (
            f"wheel {wheels} does not turn, but the gyro contradicts the turn by the others; "
            "the estimate is wider"
        )
