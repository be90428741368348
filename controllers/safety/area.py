"""The area that the rover must not leave, and by how far a region is over its border."""

import cmath
import math
from functools import lru_cache
from itertools import combinations, pairwise
from operator import itemgetter
from typing import Annotated, Literal, NamedTuple, Self, TypeAlias

from pydantic import Field, model_validator

from controllers.motion.missions.mission import LARGEST_COORDINATE_M, Coordinate, Point
from controllers.motion.rover_geometry import RoverSettings, wheels_reach_m
from controllers.safety.position_region import Region
from drivers.settings import Settings

MOST_POINTS = 100
OUTLINE_POINTS = 72


class Excess(NamedTuple):
    """By how far a region is over a border.

    Attributes:
        over_m: Greatest excess; negative where the region is inside: the distance that is left.
        outward: Direction in which it grows fastest, x + i y of length 1; 0 where that is not known.
        others: The same for each other part of the border that the region is over.
    """

    over_m: float
    outward: complex
    others: tuple[complex, ...] = ()


UNKNOWN = Excess(math.inf, 0j)


class CircleArea(Settings):
    """A circle in the local frame.

    Attributes:
        centre_m: Its centre, x and y.
        radius_m: Its radius.
    """

    type: Literal["circle"]
    centre_m: tuple[Coordinate, Coordinate]
    radius_m: Annotated[float, Field(ge=0.01, le=LARGEST_COORDINATE_M)]

    def excess(self, region: Region) -> Excess:
        """Return by how far a region is over the border."""
        if not region.is_known:
            return UNKNOWN
        farthest = region.to_farthest(complex(*self.centre_m))
        distance_m = abs(farthest)
        return Excess(distance_m + region.body_m - self.radius_m, _unit(farthest))

    def outline(self) -> tuple[Point, ...]:
        """Return the border as a closed line to draw."""
        spokes = (cmath.rect(self.radius_m, math.tau * k / OUTLINE_POINTS) for k in range(OUTLINE_POINTS + 1))
        rim = [complex(*self.centre_m) + spoke for spoke in spokes]
        return tuple((point.real, point.imag) for point in rim)


class PolygonArea(Settings):
    """A polygon in the local frame, convex or not.

    Attributes:
        points_m: Its corners in order, x and y of each; the last one is connected with the first.
    """

    type: Literal["polygon"]
    points_m: Annotated[
        tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=3, max_length=MOST_POINTS)
    ]

    @model_validator(mode="after")
    def _check_shape(self) -> Self:
        conflict = _shape_conflict(self._corners())
        if conflict:
            raise ValueError(conflict)
        return self

    def excess(self, region: Region) -> Excess:
        """Return by how far a region is over the border.

        The sign is exact. Over an edge it is the reach of the region beyond the line of that edge.
        """
        if not region.is_known:
            return UNKNOWN
        edges, is_left = _edges(self.points_m)
        is_inside = _holds(edges, region.centre)
        reach_m = region.longest_m + region.body_m
        parts: list[Excess] = []
        # The nearest edge first: an edge that is farther away than the region reaches has no greater excess.
        for distance_m, start, end in sorted(
            ((abs(region.centre - _foot(region.centre, *edge)), *edge) for edge in edges),
            key=itemgetter(0),
        ):
            if parts and reach_m - distance_m <= min(0.0, max(part.over_m for part in parts)):
                break
            outward = (-1j if is_left else 1j) * _unit(end - start)
            depth_m = _dot(start - region.centre, outward)
            if depth_m >= 0.0:
                parts.append(_over_edge(region, start, end, outward))
            elif is_inside:
                # The border of another part of an area that is not convex.
                parts.append(_over_edge(region, start, end, -outward))
        if not is_inside:
            parts.append(_from_outside(region, edges, is_left=is_left))
        greatest = max(parts, key=lambda part: part.over_m)
        others = (part.outward for part in parts if part is not greatest and part.over_m > 0.0)
        return Excess(greatest.over_m, greatest.outward, tuple(others))

    def outline(self) -> tuple[Point, ...]:
        """Return the border as a closed line to draw."""
        return (*self.points_m, self.points_m[0])

    def _corners(self) -> list[complex]:
        return [complex(*point) for point in self.points_m]


Area: TypeAlias = Annotated[CircleArea | PolygonArea, Field(discriminator="type")]


class AreaSettings(Settings):
    """Where the rover may be.

    Attributes:
        area: The rover must not leave this polygon (3 to 100 points) or circle in the local frame, which
            begins where a run begins; none for no limit. Inside must be the 95 % ellipse of the estimated
            position, enlarged by `area_body_m`. A mission on which the body would leave it is refused.
        area_body_m: Distance of the outermost point of the rover from its origin. Without a value it is that
            of the outermost point of the wheels. `skid_steer_4` does not know where its wheels are and needs
            a value.
    """

    area: Area | None = None
    area_body_m: Annotated[float | None, Field(ge=0.01, le=100.0)] = None

    def body_m(self, rover: RoverSettings) -> float:
        """Return the radius in m of the rover about its origin."""
        return wheels_reach_m(rover) if self.area_body_m is None else self.area_body_m


@lru_cache(maxsize=8)
def _edges(points_m: tuple[Point, ...]) -> tuple[list[tuple[complex, complex]], bool]:
    """Return the edges of a polygon and whether its inside is on their left."""
    corners = [complex(*point) for point in points_m]
    return list(pairwise([*corners, corners[0]])), _signed_area(corners) > 0.0


def _over_edge(region: Region, start: complex, end: complex, normal: complex) -> Excess:
    """Return by how far a region is over an edge, seen from its centre in the direction of a normal.

    Where the ellipse meets the line of the edge it covers a chord of it; where it does not, its tip in the
    direction of the normal is nearest to the line. If that is not beside the edge, an end of the edge is the
    nearest.
    """
    along = 1j * normal
    first_m, last_m = sorted(_dot(point - region.centre, along) for point in (start, end))
    depth_m, reach_m, along_m = (
        _dot(start - region.centre, normal),
        region.extent_m(normal),
        region.extent_m(along),
    )
    tip_m = region.shape(normal, along) / reach_m if reach_m > 0.0 else 0.0
    share = min(1.0, depth_m / reach_m) if reach_m > 0.0 else float(depth_m > 0.0)
    middle_m = share * min(along_m, max(-along_m, tip_m))
    half_m = math.sqrt(max(0.0, (1.0 - share * share) * (along_m * along_m - tip_m * tip_m)))
    if middle_m + half_m >= first_m and middle_m - half_m <= last_m:
        return Excess(reach_m - depth_m + region.body_m, normal)
    nearest = min((region.from_nearest(point) for point in (start, end)), key=abs)
    return Excess(region.body_m - abs(nearest), _unit(nearest))


def _from_outside(region: Region, edges: list[tuple[complex, complex]], *, is_left: bool) -> Excess:
    """Return by how far a region is over the border whose centre is outside."""
    feet = [(_foot(region.centre, start, end), end - start) for start, end in edges]
    foot, edge = min(feet, key=lambda each: abs(region.centre - each[0]))
    distance_m = abs(region.centre - foot)
    outward = _unit(region.centre - foot) if distance_m > 0.0 else (-1j if is_left else 1j) * _unit(edge)
    return Excess(distance_m + region.extent_m(outward) + region.body_m, outward)


def _foot(point: complex, start: complex, end: complex) -> complex:
    """Return the point of an edge that is nearest to a point."""
    edge = end - start
    share = _dot(point - start, edge) / _dot(edge, edge)
    return start + min(1.0, max(0.0, share)) * edge


def _holds(edges: list[tuple[complex, complex]], point: complex) -> bool:
    """Return whether a point is inside: a ray from it crosses the border an odd number of times."""
    is_inside = False
    for start, end in edges:
        if (start.imag > point.imag) is not (end.imag > point.imag):
            share = (point.imag - start.imag) / (end.imag - start.imag)
            is_inside ^= point.real < start.real + share * (end.real - start.real)
    return is_inside


def _shape_conflict(corners: list[complex]) -> str:
    """Return why corners are no polygon, with the fix; empty for a polygon."""
    edges = list(pairwise([*corners, corners[0]]))
    last = len(edges) - 1
    for start, end in edges:
        if start == end:
            return f"points_m: {_name(start)} is there twice in a row: leave it out once"
    if _signed_area(corners) == 0.0:
        return "points_m: they enclose no area: give the corners in their order along the border"
    for (number, edge), (other_number, other) in combinations(enumerate(edges), 2):
        is_next = other_number - number == 1 or (number == 0 and other_number == last)
        if _turn_back(edge, other) if is_next else _touch(edge, other):
            return (
                f"points_m: the line from {_name(edge[0])} to {_name(edge[1])} meets that from "
                f"{_name(other[0])} to {_name(other[1])}: give the corners in their order along the border"
            )
    return ""


def _turn_back(edge: tuple[complex, complex], other: tuple[complex, complex]) -> bool:
    """Return whether one of two edges with a common corner lies on the other."""
    one, two = edge[1] - edge[0], other[1] - other[0]
    return _cross(one, two) == 0.0 and _dot(one, two) < 0.0


def _touch(edge: tuple[complex, complex], other: tuple[complex, complex]) -> bool:
    """Return whether two edges have a common point."""
    if _are_apart(edge, other):
        return False
    return _divides(edge, other) and _divides(other, edge)


def _are_apart(edge: tuple[complex, complex], other: tuple[complex, complex]) -> bool:
    """Return whether one of two edges lies wholly beside, above or below the other."""
    (a, b), (c, d) = edge, other
    return (
        max(a.real, b.real) < min(c.real, d.real)
        or max(c.real, d.real) < min(a.real, b.real)
        or max(a.imag, b.imag) < min(c.imag, d.imag)
        or max(c.imag, d.imag) < min(a.imag, b.imag)
    )


def _divides(edge: tuple[complex, complex], other: tuple[complex, complex]) -> bool:
    """Return whether the ends of another edge are not both on one side of the line of an edge."""
    start, end = edge
    sides = [_cross(end - start, point - start) for point in other]
    return min(sides) <= 0.0 <= max(sides)


def _signed_area(corners: list[complex]) -> float:
    """Return the area in m^2, positive for corners that go counter-clockwise."""
    return 0.5 * sum(_cross(start, end) for start, end in pairwise([*corners, corners[0]]))


def _cross(one: complex, other: complex) -> float:
    return one.real * other.imag - one.imag * other.real


def _dot(one: complex, other: complex) -> float:
    return one.real * other.real + one.imag * other.imag


def _unit(vector: complex) -> complex:
    length = abs(vector)
    return vector / length if length > 0.0 else 0j


def _name(point: complex) -> str:
    return f"{point.real:g}, {point.imag:g} m"
