"""Input and output of a tracker for one frame."""

from dataclasses import dataclass

import cv2
import numpy as np

from controllers.ftrace.parameters import FrameParameters
from controllers.ground_motion.ground_patch import Floats, Mask
from controllers.ground_motion.ground_view import SeenGround
from drivers.samples import Image


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Rectified ground, and the motion since the frame before.

    Attributes:
        t_ns: Time of exposure.
        ground: The ground behind the wheel.
        usable: False for black, burnt or empty frames.
        travel_m: Travel by the wheel's speed, or by the rig's nominal one, negative backwards; 0 for the
            first frame.
        turn_rad: Angles turned about x, y, z by the gyro; zeros without one.
        turn_sd_rad: Standard deviation of each.
        has_gyro: Whether a gyro has measured them.
    """

    t_ns: int
    ground: SeenGround
    usable: bool
    travel_m: float
    turn_rad: tuple[float, float, float]
    turn_sd_rad: tuple[float, float, float]
    has_gyro: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Result of a tracker.

    Attributes:
        found: The trace is detected in this frame.
        theta_rad: Angle of the current velocity from the wheel's axis, or None where unknown.
        theta_sd_rad: Its standard deviation; None where unknown.
        by_motion: The angle is measured by the motion of the ground, without the trace.
        offset_m: Place of the trace at the contact, left of it positive.
        confidence: 0..1, probability that the wheel's trace is in this frame and has this angle within 5 deg.
        path_m: Centre line: rows of (behind, left of the contact) in the wheel's axes.
        mounting_sd_rad: Standard deviation that all angles share, by the yaw of the mounting; None where
            nothing checks it.
        contradiction: Why the angle is not to be used: pictures and gyro contradict the rig; "" where they
            do not.
    """

    found: bool
    theta_rad: float | None
    theta_sd_rad: float | None
    by_motion: bool
    offset_m: float
    confidence: float
    path_m: Floats
    mounting_sd_rad: float | None = None
    contradiction: str = ""


def is_usable(patch: Image, visible: Mask, parameters: FrameParameters) -> bool:
    """Return True for ground that is not black, not burnt out and not uniform."""
    counts = cv2.calcHist([patch], [0], np.asarray(visible, np.uint8), [256], [0.0, 256.0]).ravel()
    share = np.asarray(counts, np.float64) / max(float(counts.sum()), 1.0)
    level = np.arange(256.0)
    median = int(np.searchsorted(np.cumsum(share), 0.5))
    mean = float(share @ level)
    spread = float(np.sqrt(share @ (level - mean) ** 2))
    burnt = share[parameters.brightest_grey :].sum()
    is_exposed = median >= parameters.darkest_grey and burnt < parameters.most_burnt
    return bool(is_exposed and spread >= parameters.least_contrast)
