"""Missions as corner points in the local frame."""

from controllers.motion.settings import (
    ByHandMission,
    LineMission,
    MissionSettings,
    RectangleMission,
    SmallTurnsMission,
    WholeTurnsMission,
)

Point = tuple[float, float]


def corner_points(mission: MissionSettings) -> tuple[Point, ...]:
    """Return the corners of the path in m, the start (0, 0) first."""
    start = (0.0, 0.0)
    if isinstance(mission, LineMission):
        return (start, (mission.length_m, 0.0))
    if isinstance(mission, RectangleMission):
        length_m, width_m = mission.length_m, mission.width_m
        return (start, (length_m, 0.0), (length_m, width_m), (0.0, width_m), start)
    if isinstance(mission, SmallTurnsMission | WholeTurnsMission | ByHandMission):
        return (start, start)
    return (start, *mission.points)
