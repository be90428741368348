"""Fine structure of the ground: about the same in light and in shadow.

Small-scale differences of log grey over their mean size nearby. A shadow changes the level of log grey, which
the difference removes, and the contrast of relief, which the division removes. The edge of a shadow remains,
but it is limited to a few times the strength of the grain.
"""

import cv2
import numpy as np

from controllers.ground_motion.ground_patch import GroundPatch, Patch
from controllers.ground_motion.parameters import StructureParameters
from drivers.samples import Image


class FineStructure:
    """Fine structure of one rig's ground.

    Args:
        ground: The rectified ground.
        parameters: Tuned numbers.
    """

    def __init__(self, ground: GroundPatch, parameters: StructureParameters) -> None:
        self._parameters = parameters
        self._visible = ground.visible.astype(np.float32)
        self._log_grey = np.log(np.arange(256, dtype=np.float32) + parameters.grey_floor)
        self._fine = (parameters.fine_pixels, parameters.fine_pixels)
        self._near = (parameters.near_pixels, parameters.near_pixels)
        self._fine_share, self._near_share = (
            np.maximum(cv2.blur(self._visible, window), 1e-3) for window in (self._fine, self._near)
        )

    def log_grey(self, patch: Image) -> Patch:
        """Return the logarithm of grey levels."""
        return np.asarray(cv2.LUT(patch, self._log_grey), np.float32)

    def of(self, log_grey: Patch) -> Patch:
        """Return the structure of a picture of log grey, 0 where the camera does not see the ground."""
        numbers = self._parameters
        seen = log_grey * self._visible
        fine = (seen - cv2.blur(seen, self._fine) / self._fine_share) * self._visible
        strength = cv2.blur(np.abs(fine), self._near) / self._near_share
        return np.asarray(
            np.clip(fine / (strength + numbers.faintest), -numbers.clip, numbers.clip), np.float32
        )

    def picture(self, structure: Patch) -> Image:
        """Return the structure in grey levels, 128 where there is none."""
        return np.asarray(128 + self._parameters.contrast * structure, np.uint8)
