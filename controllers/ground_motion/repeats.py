"""Whether a frame is the one before once more, with another time or coded again.

Frames of the same ground differ by the noise of the sensor; a picture that is sent again has the same noise,
and coding it again changes less than that. So a frame that differs much less from the last one than frames
did so far is one sent again, or one of a rover that has just stopped: in both cases the pair stays open, and
the travel is measured over all of it.

Three frames of ground that stands differ equally from each other, and not more than from the last new one,
since the noise of each is its own. Of one picture that is coded again and again, two copies differ by nothing
where they are coded alike, and by the root of two of their difference from it where they are not. Behind a
filter of noise over time nothing distinguishes both, until ground that stands for long shows the noise.
"""

import math
from collections import deque
from statistics import median

import cv2

from controllers.ground_motion.parameters import RepeatParameters
from drivers.samples import Image

EQUAL = 2.0**0.25
"""Ratio of two differences below which they are equal: half-way, as a ratio, from one to the root of two."""


class RepeatWatch:
    """Judges frames by their mean difference from the last one that was new.

    Args:
        visible: Pixels that are compared.
        parameters: Tuned numbers.

    Attributes:
        is_undecided: Whether the newest frame differs as little as a repeated one, but must not wait.
    """

    def __init__(self, visible: Image, parameters: RepeatParameters) -> None:
        self._visible, self._numbers = visible, parameters
        self._differences: deque[float] = deque(maxlen=parameters.kept)
        self._in_a_row = 0
        self._seen: deque[Image] = deque(maxlen=2)
        self._new: Image | None = None
        self.is_undecided = False

    def begin(self, patch: Image) -> None:
        """Take a frame that is not judged."""
        self._seen.append(patch)
        self._new = patch

    def is_repeated(self, patch: Image, last_new: Image, *, may_wait: bool) -> bool:
        """Return whether a frame is a repeated one.

        Args:
            patch: The frame.
            last_new: The one at which the pair begins.
            may_wait: Whether the travel of the wheels leaves room for a longer pair.
        """
        numbers, self.is_undecided = self._numbers, False
        grey = self._apart_grey(patch, last_new)
        has_own_noise = self._in_a_row > 0 and self._has_own_noise(patch)
        newest = self._seen[-1]
        self._seen.append(patch)
        if grey < numbers.same_grey:
            return True
        is_less = bool(self._differences) and grey < numbers.share * median(self._differences)
        if not is_less:
            self._in_a_row, self._new = 0, patch
            self._differences.append(grey)
            return False
        self._in_a_row += 1
        if has_own_noise:
            self._stands(patch, self._apart_grey(patch, newest))
            return False
        if may_wait and self._in_a_row <= numbers.most_in_a_row:
            return True
        self.is_undecided = self._in_a_row <= numbers.most_undecided
        if not self.is_undecided:
            self._stands(patch, grey)
        return False

    def _stands(self, patch: Image, noise_grey: float) -> None:
        """Note that frames are new, and what noise alone makes of their difference."""
        self._in_a_row, self._new = 0, patch
        self._differences.clear()
        self._differences.append(noise_grey)

    def _has_own_noise(self, patch: Image) -> bool:
        """Return whether the noise of a frame is that of no frame before, and as large as theirs.

        The newest frame that was certainly new may be one from before the motion ended.
        """
        before, newest = (self._noise_grey(patch, each) for each in self._seen)
        if self._new is None or min(before, newest) < self._numbers.same_grey:
            return False
        is_equal = abs(math.log(before / newest)) < math.log(EQUAL)
        return is_equal and newest < EQUAL * self._noise_grey(patch, self._new)

    def _noise_grey(self, patch: Image, other: Image) -> float:
        """Return the standard deviation of the difference of two frames: brightness may change."""
        difference = cv2.subtract(patch, other, dtype=cv2.CV_16S)
        return float(cv2.meanStdDev(difference, mask=self._visible)[1][0, 0])

    def _apart_grey(self, patch: Image, other: Image) -> float:
        return float(cv2.mean(cv2.absdiff(patch, other), self._visible)[0])
