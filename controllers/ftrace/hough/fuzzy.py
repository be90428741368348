"""Fuzzy match of a candidate line with the trace model (paper 000, section 2.2).

The paper names the quantities that are compared, in the image and in the world, but not the membership
functions; those here are this program's own choice.
"""

from dataclasses import dataclass

import numpy as np

from controllers.ftrace.parameters import FuzzyParameters
from controllers.ground_motion.ground_patch import Floats


@dataclass(frozen=True, slots=True)
class Candidate:
    """A straight line on the ground that may be the trace.

    Attributes:
        theta_rad: Its direction from the wheel's axis.
        offset_m: Its place at the contact, left of it positive.
        width_m: Distance of the two edges on its sides, or None for a single edge.
        support: Share of its length in view that edges cover, measured in the image.
    """

    theta_rad: float
    offset_m: float
    width_m: float | None
    support: float


def falls(value: float, full: float, none: float) -> float:
    """Return membership 1 up to `full`, falling to 0 at `none`."""
    return float(np.clip((none - value) / (none - full), 0.0, 1.0))


def confidence(
    candidate: Candidate,
    width_m: float,
    max_slip_rad: float,
    last: Candidate | None,
    parameters: FuzzyParameters,
) -> float:
    """Return how well a candidate matches the trace model, 0..1: the weighted geometric mean of memberships.

    Args:
        candidate: The line.
        width_m: Width of the wheel.
        max_slip_rad: Largest angle a trace may have.
        last: The last trace, or None before the first: then continuity does not count.
        parameters: Memberships and weights.
    """
    match = {
        "angle": falls(abs(candidate.theta_rad), max_slip_rad, 1.2 * max_slip_rad),
        "contact": falls(abs(candidate.offset_m), 0.2 * width_m, width_m),
        "support": float(np.clip(candidate.support / parameters.full_support, 0, 1)),
        "width": parameters.single_edge,
    }
    if candidate.width_m is not None:
        off = abs(candidate.width_m / width_m - 1.0)
        tolerance = parameters.width_tolerance
        match["width"] = max(falls(off, tolerance / 3, tolerance), parameters.single_edge)
    if last is not None:
        angle, offset = parameters.angle_step_rad, parameters.offset_step * width_m
        turned = falls(abs(candidate.theta_rad - last.theta_rad), angle / 2, 2 * angle)
        moved = falls(abs(candidate.offset_m - last.offset_m), offset / 2, 2 * offset)
        match["continuity"] = min(turned, moved)
    weights: Floats = np.array([getattr(parameters, f"{name}_weight") for name in match])
    values: Floats = np.array(list(match.values()))
    return float(np.exp((weights * np.log(np.maximum(values, 1e-9))).sum() / weights.sum()))
