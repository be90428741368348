"""Fuzzy match of a candidate line with the trace model (paper 000, section 2.2).

The paper says what is compared, in the image and in the world, but not the membership functions; the ones
here are this program's own choice.
"""

from dataclasses import dataclass

import numpy as np

from controllers.ftrace.rig_geometry import Floats

WIDTH_TOLERANCE = 0.35
"""Share of the wheel's width by which two edges may be further apart or closer."""
SINGLE_EDGE = 0.25
"""Width match of a line that has no partner at the wheel's width."""
ANGLE_STEP_RAD = np.radians(6.0)
OFFSET_STEP = 0.5
"""Share of the wheel's width by which the trace may move between frames."""
FULL_SUPPORT = 0.6
WEIGHTS = {"angle": 1.0, "contact": 2.0, "support": 1.0, "width": 1.5, "continuity": 1.5}


@dataclass(frozen=True, slots=True)
class Candidate:
    """A straight line on the ground that may be the trace.

    Attributes:
        theta_rad: Its direction from the wheel's axis.
        offset_m: Where it passes the contact, left of it positive.
        width_m: Distance of the two edges it lies between, or None for a single edge.
        support: Share of its length in view that edges cover, measured in the image.
    """

    theta_rad: float
    offset_m: float
    width_m: float | None
    support: float


def falls(value: float, full: float, none: float) -> float:
    """Return membership 1 up to `full`, falling to 0 at `none`."""
    return float(np.clip((none - value) / (none - full), 0.0, 1.0))


def confidence(candidate: Candidate, width_m: float, max_slip_rad: float, last: Candidate | None) -> float:
    """Return how well a candidate matches the trace model, 0..1: the weighted geometric mean of memberships.

    Args:
        candidate: The line.
        width_m: Width of the wheel.
        max_slip_rad: Largest angle a trace may have.
        last: The last trace, or None before the first: then continuity is not asked.
    """
    match = {
        "angle": falls(abs(candidate.theta_rad), max_slip_rad, 1.2 * max_slip_rad),
        "contact": falls(abs(candidate.offset_m), 0.2 * width_m, width_m),
        "support": float(np.clip(candidate.support / FULL_SUPPORT, 0, 1)),
        "width": SINGLE_EDGE,
    }
    if candidate.width_m is not None:
        off = abs(candidate.width_m / width_m - 1.0)
        match["width"] = max(falls(off, WIDTH_TOLERANCE / 3, WIDTH_TOLERANCE), SINGLE_EDGE)
    if last is not None:
        turned = falls(abs(candidate.theta_rad - last.theta_rad), ANGLE_STEP_RAD / 2, 2 * ANGLE_STEP_RAD)
        moved = falls(
            abs(candidate.offset_m - last.offset_m), OFFSET_STEP * width_m / 2, 2 * OFFSET_STEP * width_m
        )
        match["continuity"] = min(turned, moved)
    weights: Floats = np.array([WEIGHTS[name] for name in match])
    values: Floats = np.array(list(match.values()))
    return float(np.exp((weights * np.log(np.maximum(values, 1e-9))).sum() / weights.sum()))
