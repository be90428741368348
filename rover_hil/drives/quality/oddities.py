"""Data-quality findings of a recorded drive, and what was done about each."""

from collections.abc import Sequence
from dataclasses import dataclass

from controllers.motion.kinematics import Kinematics
from rover_hil.drives.quality.references import LEAST_TURN_RAD

LEFT_OUT = "left out"
REPAIRED = "repaired"
TOLD = "told only"
NOT_SHOWN = "cannot be seen in these data"
NO_FAULT = "no measurement"


@dataclass(frozen=True, slots=True, kw_only=True)
class Oddity:
    """A data-quality finding.

    Attributes:
        what: What it is.
        where: Column, topic, wheel or signal; "" for all of the drive.
        count: How often; None for what these data cannot show.
        done: What became of it.
    """

    what: str
    where: str = ""
    count: int | None = None
    done: str = LEFT_OUT


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What a drive holds that can contradict its wheels.

    Attributes:
        sections: "imu", "truth", "fixes" and others.
        has_own_turn: Whether the turn of the drive is that of the wheels, so that a gyro is another opinion.
        has_both: Whether the wheels have speeds beside their angles.
    """

    sections: frozenset[str]
    has_own_turn: bool = True
    has_both: bool = False


def unseen(kinematics: Kinematics, evidence: Evidence, turned_rad: float) -> list[Oddity]:
    """Return which errors of the wheels nothing in a drive can show.

    Args:
        kinematics: Of the rover.
        evidence: What the drive holds.
        turned_rad: By how much the rover turned to one side, by its wheels.
    """
    held = evidence.sections
    turns = turned_rad >= LEAST_TURN_RAD
    has_place, has_gyro = bool(held & {"truth", "fixes"}), "imu" in held and evidence.has_own_turn
    invisible: list[tuple[str, str]] = []
    if not has_place:
        what = "all wheels reversed, a common factor of them (unit, radius, gear)"
        invisible.append((what, "no truth and no fixes"))
    if "imu" in held and not turns:
        invisible.append(("a gyro with the wrong sign, unit or axis", "the drive hardly turns"))
    if not has_place and not (has_gyro and turns):
        what = (
            "left and right exchanged"
            if _are_redundant(kinematics)
            else "left and right exchanged, one reversed"
        )
        invisible.append((what, "the drive hardly turns" if has_gyro else "no truth and no gyro"))
    if not evidence.has_both:
        factor = "a few percent" if has_gyro else "a factor"
        clock = "the common clock of all sensors" if has_place else "a clock"
        invisible.append((f"{clock} that is wrong by {factor}", "no speeds beside angles"))
    return [Oddity(what=what, where=where, done=NOT_SHOWN) for what, where in invisible]


def _are_redundant(kinematics: Kinematics) -> bool:
    residuals = kinematics.residuals((0.0,) * kinematics.wheel_count)
    return residuals is not None and residuals.redundant > 0


def merged(oddities: Sequence[Oddity]) -> list[Oddity]:
    """Return them with equal ones counted together."""
    counts: dict[tuple[str, str, str], int | None] = {}
    for each in oddities:
        key = (each.what, each.where, each.done)
        before = counts.get(key)
        counts[key] = each.count if before is None or each.count is None else before + each.count
    return [
        Oddity(what=what, where=where, count=count, done=done)
        for (what, where, done), count in counts.items()
    ]
