"""Straight lines from corner to corner: the missions that are such paths, and what steers along them."""

import cmath
import math
from abc import ABC
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar

from pydantic import Field

from controllers.motion.missions.mission import (
    Follower,
    Guidance,
    Leg,
    Mission,
    Mobility,
    NeededMotion,
    Point,
)
from controllers.motion.planar import Pose, wrap_angle
from drivers.clock import seconds

PathLength = Annotated[float, Field(ge=0.05, le=100.0)]
Wait = Annotated[float, Field(ge=0.0, le=3600.0)]
# Chosen by hand.
SLOWEST_SHARE = 0.2
"""Least speed, over that of the mission."""
SPOT_TURN_RAD = 0.5
"""With a greater course error a rover that cannot move sideways turns on the spot."""


class CornersMission(Mission, ABC):
    """A path from corner to corner.

    Attributes:
        repeat: How often the path is driven. A path that does not end where it begins goes back to its first
            point in a straight line; a line goes there and back.
        wait_s: Stop at each corner and at the end for this time.
    """

    has_path: ClassVar[bool] = True

    repeat: Annotated[int, Field(ge=1, le=1000)] = 1
    wait_s: Wait = 0.0

    def follower(self, mobility: Mobility) -> "PathFollower":
        """Return what drives it."""
        return PathFollower(self, mobility)

    def conflicts(self, mobility: Mobility) -> Iterator[str]:
        """Yield why a rover cannot follow it, with the fix."""
        if self.heading == "crab" and mobility.crab_limit_rad == 0.0:
            yield (
                "mission.heading: this rover cannot crab, because not all of its wheels steer to both sides: "
                'give every wheel in rover.wheels a steering, or set heading to "along_path"'
            )
        if self.heading == "hold" and not mobility.moves_sideways:
            yield (
                "mission.heading: this rover cannot move sideways and hold its heading, "
                'set it to "along_path"'
            )
        corners = self.corners()
        # Repetitions repeat their mistakes.
        for start, end in dict.fromkeys(pairwise(corners)):
            if math.dist(start, end) <= self.position_tolerance_m:
                yield (
                    f"mission: the line from {start} to {end} is not longer than position_tolerance_m "
                    f"({self.position_tolerance_m:g}), leave the point out or lower the tolerance"
                )

    def turns_beside_travel(self, mobility: Mobility) -> bool:
        """Return whether the rover turns in place at a corner."""
        if self.heading == "hold" or not mobility.turns_on_spot:
            return False
        corners_m = [complex(*corner) for corner in self.corners()]
        ways_m = [1.0 + 0j, *(end - start for start, end in pairwise(corners_m) if end != start)]
        turns_rad = [abs(cmath.phase(after / before)) for before, after in pairwise(ways_m)]
        return max(turns_rad, default=0.0) > SPOT_TURN_RAD

    def motions(self, mobility: Mobility) -> Iterator[NeededMotion]:
        """Yield the speed of each leg in its direction, and the turns in place or on the tightest arc."""
        legs = dict.fromkeys(zip(pairwise(self.corners()), self.legs(), strict=True))
        needed: dict[NeededMotion, None] = {}
        for line, leg in legs:
            needed.update(dict.fromkeys(self._motions_on(line, leg, mobility)))
        yield from needed
        rate_rad_s = self.yaw_rate_limit_rad_s
        if self.turns_beside_travel(mobility):
            yield NeededMotion(f"mission.yaw_rate_limit_rad_s = {rate_rad_s:g} rad/s", (0.0, 0.0, rate_rad_s))

    def _motions_on(self, line: tuple[Point, Point], leg: Leg, mobility: Mobility) -> Iterator[NeededMotion]:
        key = "speed_m_s" if leg.speed_m_s is None else "speeds_m_s"
        speed_m_s = leg.speed_m_s or self.speed_m_s
        cause = f"mission.{key} = {speed_m_s:g} m/s"
        course_rad = _direction(line) if self.heading == "hold" else 0.0
        crab_rad = mobility.crab_limit_rad if self.heading == "crab" else 0.0
        for angle_rad in dict.fromkeys((course_rad, crab_rad)):
            yield NeededMotion(cause, (speed_m_s * math.cos(angle_rad), speed_m_s * math.sin(angle_rad), 0.0))
        if not mobility.turns_on_spot and mobility.turn_radius_m > 0.0:
            slow_m_s = SLOWEST_SHARE * speed_m_s
            turn_rad_s = min(self.yaw_rate_limit_rad_s, slow_m_s / mobility.turn_radius_m)
            yield NeededMotion(cause, (slow_m_s, 0.0, turn_rad_s))


class PathFollower(Follower[CornersMission]):
    """Follows a path.

    The course points to the line `lookahead_m` ahead, so a deviation decays over that distance at any speed.
    Speed is proportional to the remaining distance to the corner, but not below a fifth: drives with coarse
    steps do not turn at all below one step.
    """

    def __init__(self, mission: CornersMission, mobility: Mobility) -> None:
        super().__init__(mission, mobility)
        self._legs = mission.legs()
        self._lines = list(pairwise(mission.corners()))
        self._index = 0
        self._wait_until_s: float | None = None

    def guide(self, pose: Pose, now_ns: int, drift_rad: float = 0.0) -> Guidance:
        """Return the velocity for `pose`, on the next line where the end of the present one is reached.

        A rover that cannot move sideways is turned against `drift_rad`, one that crabs turns its wheels
        against it.
        """
        cross_m, remaining_m = _locate(pose, self._lines[self._index])
        while remaining_m <= self._mission.position_tolerance_m or self._wait_until_s is not None:
            if self._waits(seconds(now_ns)):
                return Guidance(cross_track_m=cross_m, waits=True)
            if self._index == len(self._lines) - 1:
                return Guidance(cross_track_m=cross_m, finished=True)
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
        mission = self._mission
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
            crab_rad = min(max(crab_rad, -self._mobility.crab_limit_rad), self._mobility.crab_limit_rad)
            if abs(turn_rad) > SPOT_TURN_RAD:
                speed_m_s = 0.0 if self._mobility.turns_on_spot else SLOWEST_SHARE * wanted_m_s
                crab_rad = 0.0
            forward_m_s, sideways_m_s = speed_m_s * math.cos(crab_rad), speed_m_s * math.sin(crab_rad)
            limit_rad_s = self._turn_limit_rad_s(forward_m_s)
        elif self._mobility.moves_sideways:
            facing_rad = 0.0 if mission.heading == "hold" else line_rad
            turn_rad = wrap_angle(facing_rad - pose.yaw_rad)
            forward_m_s = speed_m_s * math.cos(course_error_rad)
            sideways_m_s = speed_m_s * math.sin(course_error_rad)
        else:
            turn_rad, sideways_m_s = wrap_angle(course_error_rad - drift_rad), 0.0
            forward_m_s = speed_m_s * math.cos(course_error_rad)
            if abs(course_error_rad) > SPOT_TURN_RAD:
                forward_m_s = 0.0 if self._mobility.turns_on_spot else SLOWEST_SHARE * wanted_m_s
            limit_rad_s = self._turn_limit_rad_s(forward_m_s)
        return Guidance(
            velocity_x_m_s=forward_m_s,
            velocity_y_m_s=sideways_m_s,
            yaw_rate_rad_s=min(limit_rad_s, max(-limit_rad_s, mission.heading_gain_per_s * turn_rad)),
            cross_track_m=cross_m,
        )

    def _turn_limit_rad_s(self, forward_m_s: float) -> float:
        limit_rad_s = self._mission.yaw_rate_limit_rad_s
        if forward_m_s != 0.0 and self._mobility.turn_radius_m > 0.0:
            return min(limit_rad_s, forward_m_s / self._mobility.turn_radius_m)
        return limit_rad_s


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
