"""Compares the clocks of ground truth, positions, gyro and steering with that of the wheels."""

import math
from collections.abc import Callable, Iterator

import numpy as np

from controllers.motion.kinematics import Kinematics
from rover_hil.drives.arrays import Array
from rover_hil.drives.channels import Channels
from rover_hil.drives.quality.drive_paths import (
    STEP_S,
    DrivePath,
    path_of_gyro,
    path_of_wheels,
    places_of,
)
from rover_hil.recording.findings import FoundFinding

CLOCK = "clock"
"""Name of the findings."""
GREATEST_OFFSET_S = 1.0
FACTORS = (0.1, *np.round(np.arange(0.97, 1.0301, 0.002), 4).tolist(), 10.0)
"""Seconds of the places over those of the wheels."""
LEAST_WINDOWS, LONGEST_WINDOW_S = 20, 1.0
AGREES = 0.3
"""Residual, as a share of the motion, up to which a clock explains the places."""
BETTER = 0.4
"""Another clock explains the places if it leaves less than this share of the residual."""
LEAST_GAIN = 0.015
"""And by so much of the motion: even motion fits any clock, but for its noise."""
FAR = 2.0
SCALES = (0.8, 1.25)
"""With a clock that is wrong by so much or more, wheels and places must go equally far: a part of an even
drive fits any clock, with another scale."""
FARTHEST_S, FAR_STEP_S = 60.0, 0.5
"""Offsets that are looked for, as of leap seconds."""
LEAST_OFFSET_S = 0.2
"""Two steps of the path; a smaller offset is not named."""
BETTER_STEERING = 0.8
"""Late steering explains more than late places if it leaves less than this share of their residual."""
LEAST_COMMON = 0.5
"""Share of the drive that both clocks must cover."""
LEAST_SHARE = 0.004
"""A clock is not named that is wrong by less."""


def clock_findings(
    rows: Channels, kinematics: Kinematics, wheels: DrivePath | None
) -> Iterator[FoundFinding]:
    """Yield ground truth, positions, gyro and steering whose clock is not that of the wheels.

    Where the speed of the rover changes, its course by the wheels and by another source fits at one factor
    and one offset only.

    Args:
        rows: The drive.
        kinematics: Of the wheels.
        wheels: Path of the drive by the wheels; None where that is not known.
    """
    if wheels is None:
        return
    gyro = path_of_gyro(rows)
    for name, places in [*places_of(rows), *([] if gyro is None else [("gyro", gyro)])]:
        factor = 1.0 if name == "gyro" else min(FACTORS, key=lambda each: _residual(wheels, places, each))
        best = _residual(wheels, places, factor)
        # A part of a drive fits more easily than the whole: both clocks are judged by the same part.
        plain = _residual(wheels, places, 1.0, _span(wheels, places, factor))
        is_better = best <= min(AGREES, BETTER * plain, plain - LEAST_GAIN)
        if is_better and math.isfinite(plain) and abs(factor - 1.0) > LEAST_SHARE:
            share = f"{100.0 * plain:.0f} % of the motion is left, {100.0 * best:.0f} % with it"
            text = (
                f"the clock of the {name} runs {factor:.4g} times as long as that of the wheels, {share}: "
                "correct the unit or the rate of one of the two times; this drive does not show which"
            )
            yield FoundFinding(name=CLOCK, t_s=None, text=text, harm=math.sqrt(plain**2 - best**2))
            return
        text, harm = _offset_fault(
            name, wheels, places, lambda late_s: path_of_wheels(rows, kinematics, late_s)
        )
        if text:
            yield FoundFinding(name=CLOCK, t_s=None, text=text, harm=harm)
            return


def _offset_fault(
    name: str, wheels: DrivePath, places: DrivePath, steered: Callable[[float], DrivePath | None]
) -> tuple[str, float]:
    """Return by how much the times of the places are early or late, where the motion shows it, and the harm.

    Args:
        name: Of the places.
        wheels: Path by the wheels.
        places: The same by the places.
        steered: Returns the path by the wheels with steering angles that are late by so many seconds; None
            where none steers.
    """
    near_s = np.arange(-GREATEST_OFFSET_S, GREATEST_OFFSET_S + 0.5 * STEP_S, STEP_S)
    far_s = np.arange(-FARTHEST_S, FARTHEST_S + 0.5 * FAR_STEP_S, FAR_STEP_S)
    least_s = LEAST_COMMON * float(wheels.t_s[-1] - wheels.t_s[0])

    def left(offset_s: float) -> float:
        begin_s, end_s = _span(wheels, places, 1.0, offset_s)
        return (
            _residual_at(wheels, places, 1.0, offset_s, (begin_s, end_s))
            if end_s - begin_s > least_s
            else math.inf
        )

    offset_s = min([*near_s.tolist(), *far_s.tolist()], key=left)
    if abs(offset_s) > GREATEST_OFFSET_S:
        offset_s = min((offset_s + near_s).tolist(), key=left)
    best, plain = left(offset_s), left(0.0)
    # An even drive, or one that repeats itself, fits at many offsets.
    others = min(left(each) for each in far_s.tolist() if abs(each - offset_s) > GREATEST_OFFSET_S)
    is_shown = math.isfinite(plain) and best <= min(AGREES, BETTER * plain, BETTER * others)
    if abs(offset_s) < LEAST_OFFSET_S or not is_shown:
        return "", 0.0
    harm = math.sqrt(plain**2 - best**2)
    if text := _late_steering(name, places, steered, plain, best):
        return text, harm
    side = "late" if offset_s < 0.0 else "early"
    return (
        f"the times of the {name} are {abs(offset_s):.1f} s {side} against the wheels, {100.0 * plain:.0f} % "
        f"of the motion is left, {100.0 * best:.0f} % without it: correct the clock of one of the two"
    ), harm


def _late_steering(
    name: str, places: DrivePath, steered: Callable[[float], DrivePath | None], plain: float, best: float
) -> str:
    """Return by how much the steering is late or early, where that explains more than late places."""
    offsets_s = np.arange(-GREATEST_OFFSET_S, GREATEST_OFFSET_S + 0.5 * STEP_S, STEP_S).tolist()
    left: dict[float, float] = {}
    for offset_s in offsets_s:
        path = steered(offset_s)
        if path is None:
            return ""
        left[offset_s] = _residual_at(path, places, 1.0, 0.0, _span(path, places, 1.0))
    late_s = min(left, key=lambda each: left[each])
    if left[late_s] > BETTER_STEERING * best or abs(late_s) < LEAST_OFFSET_S:
        return ""
    side = "late" if late_s > 0.0 else "early"
    return (
        f"the times of the steering angles are {abs(late_s):.1f} s {side} against wheels and {name}, "
        f"{100.0 * plain:.0f} % of the motion is left, {100.0 * left[late_s]:.0f} % without it: correct the "
        "clock of the steering"
    )


def _span(wheels: DrivePath, places: DrivePath, factor: float, offset_s: float = 0.0) -> tuple[float, float]:
    """Return the first and the last time of the wheels at which both are known."""
    start_s = wheels.t_s[0]
    first_s, last_s = (
        float(start_s + (each_s - start_s) / factor + offset_s) for each_s in (places.t_s[0], places.t_s[-1])
    )
    return max(float(start_s), first_s), min(float(wheels.t_s[-1]), last_s)


def _residual(
    wheels: DrivePath, places: DrivePath, factor: float, within_s: tuple[float, float] = (-math.inf, math.inf)
) -> float:
    """Return the share of the motion that a clock leaves, at its best beginning; infinite without enough."""
    offsets_s = np.arange(-GREATEST_OFFSET_S, GREATEST_OFFSET_S + 0.5 * STEP_S, STEP_S).tolist()
    return min(_residual_at(wheels, places, factor, offset_s, within_s) for offset_s in offsets_s)


def _residual_at(
    wheels: DrivePath, places: DrivePath, factor: float, offset_s: float, within_s: tuple[float, float]
) -> float:
    """Return the share of the motion that a clock with a beginning leaves; infinite without enough."""
    start_s = wheels.t_s[0]
    begin_s, end_s = _span(wheels, places, factor, offset_s)
    begin_s, end_s = max(begin_s, within_s[0]), min(end_s, within_s[1])
    window_s = min(LONGEST_WINDOW_S, (end_s - begin_s) / LEAST_WINDOWS)
    if window_s < STEP_S:
        return math.inf
    edges_s = np.arange(begin_s, end_s, window_s)
    said_m, said_rad = wheels.steps(edges_s)
    true_m, true_rad = places.steps(start_s + factor * (edges_s - start_s - offset_s))
    pairs = [(said_m, true_m)] if places.yaw_rad is None else [(said_m, true_m), (said_rad, true_rad)]
    scale = true_m.sum() / max(float(said_m.sum()), 1e-9)
    if true_m.any() and max(factor, 1.0 / factor) >= FAR and not SCALES[0] <= scale <= SCALES[1]:
        return math.inf
    residuals = [_left(own, true) for own, true in pairs if true.any()]
    if not residuals:
        return math.inf
    return math.sqrt(sum(residuals) / len(residuals))


def _left(own: Array, true: Array) -> float:
    """Return the square of the share of the motion that a common factor leaves."""
    square, seen = float(own @ own), float(true @ true)
    if square <= 0.0 or seen <= 0.0:
        return 1.0
    return max(0.0, 1.0 - float(own @ true) ** 2 / (square * seen))
