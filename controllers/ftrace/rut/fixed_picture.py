"""What is fixed in the picture while the ground moves through it, as a dark band is; frames without it."""

import numpy as np

from controllers.ftrace.parameters import FixedParameters
from controllers.ground_motion.ground_patch import RESOLUTION_M, Patch
from controllers.ground_motion.static_pattern import StaticPattern
from controllers.ground_motion.structure import FineStructure


class FixedPicture:
    """Learns it over the motion of the ground.

    The mean of a trace that is driven straight is fixed as well; prints, irregular edges and the smoothness
    of the ground remain of it.

    Args:
        structure: Fine structure of the ground.
        shape: Of the rectified ground.
        detail_shape: Of its detail.
        parameters: Tuned numbers.
    """

    def __init__(
        self,
        structure: FineStructure,
        shape: tuple[int, int],
        detail_shape: tuple[int, int],
        parameters: FixedParameters,
    ) -> None:
        self._structure, self._known_m = structure, parameters.known_m
        self._detail = StaticPattern(detail_shape, parameters.pattern)
        self._grey = StaticPattern(shape, parameters.pattern)

    def update(self, detail: Patch, log_grey: Patch, moved_m: float) -> None:
        """Take the next frame, and by how much the ground has moved, more than 0.

        Args:
            detail: Logarithm of grey without what varies slowly.
            log_grey: Logarithm of grey.
            moved_m: Motion since the frame before.
        """
        self._detail.update(detail, moved_m / RESOLUTION_M)
        self._grey.update(log_grey, moved_m / RESOLUTION_M)

    def without(self, detail: Patch, log_grey: Patch, structure: Patch) -> tuple[Patch, Patch]:
        """Return detail and fine structure of a frame less what is fixed; as given until that is known.

        The structure is formed anew: beside strong edges the ground seems faint, so that a band with such
        edges would seem smooth, as a trace is.
        """
        if self._detail.moved_pixels * RESOLUTION_M < self._known_m:
            return detail, structure
        moving = self._structure.of(log_grey - self._grey.mean)
        return np.asarray(detail - self._detail.mean, np.float32), moving
