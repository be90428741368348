"""Readings of the wheels that are older or coarser than the rows that hold them."""

import math
from collections.abc import Iterator

import numpy as np

from rover_hil.drives.arrays import Array
from rover_hil.drives.channels import Channels
from rover_hil.recording.findings import FoundFinding

LEAST_CHANGES = 20
"""Fewer changes of a reading show nothing."""
REGULAR_SHARE = 0.8
"""Of the changes that come after the same number of rows, of readings that are held."""
EQUAL_SHARE = 0.9
"""Of the changes that are a whole number of steps, of an encoder that shows its steps."""
LEAST_UNEVEN = 0.1
"""Of the changes that differ from a single step in each row."""
FEW_STEPS = 2.5
"""Steps from row to row, usually, of a coarse encoder: its speeds are wrong by a large part of them."""
LEAST_ROWS = 2.0
"""Readings that change less often than every second row, in motion."""
LONGEST_STILL = 10.0
"""A reading that stays for more rows than so many usual ones is at standstill."""


def sampling_findings(rows: Channels) -> Iterator[FoundFinding]:
    """Yield that readings of the wheels are held over several rows, or have coarse steps."""
    held: list[tuple[int, float]] = []
    coarse: list[tuple[int, float]] = []
    for quantity in ("position{}_rad", "speed{}_rad_s"):
        wheel = 0
        while (name := quantity.format(wheel := wheel + 1)) in rows:
            values, t_ns = rows[name].value, rows[name].t_ns
            if size := _held_rows(values):
                held.append((wheel - 1, size * float(np.median(np.diff(t_ns))) / 1e9))
            elif quantity.startswith("position") and (step_rad := _coarse_step(values)):
                coarse.append((wheel - 1, step_rad))
        if held or coarse:
            break
    if held:
        text = (
            f"the readings of wheel {_listed(held)} are measured every {held[0][1]:.3g} s and repeated in "
            "the rows between, so that speeds from row to row jump: keep the rows with new readings only"
        )
        yield FoundFinding(name="sampling", t_s=None, text=text, harm=0.0)
    if coarse:
        text = (
            f"the angles of wheel {_listed(coarse)} have coarse steps of {coarse[0][1]:.3g} rad "
            f"({math.tau / coarse[0][1]:.0f} in a rotation), so that speeds from row to row jump: give more "
            "steps in a rotation, or fewer rows"
        )
        yield FoundFinding(name="sampling", t_s=None, text=text, harm=0.0)


def _listed(wheels: list[tuple[int, float]]) -> str:
    return ", ".join(str(wheel) for wheel, _ in wheels)


def _changes(values: Array) -> tuple[Array, Array]:
    """Return by how much a reading changes each time in motion, and after how many rows."""
    places = np.flatnonzero(np.diff(values)) + 1
    if len(places) < LEAST_CHANGES:
        return np.zeros(0), np.zeros(0)
    counts = np.diff(places)
    sizes = np.abs(values[places[1:]] - values[places[:-1]])
    is_moving = counts <= LONGEST_STILL * np.median(counts)
    return sizes[is_moving], counts[is_moving].astype(float)


def _held_rows(values: Array) -> int:
    """Return over how many rows each reading is held; 0 where it is not."""
    sizes, counts = _changes(values)
    usual = float(np.median(counts)) if len(counts) else 0.0
    if usual < LEAST_ROWS or np.mean(counts == usual) < REGULAR_SHARE:
        return 0
    # A coarse encoder that turns evenly changes regularly, too, but always by one step.
    return int(usual) if np.ptp(np.quantile(sizes, (0.1, 0.9))) > 0.5 * np.median(sizes) else 0


def _coarse_step(values: Array) -> float:
    """Return the step of an angle that changes by few steps from row to row; 0 where it is fine."""
    sizes, counts = _changes(values)
    if not len(sizes):
        return 0.0
    step = float(np.quantile(sizes, 0.05))
    steps = sizes / max(step, 1e-12)
    is_counted = np.mean(np.abs(steps - np.round(steps)) < 0.01) >= EQUAL_SHARE
    # At an even speed all changes are alike, however fine the steps are.
    is_uneven = np.mean((counts > 1) | (steps > 1.5)) >= LEAST_UNEVEN
    return step if is_counted and is_uneven and np.median(steps) <= FEW_STEPS else 0.0
