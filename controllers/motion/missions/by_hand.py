"""Driving by hand: body velocities that someone commands again and again, or the rover rests."""

import math
from collections.abc import Iterator
from typing import Literal

from controllers.motion.body_motion import BodyMotion
from controllers.motion.missions.mission import Follower, Guidance, Mission, Mobility, NeededMotion
from controllers.motion.planar import Pose
from drivers.clock import nanoseconds

DIRECTIONS = 24
"""Of the motions whose wheel speeds are compared with the limit: 15 deg apart they differ by 1 %."""
EXPIRY_S = 0.2
"""A command by hand holds this long: whoever drives repeats it, or the rover stops."""


class ByHandMission(Mission):
    """No path: someone drives by hand on the page of `bench`, within the speed and yaw rate given here."""

    type: Literal["by_hand"]

    @property
    def title(self) -> str:
        """What is driven, in a few words that begin a sentence."""
        return "Drive by hand"

    def follower(self, mobility: Mobility) -> "ByHand":
        """Return what drives it."""
        return ByHand(self, mobility)

    def conflicts(self, mobility: Mobility) -> Iterator[str]:
        """Yield nothing: what a rover cannot do is left out."""
        yield from ()

    def turns_beside_travel(self, mobility: Mobility) -> bool:
        """Return False: nobody knows before."""
        return False

    def motions(self, mobility: Mobility) -> Iterator[NeededMotion]:
        """Yield the greatest velocity in each direction that the rover has, and the turn."""
        cause = f"mission.speed_m_s = {self.speed_m_s:g} m/s"
        for direction in range(DIRECTIONS if mobility.moves_sideways else 1):
            angle_rad = math.tau * direction / DIRECTIONS
            velocity = (self.speed_m_s * math.cos(angle_rad), self.speed_m_s * math.sin(angle_rad))
            yield NeededMotion(cause, (*velocity, 0.0))
        rate_rad_s = self.yaw_rate_limit_rad_s
        if mobility.turns_on_spot:
            yield NeededMotion(f"mission.yaw_rate_limit_rad_s = {rate_rad_s:g} rad/s", (0.0, 0.0, rate_rad_s))


class ByHand(Follower[ByHandMission]):
    """Limits commands by hand to the speed and yaw rate of the mission, and lets them expire.

    The curvature stays: a command beyond either limit is scaled as a whole.
    """

    _motion: BodyMotion = (0.0, 0.0, 0.0)
    _expires_ns = 0

    def command(self, now_ns: int, motion: BodyMotion) -> None:
        """Take a command; one that is not finite commands rest."""
        self._motion = motion if all(map(math.isfinite, motion)) else (0.0, 0.0, 0.0)
        self._expires_ns = now_ns + nanoseconds(EXPIRY_S)

    def guide(self, pose: Pose, now_ns: int, drift_rad: float = 0.0) -> Guidance | None:
        """Return the commanded velocity within the limits; None for rest, or when the command has expired."""
        if now_ns >= self._expires_ns or not any(self._motion):
            return None
        mission, mobility = self._mission, self._mobility
        forward_m_s, left_m_s, yaw_rate_rad_s = self._motion
        if not mobility.moves_sideways:
            left_m_s = 0.0
        if not mobility.turns_on_spot and forward_m_s == 0.0:
            yaw_rate_rad_s = 0.0
        elif mobility.turn_radius_m > 0.0 and forward_m_s != 0.0:
            tightest_rad_s = abs(forward_m_s) / mobility.turn_radius_m
            yaw_rate_rad_s = min(tightest_rad_s, max(-tightest_rad_s, yaw_rate_rad_s))
        # One factor for both: a rover that is only slower drives the same curve.
        share = min(
            1.0,
            mission.speed_m_s / max(math.hypot(forward_m_s, left_m_s), 1e-9),
            mission.yaw_rate_limit_rad_s / max(abs(yaw_rate_rad_s), 1e-9),
        )
        return Guidance(
            velocity_x_m_s=share * forward_m_s,
            velocity_y_m_s=share * left_m_s,
            yaw_rate_rad_s=share * yaw_rate_rad_s,
        )
