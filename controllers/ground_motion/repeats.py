"""Whether a frame is the one before once more, with another time or coded again.

Frames of the same ground differ by the noise of the sensor; a picture that is sent again has the same noise,
and coding it again changes less than that. So a frame that differs much less from the last one than frames
did so far is one sent again, or one of a rover that has just stopped: in both cases the pair stays open, and
the travel is measured over all of it.

Three frames of ground that stands differ equally from each other, and not more than from the last new one,
since the noise of each is its own; twice in a row this shows that the ground stands. Of one picture that is
coded again and again, two copies differ by nothing where they are coded alike, and by the root of two of
their difference from it where they are not. The premise, which nothing tests: the first picture itself was
not given noise of its own on its way. Behind a filter of noise over time nothing distinguishes the two, until
ground that stands for long shows the noise.
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
        self._references: list[Image] = []
        self._own_in_a_row = 0
        self.is_undecided = False

    def begin(self, patch: Image) -> None:
        """Take a frame that is not judged."""
        self._seen.append(patch)
        self._references = [patch]

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
            self._begin_row(patch)
            self._differences.append(grey)
            return False
        self._in_a_row += 1
        self._own_in_a_row = self._own_in_a_row + 1 if has_own_noise else 0
        if self._in_a_row == 1:
            self._references.append(patch)
        if self._own_in_a_row >= numbers.least_own_noise:
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
        self._begin_row(patch)
        self._differences.clear()
        self._differences.append(noise_grey)

    def _begin_row(self, patch: Image) -> None:
        """Take a frame that is new: copies are compared with it, and with the first that differs little."""
        self._in_a_row = self._own_in_a_row = 0
        self._references = [patch]

    def _has_own_noise(self, patch: Image) -> bool:
        """Return whether the noise of a frame is that of no frame before, and as large as theirs.

        The last new frame may be one from before the motion ended; the first of the row is not.
        """
        before, newest = (self._noise_grey(patch, each) for each in self._seen)
        if min(before, newest) < self._numbers.same_grey:
            return False
        is_equal = abs(math.log(before / newest)) < math.log(EQUAL)
        return is_equal and all(newest < EQUAL * self._noise_grey(patch, one) for one in self._references)

    def _noise_grey(self, patch: Image, other: Image) -> float:
        """Return the standard deviation of the difference of two frames: brightness may change."""
        difference = cv2.subtract(patch, other, dtype=cv2.CV_16S)
        return float(cv2.meanStdDev(difference, mask=self._visible)[1][0, 0])

    def _apart_grey(self, patch: Image, other: Image) -> float:
        return float(cv2.mean(cv2.absdiff(patch, other), self._visible)[0])
