"""The slip angle against which a rover that crabs turns its wheels."""

import math
from dataclasses import dataclass
from enum import StrEnum

from drivers.clock import seconds

DRIFT_TIME_S = 1.0
"""Time constant; chosen by hand: shorter, and the wheels follow the noise of the trace."""


class DriftSource(StrEnum):
    """What the slip angle comes from: the first of these that is there.

    TRACE: trace of the rear wheel or motion of the ground, not older than `trace_age_s`, and the tilt.
    TILT: the tilt alone, by the gain that the trace has taught so far.
    NONE: neither; the slip angle fades to zero.
    """

    TRACE = "trace"
    TILT = "tilt"
    NONE = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class CrabReport:
    """Slip angle against which the wheels are turned.

    Attributes:
        drift_rad: Angle of the velocity from the direction in which the wheels roll, left positive, smoothed.
        source: What it comes from.
    """

    drift_rad: float
    source: DriftSource


class CrabDrift:
    """A first-order low-pass on the slip angle of the wheels.

    It begins with the first value: on a side slope the wheels are turned before the rover moves.

    Attributes:
        report: Of the last value; None before the first.
    """

    def __init__(self) -> None:
        self._t_ns: int | None = None
        self.report: CrabReport | None = None

    def take(self, now_ns: int, drift_rad: float, source: DriftSource) -> float:
        """Take a slip angle; return the smoothed one."""
        smooth_rad = drift_rad
        if self.report is not None and self._t_ns is not None:
            share = -math.expm1(-seconds(now_ns - self._t_ns) / DRIFT_TIME_S)
            smooth_rad = self.report.drift_rad + share * (drift_rad - self.report.drift_rad)
        self._t_ns = now_ns
        self.report = CrabReport(drift_rad=smooth_rad, source=source)
        return smooth_rad
