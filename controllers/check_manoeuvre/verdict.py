"""What the relation between two sources means."""

import math
from enum import StrEnum
from typing import NamedTuple

from controllers.check_manoeuvre.relation import Interval, PlaneRelation
from drivers.record import record

SLIP = 0.3
"""Greatest slip of the wheels in a slow manoeuvre on a ground where odometry is of any use."""
DRAG = 0.2
"""Greatest motion of the ground under a dragged wheel beyond that of its rim, as `gyro_drag_share`."""
SCALE = 0.15
"""Coarse error of the scale that each pair of sources may have: radius, track, deviation of a compass."""
SKID = 0.8
"""Greatest slip of wheels that skid in every rotation: on sand they turn three times as far as the rover."""
FOLLOWS = 0.5
"""A source whose slope is below this share of the least sound one does not follow the other."""
DIRECTION_RAD = math.radians(45.0)
"""Greatest difference between directions of travel by sound sources: slip aside, and errors of the yaw."""
MIRRORED = 3.0
"""Mirrored axes are found, or excluded, from so many standard deviations on."""


class Verdict(StrEnum):
    """What a comparison shows."""

    AGREES = "agrees"
    OPPOSITE = "opposite sign"
    MIRRORED = "mirrored axes"
    DIRECTION = "wrong direction"
    SCALE = "wrong scale"
    DOES_NOT_FOLLOW = "does not follow"
    NOT_COMPARED = "not compared"

    @property
    def is_refused(self) -> bool:
        """Whether the run must not start."""
        wrong = (Verdict.OPPOSITE, Verdict.MIRRORED, Verdict.DIRECTION, Verdict.DOES_NOT_FOLLOW)
        return self in wrong


class Range(NamedTuple):
    """Slopes that sound sources may have."""

    least: float
    greatest: float

    @property
    def follows(self) -> float:
        """A source with a smaller slope does not follow the other."""
        return FOLLOWS * self.least


WITH_WHEELS = Range((1.0 - SLIP) * (1.0 - SCALE), (1.0 + DRAG) * (1.0 + SCALE))
"""Of another source over the wheels: 0.595 to 1.38."""
WITH_SKIDDING_WHEELS = Range((1.0 - SKID) * (1.0 - SCALE), WITH_WHEELS.greatest)
"""The same in rotations of a rover that skids: 0.17 to 1.38."""
WITHOUT_WHEELS = Range(1.0 - 2.0 * SCALE, 1.0 + 2.0 * SCALE)
"""Of two sources that do not slip: 0.7 to 1.3."""


@record(frozen=True, slots=True, kw_only=True)
class SourceCheck:
    """Result of the check manoeuvre for one quantity of one source.

    Attributes:
        device: The source.
        quantity: "rotation", "position" or "travel".
        against: Device that it was compared with; empty where there is none.
        verdict: What the comparison shows.
        slope: Change of the source over that of the other; None where it is not known.
        slope_low: Lower end of its 95 % interval; None likewise.
        slope_high: Upper end; None likewise.
        correlation: Of both, -1 to 1; None where it is not known.
        text: The result in words, for the user.
    """

    device: str
    quantity: str
    against: str
    verdict: Verdict
    slope: float | None
    slope_low: float | None
    slope_high: float | None
    correlation: float | None
    text: str


def judge(slope: Interval | None, sound: Range) -> Verdict:
    """Return what a slope means, by its interval.

    Agreement needs an interval above 0 that overlaps the range of sound sources.
    """
    if slope is None or not math.isfinite(slope.low + slope.high):
        return Verdict.NOT_COMPARED
    if slope.high < 0.0 and slope.value < -sound.follows:
        return Verdict.OPPOSITE
    if slope.high < sound.follows:
        return Verdict.DOES_NOT_FOLLOW
    if slope.low <= 0.0:
        return Verdict.NOT_COMPARED
    is_sound = slope.high >= sound.least and slope.low <= sound.greatest
    return Verdict.AGREES if is_sound else Verdict.SCALE


def judge_places(relation: PlaneRelation | None, axes_rad: float, sound: Range) -> Verdict:
    """Return what the relation of positions means; agreement needs axes that are surely not mirrored.

    Args:
        relation: Of the positions to those by the wheels.
        axes_rad: Angle between the axes of both by their yaws; nan where the source measures no yaw.
        sound: Scales that sound sources may have.
    """
    if relation is None:
        return Verdict.NOT_COMPARED
    verdict = judge(relation.scale, sound)
    if verdict not in (Verdict.AGREES, Verdict.SCALE):
        return verdict
    if relation.mirrored_deviations >= MIRRORED:
        return Verdict.MIRRORED
    if relation.mirrored_deviations > -MIRRORED:
        return Verdict.NOT_COMPARED
    if math.isnan(axes_rad) or abs(math.remainder(relation.angle_rad - axes_rad, math.tau)) <= DIRECTION_RAD:
        return verdict
    return Verdict.DIRECTION
