"""Whether a frame is the one before once more, with another time or coded again.

Frames of the same ground differ by the noise of the sensor; a picture that is sent again has the same noise,
and coding it again changes less than that. So a frame that differs much less from the last one than frames
did so far is one sent again, or one of a rover that has just stopped: in both cases the pair stays open, and
the travel is measured over all of it. Ground that stands longer shows what noise alone makes of a difference.
Until then nothing distinguishes it from a camera that sends one picture for long.
"""

from collections import deque
from statistics import median

from controllers.ground_motion.parameters import RepeatParameters


class RepeatWatch:
    """Judges frames by their mean difference from the last one that was new.

    Args:
        parameters: Tuned numbers.

    Attributes:
        is_undecided: Whether the newest frame differs as little as a repeated one, but must not wait.
    """

    def __init__(self, parameters: RepeatParameters) -> None:
        self._numbers = parameters
        self._differences: deque[float] = deque(maxlen=parameters.kept)
        self._in_a_row = 0
        self.is_undecided = False

    def is_repeated(self, grey: float, *, may_wait: bool) -> bool:
        """Return whether a frame is a repeated one.

        Args:
            grey: Mean difference in grey levels.
            may_wait: Whether the travel of the wheels leaves room for a longer pair.
        """
        numbers, self.is_undecided = self._numbers, False
        if grey < numbers.same_grey:
            return True
        is_less = bool(self._differences) and grey < numbers.share * median(self._differences)
        if not is_less:
            self._in_a_row = 0
            self._differences.append(grey)
            return False
        self._in_a_row += 1
        if may_wait and self._in_a_row <= numbers.most_in_a_row:
            return True
        self.is_undecided = self._in_a_row <= numbers.most_undecided
        if not self.is_undecided:
            self._in_a_row = 0
            self._differences.clear()  # this is the noise of new frames of ground that stands
            self._differences.append(grey)
        return False
