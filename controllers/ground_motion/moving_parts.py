"""What moves with the rover: points of the view that never move with the ground.

A rim, a track or a cable moves otherwise than the ground. Its points are followed well, but never fit the
ground.
"""

import numpy as np

from controllers.ground_motion.flow import Tracks
from controllers.ground_motion.ground_patch import Floats, Mask
from controllers.ground_motion.parameters import MovingPartsParameters


class MovingParts:
    """Learns which points to leave out, over the motion of the ground.

    Args:
        count: Of the points.
        parameters: Tuned numbers.

    Attributes:
        mask: Points that belong to the rover.
    """

    def __init__(self, count: int, parameters: MovingPartsParameters) -> None:
        self._numbers = parameters
        self._followed: Floats = np.zeros(count)
        self._seen: Floats = np.zeros(count)
        self.mask: Mask = np.zeros(count, np.bool_)

    def update(self, tracks: Tracks, moved_pixels: float) -> None:
        """Take the points of a pair, and how far the ground moved in it."""
        if moved_pixels < self._numbers.least_pixels:
            return
        kept = float(np.exp(-moved_pixels / self._numbers.length_pixels))
        weight = (1.0 - kept) * tracks.tracked
        self._seen = self._seen * np.where(tracks.tracked, kept, 1.0) + weight
        self._followed = self._followed * np.where(tracks.tracked, kept, 1.0) + weight * tracks.follows
        known = self._seen > self._numbers.least_seen
        mask = known & (self._followed < self._numbers.most_following * self._seen)
        # More of them are rather the ground, and what was taken for it is a part of the rover.
        self.mask = mask if mask.mean() <= self._numbers.most_share else np.zeros_like(mask)
