"""What is wrong with the times of recorded rows or frames by themselves, and what they are without it.

Formats convert; this judges, for all of them alike. Assumptions: rows come in the order of the recording, and
no two of them are further apart than the wrap of a counter.
"""

from typing import NamedTuple

import numpy as np

from rover_hil.drives.arrays import Array

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

    Only where nearly all times stand in the same number of rows, and these measure the same: a clock that is
    coarser than the rows. A row that was written twice is another fault, and rows of several sensors, each
    with columns of its own, were measured at one time.

    Args:
        times_s: Of n rows, not running back.
        values: What else is in them, NaN where a cell is empty, shape (n, columns).
    """
    begins = np.concatenate(([0], np.flatnonzero(np.diff(times_s)) + 1))
    counts = np.diff(np.concatenate((begins, [len(times_s)])))
    if len(begins) < LEAST_TIMES:
        return Clock(times_s)
    usual = int(np.bincount(counts).argmax())
    if usual < 2 or np.mean(counts == usual) < REGULAR_SHARE:
        return Clock(times_s)
    is_pair = np.diff(times_s) == 0.0
    measures_again = np.any(np.isfinite(values[1:]) & np.isfinite(values[:-1]), axis=1)
    if np.mean(measures_again[is_pair]) < REGULAR_SHARE:
        return Clock(times_s)
    lengths_s = np.diff(times_s[begins])
    usual_s = float(np.median(lengths_s))
    lengths_s = np.minimum(np.append(lengths_s, usual_s), usual_s)
    places = np.arange(len(times_s)) - np.repeat(begins, counts)
    evenly_s = times_s + places * np.repeat(lengths_s / counts, counts)
    finding = f"rows of one time, {usual} of each: the clock is coarser than the rows, they are spread evenly"
    return Clock(evenly_s, ((finding, int((counts > 1).sum())),))
