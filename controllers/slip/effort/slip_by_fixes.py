"""Slip of the rover between two pose fixes."""

import bisect
import cmath
import math
from collections import deque
from typing import NamedTuple

from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.slip.effort.parameters import EFFORT
from drivers.clock import nanoseconds
from drivers.samples import PoseFixSample


class _Moved(NamedTuple):
    """What the wheels have done until a time.

    Attributes:
        place_m: Position by the wheels, x + i y.
        work_j: Known work of the wheels.
        unknown: Number of cycles whose work is unknown.
        yaw_rad: By gyro or wheels, since any time.
    """

    t_ns: int
    place_m: complex
    distance_m: float
    work_j: float
    unknown: int
    yaw_rad: float


class SlipAtForce(NamedTuple):
    """Slip ratio of the rover, and the drive force during it.

    Attributes:
        force_n: Mean drive force; None where it was not known all the time.
        slip: Slip ratio.
        slip_sd: Its standard deviation, by the noise of the fixes.
        from_ns: Begin of the travel.
        to_ns: Its end.
        travel_m: Its length, by the wheels.
        drift_rad: Angle from the course of the wheels to the true one, left positive; None where unknown.
    """

    force_n: float | None
    slip: float
    slip_sd: float
    from_ns: int
    to_ns: int
    travel_m: float
    drift_rad: float | None = None


class SlipByFixes:
    """Compares the distance between two pose fixes with that of the wheels.

    Only straight travel is used, whose length does not depend on the heading, and only as much of it as makes
    the noise of the fixes small.
    """

    def __init__(self) -> None:
        self._past: deque[_Moved] = deque(maxlen=EFFORT.fixes.most_cycles)
        self._yaw_rad = 0.0
        # By device: each has a floor frame of its own.
        self._last: dict[str, tuple[_Moved, PoseFixSample]] = {}

    def move(self, t_ns: int, increment: BodyIncrement, turn_rad: float, work_j: float | None) -> None:
        """Take the motion and the work of the wheels in one cycle; after a gap the comparison begins anew.

        Args:
            t_ns: Time at its end.
            increment: Without regard to slip.
            turn_rad: Turn of the body.
            work_j: None where it is unknown.
        """
        start_ns = t_ns - nanoseconds(increment.duration_s)
        # Durations are rounded to less than a microsecond.
        if not self._past or abs(self._past[-1].t_ns - start_ns) > 1000:
            self._past.clear()
            self._past.append(_Moved(start_ns, 0j, 0.0, 0.0, 0, self._yaw_rad))
            self._last.clear()
        last = self._past[-1]
        moved_m = complex(increment.x_m, increment.y_m)
        step_m = moved_m * cmath.exp(1j * (self._yaw_rad + 0.5 * turn_rad))
        self._yaw_rad += turn_rad
        self._past.append(
            _Moved(
                t_ns=t_ns,
                place_m=last.place_m + step_m,
                distance_m=last.distance_m + abs(step_m),
                work_j=last.work_j + (work_j or 0.0),
                unknown=last.unknown + (work_j is None),
                yaw_rad=self._yaw_rad,
            )
        )

    def take(self, fix: PoseFixSample) -> SlipAtForce | None:
        """Take a fix; return the slip since an earlier one of its device, None where undetermined."""
        numbers = EFFORT.fixes
        # A fix that the pose filter would not take must not teach, either.
        if not math.isfinite(fix.x_m + fix.y_m + fix.yaw_rad) or not 0.0 < fix.position_std_m < math.inf:
            return None
        moved = self._at(min(fix.t_capture_ns, fix.t_ns))
        if moved is None:
            return None
        before, fix_before = self._last.setdefault(fix.device, (moved, fix))
        distance_m = moved.distance_m - before.distance_m
        noise = math.sqrt(2.0) * fix.position_std_m
        if distance_m < noise / numbers.greatest_sd:
            return None
        self._last[fix.device] = (moved, fix)
        straight_m = abs(moved.place_m - before.place_m)
        if straight_m < numbers.straightness * distance_m:
            return None
        fixed_m = complex(fix.x_m - fix_before.x_m, fix.y_m - fix_before.y_m)
        slip = 1.0 - math.hypot(fixed_m.real, fixed_m.imag) / straight_m
        beyond = numbers.deviations * numbers.greatest_sd
        if not -beyond <= slip <= 1.0 + beyond:
            return None
        force_n = (moved.work_j - before.work_j) / distance_m
        return SlipAtForce(
            force_n=None if moved.unknown > before.unknown else force_n,
            slip=min(max(slip, 0.0), 1.0),
            slip_sd=noise / straight_m,
            from_ns=before.t_ns,
            to_ns=moved.t_ns,
            travel_m=distance_m,
            drift_rad=_drift_rad(before, moved, fix_before, fixed_m),
        )

    def _at(self, t_ns: int) -> _Moved | None:
        """Return the motion at the first cycle at or after a time; None outside what is remembered."""
        index = bisect.bisect_left(self._past, t_ns, key=lambda one: one.t_ns)
        return self._past[index] if 0 < index < len(self._past) else None


def _drift_rad(before: _Moved, moved: _Moved, fix: PoseFixSample, fixed_m: complex) -> float | None:
    """Return the angle from the course of the wheels to that of the fixes; both seen from the first yaw."""
    least_m = EFFORT.fixes.deviations * math.sqrt(2.0) * fix.position_std_m
    if not 0.0 <= fix.yaw_std_rad <= EFFORT.fixes.yaw_sd_rad or abs(fixed_m) < least_m:
        return None
    rolled_m = (moved.place_m - before.place_m) * cmath.rect(1.0, -before.yaw_rad)
    return cmath.phase(fixed_m * cmath.rect(1.0, -fix.yaw_rad) / rolled_m)
