"""Whether ground that seems to stand still may be moving behind what is fixed in the picture.

Specks on the lens, a pattern of the sensor, and parts of the rover do not move in the picture, and neither
does ground that stands. What differs is the remainder: the picture less its mean over some frames. Of ground
that stands only noise remains; ground that moves behind specks stays in it, and its correlation with the
remainder of an earlier frame has a peak at its motion.
"""

from collections import deque
from typing import NamedTuple

import cv2
import numpy as np

from controllers.ground_motion.choice import MAY_STAND
from controllers.ground_motion.ground_patch import Floats, Patch
from controllers.ground_motion.parameters import StandingParameters


class _Frame(NamedTuple):
    """A frame, and how far the wheels had rolled by then.

    Attributes:
        structure: With what is fixed in the picture.
        rolled: By the wheels until then, pixels ahead and left, along the path.
        moved: Of the ground, as measured until then.
    """

    structure: Patch
    rolled: Floats
    moved: Floats


class StandingProof:
    """Keeps the newest frames, and examines them where the ground seems to stand.

    Args:
        pixel_m: Size of a pixel of the rectified ground.
        parameters: Tuned numbers.
    """

    def __init__(self, pixel_m: float, parameters: StandingParameters) -> None:
        self._pixel_m, self._numbers = pixel_m, parameters
        self._frames: deque[_Frame] = deque(maxlen=parameters.frames)
        self._newest: _Frame | None = None
        self._rolled: Floats = np.zeros(2)
        self._moved: Floats = np.zeros(2)
        self._seen_pixels = 0.0

    def doubt(self, reason: str) -> str:
        """Return why nothing is measured, and that the ground was not seen to move where it was not."""
        has_moved = self._seen_pixels >= self._numbers.seen_pixels
        return reason if has_moved or reason != MAY_STAND else f"no motion confirmed: {reason}"

    def begin(self, structure: Patch) -> None:
        """Take a frame before which nothing is examined: the motion until then is not known, or was seen."""
        self._newest = _Frame(structure, self._rolled, self._moved)
        self._frames = deque([self._newest], maxlen=self._numbers.frames)

    def begin_pair(self) -> None:
        """Take that the newest frame is used, and the next motions are those since then."""
        if self._newest is not None:
            self._seen_pixels += float(np.hypot(*(self._newest.moved - self._moved)))
            self._rolled, self._moved = self._newest.rolled, self._newest.moved

    def why_not(self, structure: Patch, wheel_m: Floats | None, moved_m: Floats, *, is_fixed: bool) -> str:
        """Take a frame; return why its ground may move although it seems to stand.

        "" where it is shown to stand, or does not seem so.

        Args:
            structure: Of the frame, with what is fixed in the picture.
            wheel_m: Travel by the wheels since the pair began, ahead and left; None where unknown.
            moved_m: Measured motion, likewise.
            is_fixed: Whether the points that show it do not move in the picture.
        """
        if wheel_m is None:
            self.begin(structure)
            return ""
        numbers = self._numbers
        rolled, moved = wheel_m / self._pixel_m, moved_m / self._pixel_m
        self._newest = frame = _Frame(structure, self._rolled + rolled, self._moved + moved)
        if not is_fixed:
            self._frames = deque([frame], maxlen=numbers.frames)
            return ""
        stood = float(np.hypot(*(frame.rolled - self._frames[0].rolled)))
        if stood < numbers.least_rolled_pixels:
            return ""
        if self._seen_pixels < numbers.seen_pixels:
            return "no motion confirmed: the ground was not seen to move so far"
        if float(np.hypot(*(frame.rolled - self._frames[-1].rolled))) >= numbers.least_rolled_pixels:
            self._frames.append(frame)
        peak = self._greatest_peak()
        if len(self._frames) < numbers.least_frames or peak is None:
            return "too few frames to distinguish ground that stands from what is fixed in the picture"
        if peak > numbers.peak_sd:
            return "something moves behind what is fixed in the picture"
        return ""

    def _greatest_peak(self) -> float | None:
        """Return the greatest correlation at another motion than the measured, over its spread.

        None where the wheels have not rolled far enough for another motion.
        """
        frames, newest = list(self._frames), self._frames[-1]
        mean = np.mean([frame.structure for frame in frames], axis=0, dtype=np.float32)
        last = _spectrum(newest.structure - mean)
        peaks = [
            _peak(_spectrum(before.structure - mean), last, rolled, newest.moved - before.moved)
            for lag in self._numbers.lags
            if lag < len(frames)
            for before in (frames[-1 - lag],)
            if np.hypot(*(rolled := newest.rolled - before.rolled)) >= 2.0 * NEAR_PIXELS
        ]
        return max(peaks, default=None)


NEAR_PIXELS = 3.0
"""Shifts this close to each other belong to one motion."""
MOST_SHARE = 1.3
"""Greatest motion that is examined, over that of the wheels."""


def _spectrum(remainder: Patch) -> Patch:
    rows, columns = (cv2.getOptimalDFTSize(size + size // 3) for size in remainder.shape)
    padded = np.zeros((rows, columns), np.float32)
    padded[: remainder.shape[0], : remainder.shape[1]] = remainder
    return np.asarray(cv2.dft(padded), np.float32)


def _peak(before: Patch, after: Patch, rolled: Floats, moved: Floats) -> float:
    """Return the greatest correlation at another motion than the measured, along the wheels'."""
    length = float(np.hypot(*rolled))
    product = cv2.mulSpectrums(after, before, 0, conjB=True)
    plane = np.asarray(cv2.idft(product, flags=cv2.DFT_SCALE), np.float32)
    aside = np.arange(-2.0 - 0.2 * length, 2.0 + 0.2 * length + 1.0)
    along, across = np.meshgrid(np.arange(NEAR_PIXELS, MOST_SHARE * length), aside, indexing="ij")
    ahead, left = rolled / length
    # In the patch the ground goes down by a row for a pixel ahead, and a column back for a pixel to the left.
    shifts = np.stack([along * ahead - across * left, along * left + across * ahead])
    other = np.hypot(*(shifts - moved[:, None, None])) > NEAR_PIXELS
    rows = np.round(shifts[0][other]).astype(np.intp) % plane.shape[0]
    columns = np.round(-shifts[1][other]).astype(np.intp) % plane.shape[1]
    spread = float(plane.std())
    return float(plane[rows, columns].max(initial=0.0)) / spread if spread > 0.0 else 0.0
