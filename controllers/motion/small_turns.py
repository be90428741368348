"""Turns the rover to and fro in place, frequency after frequency."""

import math

from controllers.motion.path_following import NO_TURN_ON_SPOT, Guidance
from controllers.motion.planar import Pose, wrap_angle
from controllers.motion.settings import SmallTurnsMission
from drivers.errors import ConfigError


class SmallTurns:
    """Commands sinusoids of the yaw rate; the heading at the start is held on average.

    Args:
        mission: Frequencies, time for each and amplitude.
        turns_on_spot: Whether the rover can turn without moving forwards.

    Raises:
        ConfigError: The rover cannot turn on the spot.
    """

    def __init__(self, mission: SmallTurnsMission, *, turns_on_spot: bool = True) -> None:
        if not turns_on_spot:
            raise ConfigError(NO_TURN_ON_SPOT)
        self._mission = mission
        self._began_s: float | None = None

    def guide(self, pose: Pose, t_s: float) -> Guidance:
        """Return the motion for a time; the first call begins the turns.

        Args:
            pose: Of the rover.
            t_s: Time of the cycle.
        """
        mission = self._mission
        if self._began_s is None:
            self._began_s = t_s
        since_s = t_s - self._began_s
        index = int(since_s / mission.each_s)
        if index >= len(mission.frequencies_hz):
            return Guidance(
                velocity_x_m_s=0.0, velocity_y_m_s=0.0, yaw_rate_rad_s=0.0, cross_track_m=0.0, finished=True
            )
        angle_rad = math.tau * mission.frequencies_hz[index] * (since_s - index * mission.each_s)
        turn_rad_s = mission.turn_rate_rad_s * math.sin(angle_rad)
        return Guidance(
            velocity_x_m_s=0.0,
            velocity_y_m_s=0.0,
            yaw_rate_rad_s=turn_rad_s - HEADING_GAIN_PER_S * wrap_angle(pose.yaw_rad),
            cross_track_m=0.0,
            finished=False,
        )


HEADING_GAIN_PER_S = 0.3
"""Chosen by hand: far slower than the slowest turns."""
