"""What is wrong with the times of recorded rows or frames by themselves, and what they are without it.

Formats convert; this judges, for all of them alike. Assumptions: rows come in the order of the recording, and
no two of them are further apart than the wrap of a counter.
"""

from typing import NamedTuple

import numpy as np

from rover_hil.drives.arrays import Array, Flags, Times

WRAPS = (
    (2.0**32 * 1e-6, "2^32 us"),
    (2.0**32 * 1e-3, "2^32 ms"),
    (2.0**31 * 1e-6, "2^31 us"),
    (2.0**16 * 1e-3, "2^16 ms"),
)
"""Length of counters that begin anew at 0, in s."""
LONGEST_STEP = 3.0
"""Across a wrap the time goes on by so many usual steps at most, or"""
LONGEST_OF_ITS_OWN = 1.5
"""by so many of the longer steps of the drive itself, its 99 % quantile: frames may come in bursts."""
REGULAR_SHARE = 0.9
"""Of the times that stand in the same number of rows, of a clock that is coarser than the rows."""
LEAST_TIMES = 10
ROW_S = (2e-4, 3.0)
"""The motion of a rover is recorded neither more often nor less often."""
USUAL_ROW_S = (5e-4, 1.0)
"""Where a unit is looked for that makes a recording of the rows."""
UNITS = ((1e-9, "ns"), (1e-6, "us"), (1e-3, "ms"), (1.0, "s"), (60.0, "min"), (86400.0, "days"))
COUNTS_ANEW = 5.0
"""Times that each count from the row before are not longer than so many usual ones, and"""
ALIKE = 2.0
"""their 90 % quantile is not more than so many times their 10 % quantile."""
LEAST_BACK = 0.05
"""Share of rows that run back where two clocks alternate, or each time counts from the row before."""
JUMP_S = 1.0
JUMP_STEPS = 10.0
"""A step of the time that is longer, and by so many times longer than usual, is a gap or another clock."""
ROWS_BESIDE = 5
"""Rows on each side of a jump that show how fast a quantity changes."""
GOES_ON = 3.0
"""Over a jump of the clock alone a quantity goes on by fewer usual steps."""
EQUAL_SHARE = 0.2
"""Of the rows that have the time of the row before, of a clock that is coarser than the rows."""


class Clock(NamedTuple):
    """Times that never run back, as far as their fault is known.

    Attributes:
        times_s: One for each row.
        findings: What was wrong, and how often.
    """

    times_s: Array
    findings: tuple[tuple[str, int], ...] = ()


def unwrapped(times_s: Array) -> Clock:
    """Return times without the wraps of their counter.

    A counter stands just below its length before it begins anew, and just above 0 then. Several recordings in
    one file run back by something else.
    """
    steps_s = np.diff(times_s)
    back = np.flatnonzero(steps_s < 0.0)
    forward_s = steps_s[steps_s > 0.0]
    if not back.size or not forward_s.size:
        return Clock(times_s)
    longest_s = max(
        LONGEST_STEP * float(np.median(forward_s)), LONGEST_OF_ITS_OWN * float(np.quantile(forward_s, 0.99))
    )
    for length_s, name in WRAPS:
        before_s, after_s = length_s - times_s[back], times_s[back + 1]
        is_wrap = (before_s > 0.0) & (after_s >= 0.0) & (before_s + after_s <= longest_s)
        if times_s.min() >= 0.0 and np.all(is_wrap):
            wraps = np.zeros(len(times_s))
            wraps[back + 1] = length_s
            finding = f"times that begin anew after {name}: the counter wraps"
            return Clock(times_s + wraps.cumsum(), ((finding, back.size),))
    return Clock(times_s)


def spread(times_s: Array, values: Array) -> Clock:
    """Return times of which several rows in a row hold the same one, evenly up to the next.

    Only where the rows of one time measure the same: a clock that is coarser than the rows, or rows that
    come in bursts. Bursts of unlike size are of rows that come regularly where a straight line of times
    explains them; else nothing shows when they were measured. A row that was written twice is another fault,
    and rows of several sensors, each with columns of its own, were measured at one time.

    Args:
        times_s: Of n rows, not running back.
        values: What else is in them, NaN where a cell is empty, shape (n, columns).
    """
    begins = np.concatenate(([0], np.flatnonzero(np.diff(times_s)) + 1))
    counts = np.diff(np.concatenate((begins, [len(times_s)])))
    if len(begins) < LEAST_TIMES:
        return Clock(times_s)
    is_pair = np.diff(times_s) == 0.0
    if np.mean(is_pair) < EQUAL_SHARE:
        return Clock(times_s)
    measures_again = np.any(np.isfinite(values[1:]) & np.isfinite(values[:-1]), axis=1)
    if np.mean(measures_again[is_pair]) < REGULAR_SHARE:
        return Clock(times_s)
    usual = int(np.bincount(counts).argmax())
    if usual < 2 or np.mean(counts == usual) < REGULAR_SHARE:
        return _evened(times_s, begins)
    lengths_s = np.diff(times_s[begins])
    usual_s = float(np.median(lengths_s))
    lengths_s = np.minimum(np.append(lengths_s, usual_s), usual_s)
    places = np.arange(len(times_s)) - np.repeat(begins, counts)
    evenly_s = times_s + places * np.repeat(lengths_s / counts, counts)
    finding = f"rows of one time, {usual} of each: the clock is coarser than the rows, they are spread evenly"
    return Clock(evenly_s, ((finding, int((counts > 1).sum())),))


def _evened(times_s: Array, begins: Times) -> Clock:
    """Return times on a straight line over the rows of each stretch without a gap, where it explains them."""
    lengths_s = np.diff(times_s[begins])
    longest_s = 2.0 * float(np.quantile(lengths_s, 0.9))
    cuts = begins[1:][lengths_s > JUMP_STEPS * float(np.median(lengths_s))]
    evenly_s = times_s.copy()
    for part in np.split(np.arange(len(times_s)), cuts):
        if len(part) < LEAST_TIMES:
            continue
        line = np.polynomial.Polynomial.fit(part.astype(float), times_s[part], 1)(part.astype(float))
        if np.abs(line - times_s[part]).max() > longest_s:
            return Clock(times_s)
        evenly_s[part] = line
    if np.diff(evenly_s).min() < 0.0:
        return Clock(times_s)
    finding = "rows of one time, in unlike groups: the clock is coarser than the rows, or they come in bursts"
    return Clock(evenly_s, ((finding, int(len(times_s) - len(begins))),))


def unit_fault(times_s: Array, unit: str) -> str:
    """Return what is wrong with the unit of the times of a drive; empty where rows come as of a rover.

    Args:
        times_s: Of n rows, as the unit says.
        unit: Its name, of `UNITS`.
    """
    steps_s = np.diff(times_s)
    steps_s = steps_s[steps_s > 0.0]
    if len(steps_s) < LEAST_TIMES:
        return ""
    row_s = float(np.median(steps_s))
    if ROW_S[0] <= row_s <= ROW_S[1]:
        return ""
    per_unit = {name: size_s for size_s, name in UNITS}[unit]
    others = [
        f"{row_s / per_unit * size_s:.3g} s in {name}"
        for size_s, name in UNITS
        if USUAL_ROW_S[0] <= row_s / per_unit * size_s <= USUAL_ROW_S[1]
    ]
    fits = f"; it is {', '.join(others)}" if others else ""
    return f"the usual time from row to row is {row_s:.3g} s, which is no recording of a rover{fits}"


def counted_anew(times_s: Array) -> Clock:
    """Return times that each counted from the row before, counted from the first row."""
    if len(times_s) < LEAST_TIMES or times_s.min() < 0.0 or np.mean(np.diff(times_s) < 0.0) < LEAST_BACK:
        return Clock(times_s)
    short_s, usual_s, long_s = np.quantile(times_s, (0.1, 0.5, 0.9)).tolist()
    if long_s > ALIKE * short_s or times_s.max() > COUNTS_ANEW * usual_s or usual_s > ROW_S[1]:
        return Clock(times_s)
    finding = "times that each count from the row before: they are added up"
    return Clock(np.cumsum(times_s), ((finding, len(times_s)),))


def unset_rows(times_s: Array) -> Flags:
    """Return which rows have time 0 because their clock was not set: among rows that never run back."""
    is_zero: Flags = times_s == 0.0
    others_s = times_s[~is_zero]
    if not is_zero.any() or is_zero[0] or len(others_s) < LEAST_TIMES or np.diff(others_s).min() < 0.0:
        return np.zeros(len(times_s), np.bool_)
    return is_zero


def back_fault(times_s: Array) -> str:
    """Return why times run back; empty where nothing shows it."""
    if np.mean(np.diff(times_s) < 0.0) < LEAST_BACK:
        return ""
    parts: list[list[float]] = []
    for time_s in times_s.tolist():
        before = [part for part in parts if part[-1] <= time_s]
        if before:
            max(before, key=lambda part: part[-1]).append(time_s)
        else:
            parts.append([time_s])
        if len(parts) > 2:
            return ""
    if min(map(len, parts)) < LEAST_TIMES:
        return ""
    apart_s = float(np.median(-np.diff(times_s)[np.diff(times_s) < 0.0]))
    return (
        f"the rows are of two clocks, about {apart_s:.4g} s apart: give the rows of one, or correct the "
        "times of the others"
    )


def set_ahead(times_s: Array, values: Array) -> Clock:
    """Return times without jumps of the clock over which the drive has gone on by one row only.

    What is measured shows it: angles of wheels or places that change as fast before as behind the jump. Where
    rows are missing they change by as much more. Speeds show nothing.

    Args:
        times_s: Of n rows, not running back.
        values: What else is in them, NaN where a cell is empty, shape (n, columns).
    """
    steps_s = np.diff(times_s)
    if len(steps_s) < LEAST_TIMES:
        return Clock(times_s)
    usual_s = float(np.median(steps_s))
    jumps = np.flatnonzero(steps_s > max(JUMP_S, JUMP_STEPS * usual_s))
    wrong = [
        int(row) for row in jumps if _goes_on(values, int(row), float(steps_s[row]) / max(usual_s, 1e-9))
    ]
    if not wrong:
        return Clock(times_s)
    back_s = np.zeros(len(times_s))
    back_s[np.array(wrong) + 1] = steps_s[wrong] - usual_s
    finding = (
        f"a time that jumps by {steps_s[wrong].max():.6g} s while the drive goes on by one row: the clock "
        "was set ahead, it is set back"
    )
    return Clock(times_s - back_s.cumsum(), ((finding, len(wrong)),))


def _goes_on(values: Array, row: int, missing: float) -> bool:
    """Return whether quantities go on behind a row as by one step, and none as by the missing ones."""
    first, end = row - ROWS_BESIDE, row + 2 + ROWS_BESIDE
    if first < 0 or end > len(values):
        return False
    steps = np.diff(values[first:end], axis=0)
    over, beside = steps[ROWS_BESIDE], np.delete(steps, ROWS_BESIDE, axis=0)
    usual = beside.mean(axis=0)
    is_steady = np.isfinite(steps).all(axis=0) & (np.abs(beside - usual) < 0.5 * np.abs(usual)).all(axis=0)
    is_one = is_steady & (np.abs(over) < GOES_ON * np.abs(usual))
    is_many = is_steady & (np.abs(over) > 0.5 * missing * np.abs(usual))
    return bool(is_one.any() and not is_many.any())
