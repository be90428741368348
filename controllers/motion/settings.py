"""Missions and limits, the sections [mission] and [limits]."""

from typing import Annotated, TypeAlias

from pydantic import Field

from controllers.motion.missions.by_hand import ByHandMission
from controllers.motion.missions.line import LineMission
from controllers.motion.missions.rectangle import RectangleMission
from controllers.motion.missions.small_turns import SmallTurnsMission
from controllers.motion.missions.waypoints import WaypointsMission
from controllers.motion.missions.whole_turns import WholeTurnsMission
from drivers.settings import Settings

__all__ = [
    "ByHandMission",
    "LimitSettings",
    "LineMission",
    "MissionSettings",
    "RectangleMission",
    "SmallTurnsMission",
    "WaypointsMission",
    "WholeTurnsMission",
]

MissionSettings: TypeAlias = Annotated[
    RectangleMission | LineMission | WaypointsMission | SmallTurnsMission | WholeTurnsMission | ByHandMission,
    Field(discriminator="type"),
]


class LimitSettings(Settings):
    """Limits of the wheel setpoints.

    Attributes:
        wheel_speed_rad_s: Greatest setpoint, in either direction.
        wheel_acceleration_rad_s2: Greatest change of a setpoint per second.
    """

    wheel_speed_rad_s: Annotated[float, Field(ge=0.1, le=200.0)]
    wheel_acceleration_rad_s2: Annotated[float, Field(ge=0.1, le=2000.0)]
