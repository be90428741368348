"""Compares the clock of true poses or fixes with that of the wheels: do both tell the same course of time?"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from controllers.motion.kinematics import Kinematics
from drivers.samples import UNKNOWN_YAW_STD_RAD
from rover_hil.datasets.arrays import Array, Times
from rover_hil.datasets.log import LogRows
from rover_hil.recording.findings import FoundFinding

STEP_S = 0.1
"""Of the path of the wheels, and of what the two clocks may be apart."""
GREATEST_OFFSET_S = 1.0
FACTORS = (0.1, *np.round(np.arange(0.97, 1.0301, 0.002), 4).tolist(), 10.0)
"""Seconds of the places over those of the wheels."""
LEAST_WINDOWS, LONGEST_WINDOW_S = 20, 1.0
AGREES = 0.3
"""Residual, as a share of the motion, up to which a clock explains the places."""
BETTER = 0.6
"""Another clock explains the places if it leaves less than this share of the residual."""
LEAST_GAIN = 0.015
"""And by so much of the motion: even motion fits any clock, but for its noise."""
LEAST_SHARE = 0.004
"""A clock is not named that is wrong by less."""


@dataclass(frozen=True, slots=True)
class _Path:
    """Poses along a drive, n.

    Attributes:
        yaw_rad: Unwrapped; None where it is not measured.
    """

    t_s: Array
    x_m: Array
    y_m: Array
    yaw_rad: Array | None

    def steps(self, edges_s: Array) -> tuple[Array, Array]:
        """Return chords and turns between times; turns of zero where the yaw is not measured."""
        x_m, y_m = (np.diff(np.interp(edges_s, self.t_s, values)) for values in (self.x_m, self.y_m))
        if self.yaw_rad is None:
            return np.hypot(x_m, y_m), np.zeros(len(x_m))
        return np.hypot(x_m, y_m), np.diff(np.interp(edges_s, self.t_s, self.yaw_rad))


def wheel_angles(rows: LogRows, wheel: int) -> tuple[Times, Array] | None:
    """Return how far a wheel, from 1, has turned; by its speeds where it has no angle; None without both."""
    readings = rows[f"enc{wheel}_rad"]
    if len(readings) > 1:
        return readings.t_ns, readings.value
    readings = rows[f"speed{wheel}_rad_s"]
    if len(readings) < 2:
        return None
    steps = 0.5 * (readings.value[1:] + readings.value[:-1]) * np.diff(readings.t_ns) / 1e9
    return readings.t_ns, np.concatenate(([0.0], np.cumsum(steps)))


def clock_findings(rows: LogRows, kinematics: Kinematics) -> Iterator[FoundFinding]:
    """Yield true poses and fixes whose clock is wrong by a constant factor against that of the wheels.

    Where the speed of the rover changes, its course by the wheels and by the places fits at one factor only.
    The clocks may begin up to a second apart.

    Args:
        rows: The drive.
        kinematics: Of its wheels.
    """
    wheels = _path_of_wheels(rows, kinematics)
    if wheels is None:
        return
    for name, places in _places(rows):
        factor = min(FACTORS, key=lambda each: _residual(wheels, places, each))
        best = _residual(wheels, places, factor)
        # A part of a drive fits more easily than the whole: both clocks are judged by the same part.
        plain = _residual(wheels, places, 1.0, _span(wheels, places, factor))
        is_better = best <= min(AGREES, BETTER * plain, plain - LEAST_GAIN)
        if is_better and math.isfinite(plain) and abs(factor - 1.0) > LEAST_SHARE:
            share = f"{100.0 * plain:.0f} % of the motion is left, {100.0 * best:.0f} % with it"
            text = (
                f"the clock of the {name} runs {factor:.4g} times as long as that of the wheels, {share}: "
                "correct the unit of one of the two times; this drive cannot tell which"
            )
            yield FoundFinding(name="clock", t_s=None, text=text)


def _places(rows: LogRows) -> Iterator[tuple[str, _Path]]:
    x, y, yaw = (rows[name] for name in ("x_m", "y_m", "psi_rad"))
    if min(map(len, (x, y, yaw))) > 1:
        yield "truth", _Path(x.t_ns / 1e9, x.value, y.value, np.unwrap(yaw.value))
    fixes = rows.fixes()
    if fixes is not None and len(fixes.t_ns) > 1:
        has_yaw = bool((fixes.yaw_sd_rad < UNKNOWN_YAW_STD_RAD).all())
        yield "fixes", _Path(fixes.t_ns / 1e9, fixes.x_m, fixes.y_m, fixes.yaw_rad if has_yaw else None)


def _path_of_wheels(rows: LogRows, kinematics: Kinematics) -> _Path | None:
    """Return the path by the wheels, in steps; None where a wheel is not measured."""
    count = kinematics.wheel_count
    measured = [wheel for wheel in range(count) if wheel not in kinematics.unmeasured]
    known = [found for wheel in measured if (found := wheel_angles(rows, wheel + 1)) is not None]
    if len(known) < len(measured) or not known:
        return None
    begin_ns, end_ns = max(times[0] for times, _ in known), min(times[-1] for times, _ in known)
    edges_ns = np.arange(begin_ns, end_ns, STEP_S * 1e9)
    if len(edges_ns) <= LEAST_WINDOWS:
        return None
    turned = np.zeros((len(edges_ns) - 1, count))
    turned[:, measured] = np.column_stack(
        [np.diff(np.interp(edges_ns, times, angles)) for times, angles in known]
    )
    readings = [rows[f"steer{wheel}_rad"] for wheel in range(1, count + 1)]
    steering = np.zeros_like(turned)
    for wheel, angles in enumerate(readings):
        if len(angles):
            steering[:, wheel] = np.interp(edges_ns[1:], angles.t_ns, angles.value)
    is_steered = any(map(len, readings))
    moves = np.array(
        [
            kinematics.body_motion(row.tolist(), tuple(steering[place]) if is_steered else ())
            for place, row in enumerate(turned)
        ]
    )
    yaw_rad = np.concatenate(([0.0], np.cumsum(moves[:, 2])))
    along = (moves[:, 0] + 1j * moves[:, 1]) * np.exp(1j * 0.5 * (yaw_rad[1:] + yaw_rad[:-1]))
    place_m = np.concatenate(([0j], np.cumsum(along)))
    return _Path(edges_ns / 1e9, place_m.real, place_m.imag, yaw_rad)


def _span(wheels: _Path, places: _Path, factor: float, offset_s: float = 0.0) -> tuple[float, float]:
    """Return the first and the last time of the wheels at which both are known."""
    start_s = wheels.t_s[0]
    first_s, last_s = (
        float(start_s + (each_s - start_s) / factor + offset_s) for each_s in (places.t_s[0], places.t_s[-1])
    )
    return max(float(start_s), first_s), min(float(wheels.t_s[-1]), last_s)


def _residual(
    wheels: _Path, places: _Path, factor: float, within_s: tuple[float, float] = (-math.inf, math.inf)
) -> float:
    """Return the share of the motion that a clock leaves, at its best beginning; infinite without enough."""
    found = math.inf
    start_s = wheels.t_s[0]
    for offset_s in np.arange(-GREATEST_OFFSET_S, GREATEST_OFFSET_S + 0.5 * STEP_S, STEP_S).tolist():
        begin_s, end_s = _span(wheels, places, factor, offset_s)
        begin_s, end_s = max(begin_s, within_s[0]), min(end_s, within_s[1])
        window_s = min(LONGEST_WINDOW_S, (end_s - begin_s) / LEAST_WINDOWS)
        if window_s < STEP_S:
            continue
        edges_s = np.arange(begin_s, end_s, window_s)
        said_m, said_rad = wheels.steps(edges_s)
        true_m, true_rad = places.steps(start_s + factor * (edges_s - start_s - offset_s))
        pairs = [(said_m, true_m)] if places.yaw_rad is None else [(said_m, true_m), (said_rad, true_rad)]
        left = [_left(own, true) for own, true in pairs]
        found = min(found, math.sqrt(sum(left) / len(left)))
    return found


def _left(own: Array, true: Array) -> float:
    """Return the square of the share of the motion that a common factor leaves."""
    square, seen = float(own @ own), float(true @ true)
    if square <= 0.0 or seen <= 0.0:
        return 1.0
    return max(0.0, 1.0 - float(own @ true) ** 2 / (square * seen))
