"""Scores of a trace finder.

- A trace is present when at least 0.20 m of it is visible in a usable frame; missed: present, not detected;
  run: the largest number of consecutive misses; false: detected and not present, of all frames.
- Misidentified: more than 5 deg from the current direction and from the chord, or more than half a wheel's
  width from both lines.
- Hold: error against the current direction; the last angle is held where none is given. Chord: error
  against the chord of the visible trace.
- ROC: area under the curve of the confidence for "trace present, error below 5 deg", over the frames with
  an angle.
- Calibration: mean difference of the confidence and the share of right traces, over ranges of the
  confidence.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tests.rear_scene.truth import FrameTruth

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

RIGHT_WITHIN_DEG = 5.0
LONG_M = 0.3
"""A trace of which this much is visible should not be missed."""
LEAST_WRONG = 5
"""With fewer wrong angles than this the area under a curve says nothing."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """What a finder says of a drive's frames.

    Attributes:
        theta_deg: Angle, NaN where none is given.
        distance_m: Of the trace's line from the origin, NaN where none is given.
        path_off_deg: Error of the chord of the path found against the true one's over the same stretch.
        confidence: In the angle.
        detected: The trace is said to be in this frame.
        tracked: The trace was known from the frame before.
        spent_ms: Time used, decoding excluded.
        theta_sd_deg: Standard deviation of the angle that the finder reports, NaN for none.
    """

    theta_deg: Floats
    distance_m: Floats
    path_off_deg: Floats
    confidence: Floats
    detected: Flags
    tracked: Flags
    spent_ms: Floats
    theta_sd_deg: Floats


@dataclass(frozen=True, kw_only=True)
class Judged:
    """Frames of one or more drives, each with what is right or wrong about it.

    Attributes:
        present: A trace is there: at least 0.20 m of it visible.
        detected: It is said to be there.
        run: Frames in a row, up to this one, of a trace not found.
        misidentified: Found, and more than 5 deg from the current direction and from the chord, or more than
            half a wheel's width from both lines.
        hold_deg: Error against the current direction, the last angle held where none is given; before the
            first one the wheel's own axis is taken.
        chord_deg: Error of the angle against the chord, NaN where not found.
        path_deg: Error of the chord of the path found, NaN where not found.
        has_angle: An angle is given: found, or kept from the frames before.
        right: The trace is there, and the angle is within 5 deg of the current direction.
        confidence: In it.
        tracked: The trace was known from the frame before.
        spent_ms: Time used.
        long: At least 0.3 m of the trace is visible.
        long_run: As `run`, of such frames alone.
        within: 1 where the error is within two reported standard deviations, else 0; NaN without one.
    """

    present: Flags
    detected: Flags
    run: Floats
    misidentified: Flags
    hold_deg: Floats
    chord_deg: Floats
    path_deg: Floats
    has_angle: Flags
    right: Flags
    confidence: Floats
    tracked: Flags
    spent_ms: Floats
    long: Flags
    long_run: Floats
    within: Floats


def judge(angles: Found, truth: Sequence[FrameTruth], wheel_width_m: float) -> Judged:
    """Compare what was found with the truth of the same frames."""
    theta, chord = (np.array([getattr(row, name) for row in truth]) for name in ("theta_t_deg", "chord_deg"))
    line, chord_line = (np.array([getattr(row, name) for row in truth]) for name in ("d_t_m", "chord_d_m"))
    present = np.array([row.trace_present for row in truth])
    seen = present & angles.detected
    angle_off = np.fmin(np.abs(angles.theta_deg - theta), np.abs(angles.theta_deg - chord))
    place_off = np.fmin(np.abs(angles.distance_m - line), np.abs(angles.distance_m - chord_line))
    error = np.abs(angles.theta_deg - theta)
    long = present & (np.array([row.visible_m for row in truth]) >= LONG_M)
    is_within = (error <= 2 * angles.theta_sd_deg).astype(np.float64)
    return Judged(
        present=present,
        detected=angles.detected,
        run=_runs(present & ~angles.detected, present),
        misidentified=seen & ((angle_off > RIGHT_WITHIN_DEG) | (place_off > wheel_width_m / 2)),
        hold_deg=_held(angles.theta_deg, np.isfinite(angles.theta_deg)) - theta,
        chord_deg=np.where(seen, angles.theta_deg - chord, np.nan),
        path_deg=np.where(seen, angles.path_off_deg, np.nan),
        has_angle=np.isfinite(angles.theta_deg),
        right=present & (np.nan_to_num(error, nan=np.inf) < RIGHT_WITHIN_DEG),
        confidence=angles.confidence,
        tracked=angles.tracked,
        spent_ms=angles.spent_ms,
        long=long,
        long_run=_runs(long & ~angles.detected, long),
        within=np.where(np.isfinite(error) & np.isfinite(angles.theta_sd_deg), is_within, np.nan),
    )


def together(parts: Sequence[Judged]) -> Judged:
    """Return the frames of several drives as one."""
    return Judged(
        **{
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(Judged)
        }
    )


def figures(judged: Judged) -> dict[str, float]:
    """Return the figures of a set; shares in per cent of the frames with a trace, false positives of all.

    NaN where there is nothing to count: no frame with a trace, too few wrong angles for a curve.
    """
    present = judged.present
    with_trace = max(int(present.sum()), 1)
    return {
        "frames": len(present),
        "missed_pct": 100 * float((present & ~judged.detected).sum()) / with_trace,
        "longest_run": float(judged.run.max()),
        "long_missed_pct": 100
        * float((judged.long & ~judged.detected).sum())
        / max(int(judged.long.sum()), 1),
        "long_run": float(judged.long_run.max()),
        "within_pct": 100 * _mean(judged.within),
        "misidentified_pct": 100 * float(judged.misidentified.sum()) / with_trace,
        "false_pct": 100 * float((judged.detected & ~present).mean()),
        "hold_rms_deg": _rms(judged.hold_deg[present]),
        "chord_rms_deg": _rms(judged.chord_deg),
        "path_rms_deg": _rms(judged.path_deg),
        "roc": roc_area(judged.confidence[judged.has_angle], judged.right[judged.has_angle]),
        "tracked_ms": _median(judged.spent_ms[judged.tracked]),
        "cold_ms": _median(judged.spent_ms[~judged.tracked]),
    }


def roc_area(confidence: Floats, right: Flags) -> float:
    """Return the chance that a right angle has more confidence than a wrong one, ties counting half.

    NaN where too few are wrong, or where the confidence is always the same.
    """
    good, bad = np.sort(confidence[right]), confidence[~right]
    if len(bad) < LEAST_WRONG or len(good) < LEAST_WRONG or np.ptp(confidence) == 0:
        return float("nan")
    below = np.searchsorted(good, bad, "left"), np.searchsorted(good, bad, "right")
    return float(1 - (below[0] + below[1]).mean() / (2 * len(good)))


def _held(theta_deg: Floats, given: Flags) -> Floats:
    held, last = np.empty_like(theta_deg), 0.0
    for place, (angle, is_found) in enumerate(zip(theta_deg.tolist(), given.tolist(), strict=True)):
        last = angle if is_found else last
        held[place] = last
    return held


def _runs(missed: Flags, present: Flags) -> Floats:
    """Return the number of misses up to each frame; frames without a trace end a run."""
    runs, count = np.zeros(len(missed)), 0
    for place in range(len(missed)):
        count = count + 1 if missed[place] and present[place] else 0
        runs[place] = count
    return runs


def _rms(values: Floats) -> float:
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _mean(values: Floats) -> float:
    values = values[np.isfinite(values)]
    return float(values.mean()) if len(values) else float("nan")


def _median(values: Floats) -> float:
    return float(np.median(values)) if len(values) else float("nan")
