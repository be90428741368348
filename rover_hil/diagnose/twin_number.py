"""A number of the simulated twin, or why it has none."""

from collections.abc import Mapping
from dataclasses import dataclass

from rover_hil.diagnose.intervals import Interval

DIGITS = 5
"""Of numbers that are written."""
NO_INTERVAL = "a single observation has no interval: give two drives or more"


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinNumber:
    """A number of the twin.

    Attributes:
        name: What it is.
        unit: Of its value for the user; a share is shown in %.
        interval: Its value with its 95 % interval.
        sets: Values of [simulation] by dotted key.
        moves: By how much those change per change of the number, see `FoundNumber`.
    """

    name: str
    unit: str
    interval: Interval
    sets: Mapping[str, object]
    moves: Mapping[str, float]

    @property
    def words(self) -> str:
        """Its value with its interval."""
        shown = self.interval.times(100.0) if self.unit.startswith("%") else self.interval
        return f"{self.name}: {shown.words(self.unit)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """A number that is not written, and why."""

    name: str
    why: str


def rounded(value: float) -> float:
    """Return a number with the digits that are written."""
    return float(f"{value:.{DIGITS}g}")


def single(name: str, unit: str, interval: Interval, key: str) -> TwinNumber | Unknown:
    """Return a number that is one value of [simulation]."""
    if interval.count == 0:
        return Unknown(name=name, why="these drives do not show it")
    if not interval.is_known:
        return Unknown(name=name, why=NO_INTERVAL)
    sets = {key: rounded(interval.value)}
    return TwinNumber(name=name, unit=unit, interval=interval, sets=sets, moves={key: 1.0})
