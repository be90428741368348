"""A rectangle."""

from typing import Literal

from controllers.motion.missions.mission import Leg
from controllers.motion.missions.path_following import CornersMission, PathLength


class RectangleMission(CornersMission):
    """A rectangle once around, counter-clockwise, the first side along x: back to the start.

    Attributes:
        length_m: Side along x.
        width_m: Side along y.
    """

    type: Literal["rectangle"]
    length_m: PathLength
    width_m: PathLength

    @property
    def title(self) -> str:
        """What is driven, in a few words that begin a sentence."""
        return f"Rectangle of {self.length_m:g} m × {self.width_m:g} m"

    def legs(self) -> tuple[Leg, ...]:
        """Return the legs of the path, which begins at (0, 0)."""
        length_m, width_m = self.length_m, self.width_m
        corners = ((length_m, 0.0), (length_m, width_m), (0.0, width_m), (0.0, 0.0))
        return tuple(Leg(corner, None, self.wait_s) for corner in corners) * self.repeat
