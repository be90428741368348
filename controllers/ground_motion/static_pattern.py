"""What stands still in the picture while the ground moves through it.

Specks on the lens, parts of the rover and edges of its shadow are fixed in the picture. The mean of the
structure over the ground's motion shows them: of ground that moves through, the mean goes to zero. It is
learned over motion, not over time: ground that stands still teaches nothing.
"""

import numpy as np

from controllers.ground_motion.ground_patch import Mask, Patch
from controllers.ground_motion.parameters import PatternParameters


class StaticPattern:
    """Learns the pattern of one rig.

    Args:
        shape: Of the rectified ground.
        parameters: Tuned numbers.

    Attributes:
        mean: Mean structure over the motion, at each pixel.
        moved_pixels: Motion of the ground since the first frame.
    """

    def __init__(self, shape: tuple[int, int], parameters: PatternParameters) -> None:
        self._parameters = parameters
        self.mean: Patch = np.zeros(shape, np.float32)
        self._fixed: Patch = np.zeros(shape, np.float32)
        self.moved_pixels = 0.0

    @property
    def mask(self) -> Mask:
        """Return the pixels of the rectified ground that hold something which never moves."""
        return np.asarray(self._fixed != 0.0, np.bool_)

    def update(self, structure: Patch, moved_pixels: float) -> None:
        """Take the structure of a frame, and how far the ground moved in the picture since the one before."""
        length = self._parameters.length_pixels
        self.moved_pixels += moved_pixels
        # Weights fall exponentially with motion; before the length is reached the mean is a plain one.
        known = 1.0 - np.exp(-self.moved_pixels / length)
        gain = np.float32((1.0 - np.exp(-moved_pixels / length)) / known)
        self.mean += gain * (structure - self.mean)
        if self.moved_pixels > length:
            strong = np.abs(self.mean) > self._parameters.least_strength
            self._fixed = np.where(strong, self.mean, np.float32(0.0))

    def without(self, structure: Patch) -> Patch:
        """Return a structure less the pattern."""
        return structure - self._fixed
