"""Driving by hand: body velocities that someone commands again and again, or the rover rests."""

import math

from controllers.motion.body_motion import BodyMotion
from controllers.motion.path_following import Guidance
from controllers.motion.settings import MissionSettings
from drivers.clock import nanoseconds

EXPIRY_S = 0.2
"""A command by hand holds this long: whoever drives repeats it, or the rover stops."""


class ByHand:
    """Limits commands by hand to the speed and yaw rate of the mission, and lets them expire.

    The curvature stays: a command beyond either limit is scaled as a whole.

    Args:
        mission: Its `speed_m_s` and `yaw_rate_limit_rad_s` are the limits.
        moves_sideways: Whether the rover can move in any direction at any heading.
        turns_on_spot: Whether it can turn without moving forwards.
        turn_radius_m: Least radius of an arc that it can drive.
    """

    def __init__(
        self,
        mission: MissionSettings,
        moves_sideways: bool,
        *,
        turns_on_spot: bool = True,
        turn_radius_m: float = 0.0,
    ) -> None:
        self.mission = mission
        self._moves_sideways = moves_sideways
        self._turns_on_spot = turns_on_spot
        self._turn_radius_m = turn_radius_m
        self._motion: BodyMotion = (0.0, 0.0, 0.0)
        self._expires_ns = 0

    def command(self, now_ns: int, motion: BodyMotion) -> None:
        """Take a command; one that is not finite commands rest."""
        self._motion = motion if all(map(math.isfinite, motion)) else (0.0, 0.0, 0.0)
        self._expires_ns = now_ns + nanoseconds(EXPIRY_S)

    def guide(self, now_ns: int) -> Guidance | None:
        """Return the commanded velocity within the limits; None for rest, or when the command has expired."""
        if now_ns >= self._expires_ns or not any(self._motion):
            return None
        forward_m_s, left_m_s, yaw_rate_rad_s = self._motion
        if not self._moves_sideways:
            left_m_s = 0.0
        limit_rad_s = self.mission.yaw_rate_limit_rad_s
        if not self._turns_on_spot and forward_m_s == 0.0:
            yaw_rate_rad_s = 0.0
        elif self._turn_radius_m > 0.0 and forward_m_s != 0.0:
            tightest_rad_s = abs(forward_m_s) / self._turn_radius_m
            yaw_rate_rad_s = min(tightest_rad_s, max(-tightest_rad_s, yaw_rate_rad_s))
        # One factor for both: a rover that is only slower drives the same curve.
        share = min(
            1.0,
            self.mission.speed_m_s / max(math.hypot(forward_m_s, left_m_s), 1e-9),
            limit_rad_s / max(abs(yaw_rate_rad_s), 1e-9),
        )
        return Guidance(
            velocity_x_m_s=share * forward_m_s,
            velocity_y_m_s=share * left_m_s,
            yaw_rate_rad_s=share * yaw_rate_rad_s,
            cross_track_m=0.0,
            finished=False,
        )
