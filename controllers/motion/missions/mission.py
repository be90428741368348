"""What every mission is: settings that know their path, and a follower that drives it."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Generic, Literal, NamedTuple, Protocol, TypeVar

from pydantic import Field

from controllers.motion.body_motion import BodyMotion
from controllers.motion.planar import Pose
from drivers.errors import ConfigError
from drivers.record import record
from drivers.settings import Settings

LARGEST_COORDINATE_M = 500.0
Coordinate = Annotated[float, Field(ge=-LARGEST_COORDINATE_M, le=LARGEST_COORDINATE_M)]
PathSpeed = Annotated[float, Field(ge=0.005, le=3.0)]
Point = tuple[float, float]
GAIN_UNITS = {
    "speed_m_s": "m/s",
    "lookahead_m": "m",
    "approach_gain_per_s": "1/s",
    "heading_gain_per_s": "1/s",
    "yaw_rate_limit_rad_s": "rad/s",
}
"""The keys of [mission] that may be changed while it is driven, with their units."""
NO_TURN_ON_SPOT = (
    "mission.type: these are turns on the spot, for which the steering of this rover does not reach, "
    "choose another mission"
)


class Leg(NamedTuple):
    """A straight line of a mission.

    Attributes:
        end: Its end, x and y in m.
        speed_m_s: Speed on it; None for that of the mission.
        wait_s: Time to stop at its end.
    """

    end: Point
    speed_m_s: float | None
    wait_s: float


class NeededMotion(NamedTuple):
    """A body velocity that a mission commands for more than moments.

    Attributes:
        cause: Key of the configuration with its value and unit.
        motion: The velocity.
    """

    cause: str
    motion: BodyMotion


class Mobility(Protocol):
    """What the wheels of a rover let it do; the kinematics of a rover have it.

    Attributes:
        moves_sideways: Whether it can move in any direction at any heading.
        turns_on_spot: Whether it can turn without moving forwards.
        turn_radius_m: Least radius of an arc, 0 where every arc is possible.
        crab_limit_rad: Greatest angle, to either side, by which all wheels can be turned together; 0 where
            not all wheels steer.
    """

    moves_sideways: bool
    turns_on_spot: bool
    turn_radius_m: float
    crab_limit_rad: float


@record(frozen=True, slots=True, kw_only=True)
class Guidance:
    """The body velocity that leads along the path.

    Attributes:
        cross_track_m: Distance from the line, positive to its left.
        finished: The end is reached; the velocities are zero.
        waits: The rover stops at a corner; the velocities are zero.
    """

    velocity_x_m_s: float = 0.0
    velocity_y_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0
    cross_track_m: float = 0.0
    finished: bool = False
    waits: bool = False


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
    """

    speed_m_s: PathSpeed = 0.1
    heading: Literal["hold", "along_path", "crab"] = "hold"
    position_tolerance_m: Annotated[float, Field(ge=0.001, le=0.5)] = 0.01
    lookahead_m: Annotated[float, Field(ge=0.02, le=5.0)] = 0.2
    approach_gain_per_s: Annotated[float, Field(ge=0.05, le=10.0)] = 1.5
    heading_gain_per_s: Annotated[float, Field(ge=0.05, le=10.0)] = 2.0
    yaw_rate_limit_rad_s: Annotated[float, Field(ge=0.01, le=5.0)] = 0.5


class Mission(PathSettings, ABC):
    """A mission: its keys, its path and what drives it.

    Attributes:
        has_path: Whether it leads along a path that is known before.
    """

    has_path: ClassVar[bool] = False

    @property
    @abstractmethod
    def title(self) -> str:
        """What is driven, in a few words that begin a sentence."""

    @abstractmethod
    def follower(self, mobility: Mobility) -> "Follower[Mission]":
        """Return what drives it.

        Raises:
            ConfigError: A rover of this mobility cannot follow it.
        """

    @abstractmethod
    def conflicts(self, mobility: Mobility) -> Iterator[str]:
        """Yield why a rover cannot follow it, with the fix."""

    @abstractmethod
    def turns_beside_travel(self, mobility: Mobility) -> bool:
        """Return whether the rover turns in place, or while it moves on sideways."""

    @abstractmethod
    def motions(self, mobility: Mobility) -> Iterator[NeededMotion]:
        """Yield the fastest motions of each kind: straight on, aside, in place, on the tightest arc."""

    def legs(self) -> tuple[Leg, ...]:
        """Return the legs of the path, which begins at (0, 0); one of no length where there is no path."""
        return (Leg((0.0, 0.0), None, 0.0),)

    def corners(self) -> tuple[Point, ...]:
        """Return the corners of the path in m, the start (0, 0) first."""
        return ((0.0, 0.0), *(leg.end for leg in self.legs()))

    @property
    def is_along_x(self) -> bool:
        """Whether the path is on the straight line along x from the start."""
        return self.has_path and all(y_m == 0.0 for _, y_m in self.corners())

    def gains(self) -> tuple[str, ...]:
        """Return the keys that may be changed while it is driven."""
        return tuple(GAIN_UNITS)


class TurnsInPlace(Mission, ABC):
    """A mission of turns on the spot, for which there is nothing to change while it is driven."""

    @property
    @abstractmethod
    def fastest_turn_rad_s(self) -> float:
        """Greatest commanded yaw rate, `turn_rate_rad_s`."""

    def conflicts(self, mobility: Mobility) -> Iterator[str]:
        """Yield why a rover cannot follow it, with the fix."""
        if not mobility.turns_on_spot:
            yield NO_TURN_ON_SPOT

    def turns_beside_travel(self, mobility: Mobility) -> bool:
        """Return True."""
        return True

    def motions(self, mobility: Mobility) -> Iterator[NeededMotion]:
        """Yield the turn."""
        rate_rad_s = self.fastest_turn_rad_s
        yield NeededMotion(f"mission.turn_rate_rad_s = {rate_rad_s:g} rad/s", (0.0, 0.0, rate_rad_s))

    def gains(self) -> tuple[str, ...]:
        """Return that nothing may be changed while it is driven."""
        return ()


MissionT_co = TypeVar("MissionT_co", bound=Mission, covariant=True)


class Follower(ABC, Generic[MissionT_co]):
    """Drives a mission, cycle by cycle.

    Args:
        mission: What to drive.
        mobility: Of the rover.

    Raises:
        ConfigError: A rover of this mobility cannot follow the mission.
    """

    def __init__(self, mission: MissionT_co, mobility: Mobility) -> None:
        for conflict in mission.conflicts(mobility):
            raise ConfigError(conflict)
        self._mission = mission
        self._mobility = mobility

    @abstractmethod
    def guide(self, pose: Pose, now_ns: int, drift_rad: float = 0.0) -> Guidance | None:
        """Return the body velocity for a cycle; None for rest without a path.

        Args:
            pose: Of the rover, by the estimate.
            now_ns: Time of the cycle, from any origin.
            drift_rad: Angle from the direction in which the wheels roll to the course over ground.
        """

    def command(self, now_ns: int, motion: BodyMotion) -> None:
        """Take a body velocity by hand; a mission that is not driven by hand takes none."""

    def change_gains(self, gains: Mapping[str, float]) -> None:
        """Take new values of keys in `mission.gains()`, checked before."""
        self._mission = self._mission.model_copy(update=dict(gains))
