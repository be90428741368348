"""Turns the rover back and forth in place, frequency after frequency."""

import math
from typing import Annotated, Literal

from pydantic import Field

from controllers.motion.missions.mission import Follower, Guidance, Mobility, TurnsInPlace
from controllers.motion.planar import Pose, wrap_angle
from drivers.clock import seconds

HEADING_GAIN_PER_S = 0.3
"""Chosen by hand: far slower than the slowest turns."""


class SmallTurnsMission(TurnsInPlace):
    """Small turns back and forth in place, frequency after frequency: identifies the gyro.

    Attributes:
        frequencies_hz: Of the turns, in order.
        each_s: Time for each.
        turn_rate_rad_s: Amplitude of the commanded yaw rate.
    """

    type: Literal["small_turns"]
    frequencies_hz: Annotated[
        tuple[Annotated[float, Field(ge=0.2, le=15.0)], ...], Field(min_length=1, max_length=100)
    ] = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 5.0, 2.0)
    each_s: Annotated[float, Field(ge=1.0, le=60.0)] = 6.0
    turn_rate_rad_s: Annotated[float, Field(ge=0.02, le=2.0)] = 0.35

    @property
    def title(self) -> str:
        """What is driven, in a few words that begin a sentence."""
        return "Small turns in place"

    @property
    def fastest_turn_rad_s(self) -> float:
        """Greatest commanded yaw rate."""
        return self.turn_rate_rad_s

    def follower(self, mobility: Mobility) -> "SmallTurns":
        """Return what drives it."""
        return SmallTurns(self, mobility)


class SmallTurns(Follower[SmallTurnsMission]):
    """Commands sinusoids of the yaw rate; the heading at the start is held on average."""

    _began_ns: int | None = None

    def guide(self, pose: Pose, now_ns: int, drift_rad: float = 0.0) -> Guidance:
        """Return the motion for a time; the first call begins the turns."""
        mission = self._mission
        if self._began_ns is None:
            self._began_ns = now_ns
        since_s = seconds(now_ns) - seconds(self._began_ns)
        index = int(since_s / mission.each_s)
        if index >= len(mission.frequencies_hz):
            return Guidance(finished=True)
        angle_rad = math.tau * mission.frequencies_hz[index] * (since_s - index * mission.each_s)
        turn_rad_s = mission.turn_rate_rad_s * math.sin(angle_rad)
        return Guidance(yaw_rate_rad_s=turn_rad_s - HEADING_GAIN_PER_S * wrap_angle(pose.yaw_rad))
