"""The ground in a frame, rectified once for all that measure on it."""

from collections import deque
from typing import NamedTuple

import cv2
import numpy as np

from controllers.ground_motion.ground_patch import GroundPatch, Patch
from controllers.ground_motion.parameters import DEFAULTS, StructureParameters
from controllers.ground_motion.structure import FineStructure
from drivers.errors import ModelError
from drivers.samples import Image

MOST_KEPT = 4
"""Frames that are remembered: the motion over the ground waits for the wheels, the trace does not."""


class SeenGround(NamedTuple):
    """The rectified ground of a frame.

    Attributes:
        patch: Grey levels.
        log_grey: Their logarithm.
        structure: Its fine structure.
    """

    patch: Image
    log_grey: Patch
    structure: Patch


class GroundView:
    """Rectifies the frames of one rig and finds their fine structure.

    The trace and the motion over the ground of one camera share it: a frame is rectified once for both.

    Args:
        ground: The rectified ground.
        parameters: Tuned numbers.

    Attributes:
        ground: The rectified ground.
        structure: Fine structure of it.
    """

    def __init__(self, ground: GroundPatch, parameters: StructureParameters = DEFAULTS.structure) -> None:
        self.ground = ground
        self.structure = FineStructure(ground, parameters)
        self._kept: deque[tuple[Image, SeenGround]] = deque(maxlen=MOST_KEPT)

    def look(self, image: Image) -> SeenGround:
        """Return the ground in a frame; the same array is the same frame, and must not be written into again.

        Args:
            image: Grey or BGR pixels, of the rig's size.

        Raises:
            ModelError: The frame has another size than the rig's.
        """
        for kept, seen in self._kept:
            if kept is image:
                return seen
        size = (self.ground.rig.height, self.ground.rig.width)
        if image.shape[:2] != size:
            raise ModelError(
                f"frame of shape {image.shape}, the rig's is {size} pixels: use frames of this rig"
            )
        grey = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
        patch = self.ground.rectify(grey)
        log_grey = self.structure.log_grey(patch)
        seen = SeenGround(patch, log_grey, self.structure.of(log_grey))
        self._kept.append((image, seen))
        return seen
