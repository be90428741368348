"""What is wrong with the times of recorded rows or frames by themselves, and what they are without it.

Formats convert; this judges, for all of them alike. Assumptions: rows come in the order of the recording, and
no two of them are further apart than the wrap of a counter.
"""

from typing import NamedTuple

import numpy as np

from rover_hil.datasets.arrays import Array

WRAPS = (
    (2.0**32 * 1e-6, "2^32 us"),
    (2.0**32 * 1e-3, "2^32 ms"),
    (2.0**31 * 1e-6, "2^31 us"),
    (2.0**16 * 1e-3, "2^16 ms"),
)
"""Length of counters that begin anew at 0, in s."""
LONGEST_STEP = 20.0
"""Across a wrap the time goes on by so many usual steps at most."""
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
    """Return times without the wraps of their counter."""
    steps_s = np.diff(times_s)
    back = np.flatnonzero(steps_s < 0.0)
    forward_s = steps_s[steps_s > 0.0]
    if not back.size or not forward_s.size:
        return Clock(times_s)
    usual_s = float(np.median(forward_s))
    for length_s, name in WRAPS:
        after_s = steps_s[back] + length_s
        if np.all((after_s >= 0.0) & (after_s <= LONGEST_STEP * usual_s)):
            wraps = np.zeros(len(times_s))
            wraps[back + 1] = length_s
            finding = f"times that begin anew after {name}: the counter wraps"
            return Clock(times_s + wraps.cumsum(), ((finding, back.size),))
    return Clock(times_s)


def spread(times_s: Array) -> Clock:
    """Return times of which several rows in a row hold the same one, evenly up to the next.

    Only where nearly all times stand in the same number of rows: a clock that is coarser than the rows. A row
    that was written twice is another fault.
    """
    begins = np.concatenate(([0], np.flatnonzero(np.diff(times_s)) + 1))
    counts = np.diff(np.concatenate((begins, [len(times_s)])))
    if len(begins) < LEAST_TIMES:
        return Clock(times_s)
    usual = int(np.bincount(counts).argmax())
    if usual < 2 or np.mean(counts == usual) < REGULAR_SHARE:
        return Clock(times_s)
    lengths_s = np.diff(times_s[begins])
    lengths_s = np.append(lengths_s, np.median(lengths_s))
    lengths_s = np.minimum(lengths_s, LONGEST_STEP * float(np.median(lengths_s)))
    places = np.arange(len(times_s)) - np.repeat(begins, counts)
    evenly_s = times_s + places * np.repeat(lengths_s / counts, counts)
    finding = f"rows of one time, {usual} of each: the clock is coarser than the rows, they are spread evenly"
    return Clock(evenly_s, ((finding, int((counts > 1).sum())),))
