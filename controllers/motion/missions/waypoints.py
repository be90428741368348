"""Straight lines from point to point."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from controllers.motion.missions.mission import Coordinate, Leg, PathSpeed
from controllers.motion.missions.path_following import CornersMission, Wait

MOST_LEGS = 10_000


class WaypointsMission(CornersMission):
    """Straight lines from the start through waypoints in the local frame.

    Attributes:
        points: Corners of the path, x and y in m, without the start (0, 0).
        speeds_m_s: Speed on the way to each point, instead of `speed_m_s`; one for each point, or none.
        waits_s: Stop at each point for this time, instead of `wait_s`; one for each point, or none.
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

    @property
    def title(self) -> str:
        """What is driven, in a few words that begin a sentence."""
        return f"Path through {len(self.points)} points"

    def legs(self) -> tuple[Leg, ...]:
        """Return the legs of the path, which begins at (0, 0)."""
        speeds_m_s = self.speeds_m_s or (None,) * len(self.points)
        waits_s = self.waits_s or (self.wait_s,) * len(self.points)
        return tuple(map(Leg, self.points, speeds_m_s, waits_s)) * self.repeat

    def gains(self) -> tuple[str, ...]:
        """Return the keys that may be changed; no speed where each leg has its own: it would slow nothing."""
        names = super().gains()
        return tuple(name for name in names if name != "speed_m_s") if self.speeds_m_s else names
