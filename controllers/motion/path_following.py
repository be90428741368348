"""Steers along straight lines from corner to corner."""

import math
from collections.abc import Iterator
from itertools import pairwise

from controllers.motion.mission import Point, corner_points, mission_legs
from controllers.motion.planar import Pose, wrap_angle
from controllers.motion.settings import (
    ByHandMission,
    MissionSettings,
    SmallTurnsMission,
    WholeTurnsMission,
)
from drivers.errors import ConfigError
from drivers.record import record

NO_TURN_ON_SPOT = (
    "mission.type: these are turns on the spot, for which the steering of this rover does not reach, "
    "choose another mission"
)
# Chosen by hand.
SLOWEST_SHARE = 0.2
"""Least speed, over that of the mission."""
SPOT_TURN_RAD = 0.5
"""With a greater course error a rover that cannot move sideways turns on the spot."""


@record(frozen=True, slots=True, kw_only=True)
class Guidance:
    """The body velocity that leads along the path.

    Attributes:
        cross_track_m: Distance from the line, positive to its left.
        finished: The end is reached; the velocities are zero.
        waits: The rover stops at a corner; the velocities are zero.
    """

    velocity_x_m_s: float
    velocity_y_m_s: float
    yaw_rate_rad_s: float
    cross_track_m: float
    finished: bool
    waits: bool = False


class PathFollower:
    """Follows a mission.

    The course points to the line `lookahead_m` ahead, so a deviation decays over that distance at any speed.
    Speed is proportional to the remaining distance to the corner, but not below a fifth: drives with coarse
    steps do not turn at all below one step.

    Args:
        mission: Path, speed and gains.
        moves_sideways: Whether the rover can move in any direction at any heading.
        turns_on_spot: Whether it can turn without moving forwards.
        turn_radius_m: Least radius of an arc that it can drive.
        crab_limit_rad: Greatest angle by which all wheels can be turned together, 0 where they cannot.

    Raises:
        ConfigError: The rover cannot move sideways but the mission holds its heading, it cannot crab but the
            mission crabs, or two corners are within the position tolerance of each other.

    Attributes:
        mission: As given; speed and gains may be changed on the way, the path may not.
    """

    def __init__(
        self,
        mission: MissionSettings,
        moves_sideways: bool,
        *,
        turns_on_spot: bool = True,
        turn_radius_m: float = 0.0,
        crab_limit_rad: float = 0.0,
    ) -> None:
        for conflict in find_mission_conflicts(
            mission, moves_sideways, turns_on_spot=turns_on_spot, crab_limit_rad=crab_limit_rad
        ):
            raise ConfigError(conflict)
        self.mission = mission
        self._moves_sideways = moves_sideways
        self._turns_on_spot = turns_on_spot
        self._turn_radius_m = turn_radius_m
        self._crab_limit_rad = crab_limit_rad
        self._legs = mission_legs(mission)
        self._lines = list(pairwise(corner_points(mission)))
        self._index = 0
        self._wait_until_s: float | None = None

    def guide(self, pose: Pose, drift_rad: float = 0.0, now_s: float = 0.0) -> Guidance:
        """Return the velocity for `pose`, on the next line where the end of the present one is reached.

        Args:
            pose: Of the rover.
            drift_rad: Angle from the direction in which the wheels roll to the course over ground; a rover
                that cannot move sideways is turned against it, one that crabs turns its wheels against it.
            now_s: Time, from any origin, for the stops at corners.
        """
        cross_m, remaining_m = _locate(pose, self._lines[self._index])
        while remaining_m <= self.mission.position_tolerance_m or self._wait_until_s is not None:
            if self._waits(now_s):
                return _at_rest(cross_m, finished=False)
            if self._index == len(self._lines) - 1:
                return _at_rest(cross_m, finished=True)
            self._index += 1
            cross_m, remaining_m = _locate(pose, self._lines[self._index])
        return self._steer(pose, drift_rad, cross_m, remaining_m)

    def _waits(self, now_s: float) -> bool:
        """Return whether the rover stops at the end of the present line."""
        wait_s = self._legs[self._index].wait_s
        if self._wait_until_s is None and wait_s > 0.0:
            self._wait_until_s = now_s + wait_s
        if self._wait_until_s is None or now_s >= self._wait_until_s:
            self._wait_until_s = None
            return False
        return True

    def _steer(self, pose: Pose, drift_rad: float, cross_m: float, remaining_m: float) -> Guidance:
        mission = self.mission
        line_rad = _direction(self._lines[self._index])
        course_rad = line_rad - math.atan2(cross_m, mission.lookahead_m)
        wanted_m_s = self._legs[self._index].speed_m_s or mission.speed_m_s
        speed_m_s = min(
            wanted_m_s, max(mission.approach_gain_per_s * remaining_m, SLOWEST_SHARE * wanted_m_s)
        )
        course_error_rad = wrap_angle(course_rad - pose.yaw_rad)
        limit_rad_s = mission.yaw_rate_limit_rad_s
        if mission.heading == "crab":
            turn_rad = wrap_angle(line_rad - pose.yaw_rad)
            crab_rad = wrap_angle(course_error_rad - drift_rad)
            crab_rad = min(max(crab_rad, -self._crab_limit_rad), self._crab_limit_rad)
            if abs(turn_rad) > SPOT_TURN_RAD:
                speed_m_s = 0.0 if self._turns_on_spot else SLOWEST_SHARE * wanted_m_s
                crab_rad = 0.0
            forward_m_s, sideways_m_s = speed_m_s * math.cos(crab_rad), speed_m_s * math.sin(crab_rad)
            limit_rad_s = self._turn_limit_rad_s(forward_m_s)
        elif self._moves_sideways:
            facing_rad = 0.0 if mission.heading == "hold" else line_rad
            turn_rad = wrap_angle(facing_rad - pose.yaw_rad)
            forward_m_s = speed_m_s * math.cos(course_error_rad)
            sideways_m_s = speed_m_s * math.sin(course_error_rad)
        else:
            turn_rad, sideways_m_s = wrap_angle(course_error_rad - drift_rad), 0.0
            forward_m_s = speed_m_s * math.cos(course_error_rad)
            if abs(course_error_rad) > SPOT_TURN_RAD:
                forward_m_s = 0.0 if self._turns_on_spot else SLOWEST_SHARE * wanted_m_s
            limit_rad_s = self._turn_limit_rad_s(forward_m_s)
        return Guidance(
            velocity_x_m_s=forward_m_s,
            velocity_y_m_s=sideways_m_s,
            yaw_rate_rad_s=min(limit_rad_s, max(-limit_rad_s, mission.heading_gain_per_s * turn_rad)),
            cross_track_m=cross_m,
            finished=False,
        )

    def _turn_limit_rad_s(self, forward_m_s: float) -> float:
        limit_rad_s = self.mission.yaw_rate_limit_rad_s
        if forward_m_s != 0.0 and self._turn_radius_m > 0.0:
            return min(limit_rad_s, forward_m_s / self._turn_radius_m)
        return limit_rad_s


def find_mission_conflicts(
    mission: MissionSettings, moves_sideways: bool, *, turns_on_spot: bool, crab_limit_rad: float = 0.0
) -> Iterator[str]:
    """Yield why a rover cannot follow a mission, with the fix.

    Args:
        mission: Path, speed and gains.
        moves_sideways: Whether the rover can move in any direction at any heading.
        turns_on_spot: Whether it can turn without moving forwards.
        crab_limit_rad: Greatest angle by which all wheels can be turned together, 0 where they cannot.
    """
    if isinstance(mission, ByHandMission):
        return
    if mission.heading == "crab" and crab_limit_rad == 0.0:
        yield (
            "mission.heading: this rover cannot crab, because not all of its wheels steer to both sides: "
            'give every wheel in rover.wheels a steering, or set heading to "along_path"'
        )
    if mission.heading == "hold" and not moves_sideways:
        yield 'mission.heading: this rover cannot move sideways and hold its heading, set it to "along_path"'
    if isinstance(mission, SmallTurnsMission | WholeTurnsMission):
        if not turns_on_spot:
            yield NO_TURN_ON_SPOT
        return
    corners = corner_points(mission)
    # Repetitions repeat their mistakes.
    for start, end in dict.fromkeys(pairwise(corners)):
        if math.dist(start, end) <= mission.position_tolerance_m:
            yield (
                f"mission: the line from {start} to {end} is not longer than position_tolerance_m "
                f"({mission.position_tolerance_m:g}), leave the point out or lower the tolerance"
            )
    area = mission.area
    outside = [] if area is None else [point for point in dict.fromkeys(corners) if not area.holds(*point)]
    if outside and area is not None:
        x_m, y_m = outside[0]
        yield (
            f"mission: the way-point at {x_m:g}, {y_m:g} m is outside mission.area, x {area.x_min_m:g} to "
            f"{area.x_max_m:g} m and y {area.y_min_m:g} to {area.y_max_m:g} m: move it, or correct the area"
        )


def _at_rest(cross_m: float, *, finished: bool) -> Guidance:
    return Guidance(
        velocity_x_m_s=0.0,
        velocity_y_m_s=0.0,
        yaw_rate_rad_s=0.0,
        cross_track_m=cross_m,
        finished=finished,
        waits=not finished,
    )


def _direction(line: tuple[Point, Point]) -> float:
    (start_x, start_y), (end_x, end_y) = line
    return math.atan2(end_y - start_y, end_x - start_x)


def _locate(pose: Pose, line: tuple[Point, Point]) -> tuple[float, float]:
    """Return the distance to the left of the line and the remaining distance along it."""
    (start_x, start_y), (end_x, end_y) = line
    length_m = math.dist(*line)
    unit_x, unit_y = (end_x - start_x) / length_m, (end_y - start_y) / length_m
    cross_m = unit_x * (pose.y_m - start_y) - unit_y * (pose.x_m - start_x)
    return cross_m, unit_x * (end_x - pose.x_m) + unit_y * (end_y - pose.y_m)
