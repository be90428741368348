"""A straight line, there and back where it is repeated."""

from typing import Literal

from controllers.motion.missions.mission import Leg
from controllers.motion.missions.path_following import CornersMission, PathLength


class LineMission(CornersMission):
    """A straight line along x.

    Attributes:
        length_m: Length of the line.
    """

    type: Literal["line"]
    length_m: PathLength

    @property
    def title(self) -> str:
        """What is driven, in a few words that begin a sentence."""
        return f"Straight line of {self.length_m:g} m"

    def legs(self) -> tuple[Leg, ...]:
        """Return the legs of the path, which begins at (0, 0)."""
        there, back = Leg((self.length_m, 0.0), None, self.wait_s), Leg((0.0, 0.0), None, self.wait_s)
        return ((there, back) * self.repeat)[:-1]
