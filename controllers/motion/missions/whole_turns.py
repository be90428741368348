"""Turns the rover on the spot, whole turns in one sense and then as many in the other."""

import math
from typing import Annotated, Literal

from pydantic import Field

from controllers.motion.missions.mission import Follower, Guidance, Mobility, TurnsInPlace
from controllers.motion.planar import Pose, wrap_angle
from drivers.clock import seconds

APPROACH_GAIN_PER_S = 1.5
"""Yaw rate per radian that is left of the turns; chosen by hand."""
SLOWEST_SHARE = 0.2
"""Least yaw rate, over that of the mission: drives with coarse steps do not turn below one step."""
TOLERANCE_RAD = 0.02


class WholeTurnsMission(TurnsInPlace):
    """Whole turns on the spot, first counter-clockwise and then as many back: calibrates compass and wheels.

    Attributes:
        turns: Turns in each sense.
        turn_rate_rad_s: Yaw rate.
        rest_s: Rest before the turns, between the two senses, and after them.
        senses: `left` turns counter-clockwise only, `right` clockwise only.
    """

    type: Literal["whole_turns"]
    turns: Annotated[int, Field(ge=1, le=50)] = 3
    turn_rate_rad_s: Annotated[float, Field(ge=0.05, le=2.0)] = 0.4
    rest_s: Annotated[float, Field(ge=0.5, le=60.0)] = 2.0
    senses: Literal["both", "left", "right"] = "both"

    @property
    def title(self) -> str:
        """What is driven, in a few words that begin a sentence."""
        return f"{self.turns} turns in place in each sense"

    @property
    def fastest_turn_rad_s(self) -> float:
        """Greatest commanded yaw rate."""
        return self.turn_rate_rad_s

    def follower(self, mobility: Mobility) -> "WholeTurns":
        """Return what drives it."""
        return WholeTurns(self, mobility)


class WholeTurns(Follower[WholeTurnsMission]):
    """Commands whole turns by the estimated yaw, with a rest before, between and after the two senses."""

    def __init__(self, mission: WholeTurnsMission, mobility: Mobility) -> None:
        super().__init__(mission, mobility)
        turned_rad = math.tau * mission.turns
        targets_rad = {"both": [turned_rad, 0.0], "left": [turned_rad], "right": [-turned_rad]}
        self._targets_rad = targets_rad[mission.senses]
        self._turned_rad = 0.0
        self._yaw_rad: float | None = None
        self._rest_until_s = 0.0

    def guide(self, pose: Pose, now_ns: int, drift_rad: float = 0.0) -> Guidance:
        """Return the motion for a pose; the first call begins with a rest."""
        t_s = seconds(now_ns)
        if self._yaw_rad is None:
            self._rest_until_s = t_s + self._mission.rest_s
        else:
            self._turned_rad += wrap_angle(pose.yaw_rad - self._yaw_rad)
        self._yaw_rad = pose.yaw_rad
        if t_s < self._rest_until_s:
            return Guidance()
        if not self._targets_rad:
            return Guidance(finished=True)
        remaining_rad = self._targets_rad[0] - self._turned_rad
        if abs(remaining_rad) <= TOLERANCE_RAD:
            self._targets_rad.pop(0)
            self._rest_until_s = t_s + self._mission.rest_s
            return Guidance()
        fastest = self._mission.turn_rate_rad_s
        rate = min(fastest, max(APPROACH_GAIN_PER_S * abs(remaining_rad), SLOWEST_SHARE * fastest))
        return Guidance(yaw_rate_rad_s=math.copysign(rate, remaining_rad))
