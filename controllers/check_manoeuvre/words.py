"""The result of the check manoeuvre in words: one line for each source, with what to do."""

from dataclasses import dataclass

from controllers.check_manoeuvre.relation import Interval
from controllers.check_manoeuvre.verdict import WITH_WHEELS, Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """A source that was compared with another one.

    Attributes:
        device: The source.
        quantity: "rotation", "position" or "travel".
        against: The other.
        verdict: What the comparison shows.
        is_of_wheels: Whether the source is the wheels.
        is_with_wheels: Whether the other is the wheels.
        is_decided: Whether a third source agrees with the other, or the other cannot be the cause.
        slope: Change of the later one of both over that of the earlier; None where it is not known.
        why: Why it is not known, where that is so.
        unit: Of the motion.
        driven: Motion of the wheels, in this unit.
        needed: Motion that would be needed; None where that is not known.
    """

    device: str
    quantity: str
    against: str
    verdict: Verdict
    slope: Interval | None
    why: str
    unit: str
    driven: float
    is_of_wheels: bool = False
    is_with_wheels: bool = False
    is_decided: bool = False
    needed: float | None = None


def words_of(compared: Compared) -> str:
    """Return the result in one sentence that begins with the device."""
    what = f"{compared.device}: {compared.quantity}"
    other = f"the wheels ({compared.against})" if compared.is_with_wheels else compared.against
    if compared.verdict is Verdict.NOT_COMPARED:
        return f"{what} not compared with {other}: {_why_not_compared(compared)}"
    relation = _RELATIONS[compared.verdict].format(other)
    slope = compared.slope
    if slope is None:
        return f"{what} {relation}{_fix(compared)}"
    of = f" of {compared.against} over the wheels" if compared.is_of_wheels else ""
    interval = f"slope{of} {slope.value:.2f}, 95 % interval {slope.low:.2f} to {slope.high:.2f}"
    return f"{what} {relation}: {interval}{_fix(compared)}"


def _why_not_compared(compared: Compared) -> str:
    if compared.slope is None:
        return compared.why
    low, high = compared.slope.low, compared.slope.high
    needed = compared.needed
    if needed is None:
        half = 0.5 * (high - low)
        needed = compared.driven * max(half / WITH_WHEELS.follows, 1.0)
    return (
        f"its noise leaves {low:.2f} to {high:.2f} times the motion over {compared.driven:.2g} "
        f"{compared.unit}; it needs about {needed:.2g} {compared.unit}"
    )


def _fix(compared: Compared) -> str:
    """Return what explains the result, and what to do."""
    if compared.verdict is Verdict.AGREES:
        return ""
    own, wheels = _OWN[compared.verdict], _WHEELS[compared.verdict]
    if compared.is_of_wheels:
        return f"; {wheels}"
    # Wheels that agree with a third source in rotations may slip ahead.
    shows_slip = compared.verdict in (Verdict.DOES_NOT_FOLLOW, Verdict.SCALE)
    may_slip = shows_slip and compared.quantity != "rotation"
    may_be_wheels = compared.is_with_wheels and (may_slip or not compared.is_decided)
    return f"; {own}, or {wheels}" if may_be_wheels else f"; {own}"


_RELATIONS = {
    Verdict.AGREES: "agrees with {}",
    Verdict.OPPOSITE: "has the opposite sign of {}",
    Verdict.MIRRORED: "is mirrored against {}",
    Verdict.DIRECTION: "has another direction than {}",
    Verdict.SCALE: "has another scale than {}",
    Verdict.DOES_NOT_FOLLOW: "does not follow {}",
}
_OWN = {
    Verdict.OPPOSITE: "correct its sign or mounting (a gyro: `rover-hil calibrate imu`)",
    Verdict.MIRRORED: "correct the sign of one of its axes, or exchange them",
    Verdict.DIRECTION: "correct its yaw or axes",
    Verdict.SCALE: "check its scale and unit (a gyro: `rover-hil calibrate imu`)",
    Verdict.DOES_NOT_FOLLOW: "it has no signal or another axis, check it with `rover-hil doctor`",
}
_WHEELS = {
    Verdict.OPPOSITE: "exchange left and right wheels, or correct their signs",
    Verdict.MIRRORED: "exchange left and right wheels",
    Verdict.DIRECTION: "correct the signs of the wheels",
    Verdict.SCALE: "check radius and track with `rover-hil calibrate wheels`, and the grip of the wheels",
    Verdict.DOES_NOT_FOLLOW: "the wheels have no grip, choose another place",
}
