"""Scores of measured motion.

- Window: consecutive pairs over 0.5 m of reported wheel travel. Its slip is 1 - ground travel / wheel
  travel over its valid pairs, compared with the true slip of the whole window. It is valid with at least 80
  % of its wheel travel in valid pairs; rms, 95 % and greatest error are of the valid windows.
- Bias: mean error of the valid windows of a drive; of several drives, the largest.
- Distance: travel over 2 m of true travel, or over a drive from 0.8 m on. Sideways: travel to the left over
  0.5 m of true travel, rms.
- Within two standard deviations: error forward over a length of wheel travel, against `hypot(scale_sd *
  travel, root of the sum of squares of the pairs)`.
- Standstill: the rover moves less than 0.3 mm in a pair. Reported as motion: more than 0.6 mm and 10 % of
  the wheels' travel.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchmarks.ground_motion.measured import Floats, Pairs

WINDOW_M = 0.5
LEAST_MEASURED = 0.8
"""Share of a window's wheel travel in valid pairs, for the window to be valid."""
BANDS = (-np.inf, 0.3, 0.55, 0.9, np.inf)
DISTANCE_M = 2.0
LEAST_DISTANCE_M = 0.8
"""Shorter drives have no distance of 2 m; the rest of a drive counts from this length on."""
WRONG_SLIP = 0.1
STANDS_M, MOVES_M, MOVES_SHARE = 0.0003, 0.0006, 0.1
"""A rover that moves less stands. More, and more than this share of the wheels' motion, counts as moving."""


@dataclass(frozen=True, kw_only=True)
class Windows:
    """Windows of wheel travel, one row each.

    Attributes:
        slip: True slip.
        error: Measured less true slip; NaN without a valid pair.
        valid: Whether enough of the window is measured.
    """

    slip: Floats
    error: Floats
    valid: np.ndarray


def windows(pairs: Pairs, length_m: float = WINDOW_M) -> Windows:
    """Return the windows of a drive, by wheel travel."""
    rows = []
    for part in parts(np.abs(pairs.wheel_m), length_m):
        wheel, valid = np.abs(pairs.wheel_m[part]), pairs.valid[part]
        way = np.sign(pairs.wheel_m[part])
        slip = float(pairs.slip[part] @ wheel / wheel.sum())
        measured_m = float(wheel[valid].sum())
        error = np.nan
        if measured_m > 0:
            error = 1 - float((way * pairs.found[part, 0])[valid].sum()) / measured_m - slip
        rows.append((slip, error, measured_m >= LEAST_MEASURED * wheel.sum()))
    table = np.array(rows).reshape(-1, 3)
    return Windows(slip=table[:, 0], error=table[:, 1], valid=table[:, 2] > 0)


def distance_errors(pairs: Pairs) -> list[float]:
    """Return errors of the distance over 2 m of true travel, or over the drive, as shares."""
    errors = []
    for part in parts(np.abs(pairs.true[:, 0]), DISTANCE_M, LEAST_DISTANCE_M):
        valid = pairs.valid[part]
        true_m = float(pairs.true[part, 0][valid].sum())
        if valid.mean() >= LEAST_MEASURED and abs(true_m) > LEAST_DISTANCE_M / 2:
            errors.append(float(pairs.found[part, 0][valid].sum()) / true_m - 1)
    return errors


def sideways_errors(pairs: Pairs) -> list[float]:
    """Return errors of the travel to the left over 0.5 m of true travel, m."""
    return [
        float((pairs.found[part, 1] - pairs.true[part, 1])[pairs.valid[part]].sum())
        for part in parts(np.abs(pairs.true[:, 0]), WINDOW_M)
        if pairs.valid[part].mean() >= LEAST_MEASURED
    ]


def normalised_errors(pairs: Pairs, length_m: float) -> list[float]:
    """Return errors forward over windows of wheel travel, over their reported standard deviations."""
    errors = []
    for part in parts(np.abs(pairs.wheel_m), length_m):
        valid = pairs.valid[part]
        if valid.mean() < LEAST_MEASURED:
            continue
        error = float((pairs.found[part, 0] - pairs.true[part, 0])[valid].sum())
        shared = pairs.scale_sd * abs(float(pairs.found[part, 0][valid].sum()))
        own = np.sqrt(float((pairs.sd[part, 0][valid] ** 2).sum()))
        errors.append(error / float(np.hypot(shared, own)))
    return errors


def standing(pairs: Pairs) -> tuple[int, int, int]:
    """Return pairs in which the rover stands, how many are valid, and how many are reported as moving."""
    still = np.hypot(pairs.true[:, 0], pairs.true[:, 1]) < STANDS_M
    moved = np.hypot(pairs.found[:, 0], pairs.found[:, 1])
    least = np.maximum(MOVES_M, MOVES_SHARE * np.abs(pairs.wheel_m))
    return (
        int(still.sum()),
        int((still & pairs.valid).sum()),
        int((still & pairs.valid & (moved > least)).sum()),
    )


def band_shares(parts: Sequence[Windows]) -> list[tuple[int, float]]:
    """Return for each band of true slip the windows, and the share that is valid."""
    slip = np.concatenate([part.slip for part in parts])
    valid = np.concatenate([part.valid for part in parts])
    rows = []
    for low, high in pairwise(BANDS):
        inside = (slip >= low) & (slip < high)
        rows.append((int(inside.sum()), float(valid[inside].mean()) if inside.any() else np.nan))
    return rows


def parts(travel_m: Floats, length_m: float, least_m: float | None = None) -> Iterator[slice]:
    """Yield pairs that together travel a length, and the rest from `least_m` on."""
    start, total = 0, 0.0
    for place, step_m in enumerate(travel_m.tolist()):
        total += step_m
        if total >= length_m:
            yield slice(start, place + 1)
            start, total = place + 1, 0.0
    if least_m is not None and total >= least_m:
        yield slice(start, len(travel_m))
