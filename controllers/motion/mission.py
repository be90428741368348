"""Missions as straight legs in the local frame."""

from dataclasses import dataclass

from controllers.motion.settings import (
    ByHandMission,
    LineMission,
    MissionSettings,
    RectangleMission,
    SmallTurnsMission,
    WholeTurnsMission,
)

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight line of a mission.

    Attributes:
        end: Its end, x and y in m.
        speed_m_s: Speed on it; None for that of the mission.
        wait_s: Time to stop at its end.
    """

    end: Point
    speed_m_s: float | None
    wait_s: float


def mission_legs(mission: MissionSettings) -> tuple[Leg, ...]:
    """Return the legs of the path, which begins at (0, 0)."""
    if isinstance(mission, SmallTurnsMission | WholeTurnsMission | ByHandMission):
        return (Leg((0.0, 0.0), None, 0.0),)
    if isinstance(mission, LineMission):
        there, back = (
            Leg((mission.length_m, 0.0), None, mission.wait_s),
            Leg((0.0, 0.0), None, mission.wait_s),
        )
        return ((there, back) * mission.repeat)[:-1]
    if isinstance(mission, RectangleMission):
        length_m, width_m = mission.length_m, mission.width_m
        corners = ((length_m, 0.0), (length_m, width_m), (0.0, width_m), (0.0, 0.0))
        return tuple(Leg(corner, None, mission.wait_s) for corner in corners) * mission.repeat
    speeds_m_s = mission.speeds_m_s or (None,) * len(mission.points)
    waits_s = mission.waits_s or (mission.wait_s,) * len(mission.points)
    return tuple(map(Leg, mission.points, speeds_m_s, waits_s)) * mission.repeat


def corner_points(mission: MissionSettings) -> tuple[Point, ...]:
    """Return the corners of the path in m, the start (0, 0) first."""
    return ((0.0, 0.0), *(leg.end for leg in mission_legs(mission)))
