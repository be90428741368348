"""Earlier frames to compare with, and their poses."""

from dataclasses import dataclass

import numpy as np

from controllers.ground_motion.ground_patch import Floats, GroundPatch
from controllers.ground_motion.parameters import ValidityParameters
from drivers.samples import Image


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """A frame to compare with.

    Attributes:
        picture: Fine structure in grey levels.
        pose: Of the measured point in the axes of the first frame of the chain: forward, left, turn, and roll
            and pitch since then.
        sd: Standard deviation of it, forward and left.
    """

    picture: Image
    pose: Floats
    sd: Floats


class ReferenceFrames:
    """Frames of a chain of poses that begins with the first.

    Args:
        ground: The rectified ground.
        parameters: Tuned numbers.

    Attributes:
        last: The newest frame.
    """

    def __init__(self, ground: GroundPatch, parameters: ValidityParameters) -> None:
        self._pixel_m, self._rows, self._numbers = ground.pixel_m, ground.shape[0], parameters
        self._baseline_pixels = (
            parameters.coarse_baseline_pixels if ground.is_coarse else parameters.baseline_pixels
        )
        self._stored: list[Reference] = []
        self.begin(np.zeros(ground.shape, np.uint8))

    def begin(self, picture: Image) -> None:
        """Begin a new chain of poses with a frame."""
        self.last = Reference(picture=picture, pose=np.zeros(5), sd=np.zeros(2))
        self._stored = [self.last]

    def choose(self, last_m: Floats) -> tuple[list[Reference], Reference]:
        """Return the frames to compare with, in this order, and one for a second measurement.

        Args:
            last_m: Motion that is expected from the last frame on, in its axes.
        """
        pose, numbers = self.last.pose, self._numbers
        expected = pose[:2] + rotated(last_m, float(pose[2]))

        def newest(pixels: float) -> Reference | None:
            """Return the newest frame from which the ground has moved by this in the picture."""
            far = [each for each in self._stored if self._apart(expected, each.pose) >= pixels]
            return far[-1] if far else None

        first = newest(self._baseline_pixels) or self._stored[0]
        second = newest(numbers.second_pixels) or self.last
        order = [first] if first is self.last else [first, self.last]
        return order, self.last if second is first else second

    def add(self, reference: Reference) -> None:
        """Keep a frame."""
        self.last = reference
        numbers, pose = self._numbers, reference.pose
        turned = float(pose[2] - self._stored[-1].pose[2]) * self._rows
        if np.hypot(self._apart(pose, self._stored[-1].pose), turned) < numbers.stored_pixels:
            return
        self._stored.append(reference)
        # All before the newest one that is far enough will not be compared with again.
        while len(self._stored) > 2 and (
            len(self._stored) > numbers.most_stored
            or self._apart(pose, self._stored[1].pose) >= self._baseline_pixels
        ):
            del self._stored[0]

    def _apart(self, one: Floats, other: Floats) -> float:
        return float(np.hypot(*(one[:2] - other[:2]))) / self._pixel_m


def rotated(vector: Floats, angle_rad: float) -> Floats:
    """Return a plane vector, turned counter-clockwise."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]])
