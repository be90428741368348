"""Turns the rover on the spot, whole turns in one sense and then as many in the other."""

import math

from controllers.motion.path_following import NO_TURN_ON_SPOT, Guidance
from controllers.motion.planar import Pose, wrap_angle
from controllers.motion.settings import WholeTurnsMission
from drivers.errors import ConfigError

APPROACH_GAIN_PER_S = 1.5
"""Yaw rate per radian that is left of the turns; chosen by hand."""
SLOWEST_SHARE = 0.2
"""Least yaw rate, over that of the mission: drives with coarse steps do not turn below one step."""
TOLERANCE_RAD = 0.02


class WholeTurns:
    """Commands whole turns by the estimated yaw, with a rest before, between and after the two senses.

    Args:
        mission: Number of turns and yaw rate.
        turns_on_spot: Whether the rover can turn without moving forwards.

    Raises:
        ConfigError: The rover cannot turn on the spot.
    """

    def __init__(self, mission: WholeTurnsMission, *, turns_on_spot: bool = True) -> None:
        if not turns_on_spot:
            raise ConfigError(NO_TURN_ON_SPOT)
        self._mission = mission
        turned_rad = math.tau * mission.turns
        targets_rad = {"both": [turned_rad, 0.0], "left": [turned_rad], "right": [-turned_rad]}
        self._targets_rad = targets_rad[mission.senses]
        self._turned_rad = 0.0
        self._yaw_rad: float | None = None
        self._rest_until_s = 0.0

    def guide(self, pose: Pose, t_s: float) -> Guidance:
        """Return the motion for a pose; the first call begins with a rest.

        Args:
            pose: Of the rover.
            t_s: Time of the cycle.
        """
        if self._yaw_rad is None:
            self._rest_until_s = t_s + self._mission.rest_s
        else:
            self._turned_rad += wrap_angle(pose.yaw_rad - self._yaw_rad)
        self._yaw_rad = pose.yaw_rad
        if t_s < self._rest_until_s:
            return _turn(0.0)
        if not self._targets_rad:
            return _turn(0.0, finished=True)
        left_rad = self._targets_rad[0] - self._turned_rad
        if abs(left_rad) <= TOLERANCE_RAD:
            self._targets_rad.pop(0)
            self._rest_until_s = t_s + self._mission.rest_s
            return _turn(0.0)
        fastest = self._mission.turn_rate_rad_s
        rate = min(fastest, max(APPROACH_GAIN_PER_S * abs(left_rad), SLOWEST_SHARE * fastest))
        return _turn(math.copysign(rate, left_rad))


def _turn(yaw_rate_rad_s: float, *, finished: bool = False) -> Guidance:
    return Guidance(
        velocity_x_m_s=0.0,
        velocity_y_m_s=0.0,
        yaw_rate_rad_s=yaw_rate_rad_s,
        cross_track_m=0.0,
        finished=finished,
    )
