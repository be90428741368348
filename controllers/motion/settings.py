"""Missions and limits, the sections [mission] and [limits]."""

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from drivers.settings import Settings

PathLength = Annotated[float, Field(ge=0.05, le=100.0)]


LARGEST_COORDINATE_M = 500.0
Coordinate = Annotated[float, Field(ge=-LARGEST_COORDINATE_M, le=LARGEST_COORDINATE_M)]


PathSpeed = Annotated[float, Field(ge=0.005, le=3.0)]
Wait = Annotated[float, Field(ge=0.0, le=3600.0)]
MOST_LEGS = 10_000


class Area(Settings):
    """The free place of the rover, in the local frame: the pose at start is zero, x points forward.

    Attributes:
        x_min_m: Behind the start.
        x_max_m: Ahead of it.
        y_min_m: To its right.
        y_max_m: To its left.
    """

    x_min_m: Coordinate
    x_max_m: Coordinate
    y_min_m: Coordinate
    y_max_m: Coordinate

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.x_min_m >= self.x_max_m or self.y_min_m >= self.y_max_m:
            raise ValueError("the least coordinate is not below the greatest: exchange them")
        return self

    def holds(self, x_m: float, y_m: float) -> bool:
        """Return whether a point is inside."""
        return self.x_min_m <= x_m <= self.x_max_m and self.y_min_m <= y_m <= self.y_max_m


class PathSettings(Settings):
    """How a path is driven; the base of every mission.

    Attributes:
        speed_m_s: Speed along the path away from corners.
        heading: `hold` keeps the heading at the start, `along_path` points along the path. A rover that
            cannot move sideways can only do the latter. `crab` points along the path, too, and turns all
            wheels together against the slip angle, so that the rover stays on the path on a side slope. It
            needs wheels that all steer, and [scomp].
        position_tolerance_m: A corner or the end counts as reached within this distance before it, along the
            path.
        lookahead_m: The rover steers to the point of the path at this distance ahead.
        approach_gain_per_s: Speed per metre of distance to the next corner.
        heading_gain_per_s: Yaw rate per radian of heading error.
        yaw_rate_limit_rad_s: Greatest commanded yaw rate.
        area: Free place. A mission with a corner outside is refused; the rover itself is not watched.
    """

    speed_m_s: PathSpeed = 0.1
    heading: Literal["hold", "along_path", "crab"] = "hold"
    position_tolerance_m: Annotated[float, Field(ge=0.001, le=0.5)] = 0.01
    lookahead_m: Annotated[float, Field(ge=0.02, le=5.0)] = 0.2
    approach_gain_per_s: Annotated[float, Field(ge=0.05, le=10.0)] = 1.5
    heading_gain_per_s: Annotated[float, Field(ge=0.05, le=10.0)] = 2.0
    yaw_rate_limit_rad_s: Annotated[float, Field(ge=0.01, le=5.0)] = 0.5
    area: Area | None = None


class CornersSettings(PathSettings):
    """A path from corner to corner.

    Attributes:
        repeat: How often the path is driven. A path that does not end where it begins goes back to its first
            point in a straight line; a line goes there and back.
        wait_s: Stop at each corner and at the end for this time.
    """

    repeat: Annotated[int, Field(ge=1, le=1000)] = 1
    wait_s: Wait = 0.0


class RectangleMission(CornersSettings):
    """A rectangle once around, counter-clockwise, the first side along x: back to the start.

    Attributes:
        length_m: Side along x.
        width_m: Side along y.
    """

    type: Literal["rectangle"]
    length_m: PathLength
    width_m: PathLength


class LineMission(CornersSettings):
    """A straight line along x.

    Attributes:
        length_m: Length of the line.
    """

    type: Literal["line"]
    length_m: PathLength


class WaypointsMission(CornersSettings):
    """Straight lines from the start through waypoints in the local frame.

    Attributes:
        points: Corners of the path, x and y in m, without the start (0, 0).
        speeds_m_s: Speed on the way to each point, in place of `speed_m_s`; one for each point, or none.
        waits_s: Stop at each point for this time, in place of `wait_s`; one for each point, or none.
    """

    type: Literal["waypoints"]
    points: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=1, max_length=MOST_LEGS)]
    speeds_m_s: Annotated[tuple[PathSpeed, ...], Field(max_length=MOST_LEGS)] = ()
    waits_s: Annotated[tuple[Wait, ...], Field(max_length=MOST_LEGS)] = ()

    @model_validator(mode="after")
    def _check_lengths(self) -> Self:
        for name, values in (("speeds_m_s", self.speeds_m_s), ("waits_s", self.waits_s)):
            if values and len(values) != len(self.points):
                raise ValueError(
                    f"{name} has {len(values)} values for {len(self.points)} points: give one for each"
                )
        if len(self.points) * self.repeat > MOST_LEGS:
            raise ValueError(
                f"{len(self.points)} points {self.repeat} times are more than {MOST_LEGS}: lower repeat"
            )
        return self


class SmallTurnsMission(PathSettings):
    """Small turns to and fro in place, frequency after frequency: identifies the gyro.

    Attributes:
        frequencies_hz: Of the turns, in order.
        each_s: Time for each.
        turn_rate_rad_s: Amplitude of the commanded yaw rate.
    """

    type: Literal["small_turns"]
    frequencies_hz: Annotated[
        tuple[Annotated[float, Field(ge=0.2, le=15.0)], ...], Field(min_length=1, max_length=100)
    ] = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 5.0, 2.0)
    each_s: Annotated[float, Field(ge=1.0, le=60.0)] = 6.0
    turn_rate_rad_s: Annotated[float, Field(ge=0.02, le=2.0)] = 0.35


class WholeTurnsMission(PathSettings):
    """Whole turns on the spot, first counter-clockwise and then as many back: calibrates compass and wheels.

    Attributes:
        turns: Turns in each sense.
        turn_rate_rad_s: Yaw rate.
        rest_s: Rest before the turns, between the two senses, and after them.
        senses: `left` turns counter-clockwise only, `right` clockwise only.
    """

    type: Literal["whole_turns"]
    turns: Annotated[int, Field(ge=1, le=50)] = 3
    turn_rate_rad_s: Annotated[float, Field(ge=0.05, le=2.0)] = 0.4
    rest_s: Annotated[float, Field(ge=0.5, le=60.0)] = 2.0
    senses: Literal["both", "left", "right"] = "both"


class ByHandMission(PathSettings):
    """No path: someone drives by hand on the page of `bench`, within the speed and yaw rate given here."""

    type: Literal["by_hand"]


MissionSettings: TypeAlias = Annotated[
    RectangleMission | LineMission | WaypointsMission | SmallTurnsMission | WholeTurnsMission | ByHandMission,
    Field(discriminator="type"),
]


class LimitSettings(Settings):
    """Limits of the wheel set-points.

    Attributes:
        wheel_speed_rad_s: Greatest set-point, in either direction.
        wheel_acceleration_rad_s2: Greatest change of a set-point per second.
    """

    wheel_speed_rad_s: Annotated[float, Field(ge=0.1, le=200.0)]
    wheel_acceleration_rad_s2: Annotated[float, Field(ge=0.1, le=2000.0)]
