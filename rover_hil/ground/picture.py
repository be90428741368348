"""Picture of the ground from above: points that follow it and points that do not, and what is fixed."""

import cv2
import numpy as np

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.ground_view import GroundView
from drivers.samples import Image

FOLLOWS, OTHER, FIXED = (0, 220, 0), (0, 0, 255), (255, 0, 255)
LEAST_WIDTH = 640
TITLE_ROWS = 28


def draw(grey: Image, view: GroundView, estimator: GroundMotionEstimator, title: str) -> Image:
    """Return a frame as seen from above, BGR, at least `LEAST_WIDTH` wide, always of one size.

    Green lines are the motion of points that follow the ground, from the earlier frame to this one, red ones
    of those that do not. What never moves in the picture is magenta, and so are crosses at points that move
    with the rover: neither counts.

    Args:
        grey: The frame.
        view: The ground in it.
        estimator: After it has measured this frame.
        title: One line above it.
    """
    patch = view.look(grey).patch
    scale = max(1, -(-LEAST_WIDTH // patch.shape[1]))
    picture = cv2.cvtColor(patch, cv2.COLOR_GRAY2BGR)
    mask = estimator.fixed_in_picture
    picture[mask] = (0.5 * picture[mask] + 0.5 * np.array(FIXED)).astype(np.uint8)
    large = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    if estimator.pair is not None and (tracks := estimator.pair.tracks) is not None:
        ends = (np.round(scale * (each + 0.5)).astype(int).tolist() for each in (tracks.before, tracks.after))
        masked = estimator.moving_parts.mask.tolist()
        kinds = (tracks.tracked.tolist(), tracks.follows.tolist(), masked)
        for before, after, is_tracked, follows, is_part in zip(*ends, *kinds, strict=True):
            if is_part:
                cv2.drawMarker(large, before, FIXED, cv2.MARKER_TILTED_CROSS, 9, 2)
            if not is_tracked:
                continue
            cv2.line(large, before, after, FOLLOWS if follows else OTHER, 1, cv2.LINE_AA)
            cv2.circle(large, after, 2, FOLLOWS if follows else OTHER, -1, cv2.LINE_AA)
    head = np.zeros((TITLE_ROWS, large.shape[1], 3), np.uint8)
    cv2.putText(head, title, (8, 19), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return np.asarray(np.vstack([head, large]), np.uint8)
