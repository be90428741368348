"""One frame as the trackers get it, and what they say about it."""

from dataclasses import dataclass

import cv2
import numpy as np

from controllers.ftrace.rig_geometry import Floats, Mask
from drivers.samples import Image

DARKEST_GREY = 6
BRIGHTEST_GREY = 250
LEAST_CONTRAST = 3.0
MOST_BURNT = 0.7


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Rectified ground and what is known of the motion since the frame before.

    Attributes:
        patch: Grey ground behind the wheel.
        usable: False for black, burnt or empty frames.
        distance_m: Distance by the wheel's speed, or by the rig's nominal one; 0 for the first frame.
        turn_rad: Angles turned about x, y, z by the gyro; zeros where it tells nothing.
        turn_sd_rad: Standard deviation of each.
        is_first: No frame came before.
    """

    patch: Image
    usable: bool
    distance_m: float
    turn_rad: tuple[float, float, float]
    turn_sd_rad: tuple[float, float, float]
    is_first: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What a tracker found.

    Attributes:
        found: The trace is in this frame.
        theta_rad: Angle of the current velocity from the wheel's axis, or None where nothing is known.
        offset_m: Place of the trace at the contact, left of it positive.
        confidence: Probability-like, 0..1, that `theta_rad` is right within 5 deg.
        path_m: Centre line: rows of (behind, left of the contact) in the wheel's axes.
    """

    found: bool
    theta_rad: float | None
    offset_m: float
    confidence: float
    path_m: Floats


def is_usable(patch: Image, visible: Mask) -> bool:
    """Return whether the ground shows anything at all: not black, not burnt, not uniform."""
    counts = cv2.calcHist([patch], [0], np.asarray(visible, np.uint8), [256], [0.0, 256.0]).ravel()
    share = np.asarray(counts, np.float64) / max(float(counts.sum()), 1.0)
    level = np.arange(256.0)
    median = int(np.searchsorted(np.cumsum(share), 0.5))
    mean = float(share @ level)
    spread = float(np.sqrt(share @ (level - mean) ** 2))
    return bool(
        median >= DARKEST_GREY and share[BRIGHTEST_GREY:].sum() < MOST_BURNT and spread >= LEAST_CONTRAST
    )
