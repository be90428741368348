"""Presence of the trace, decided on the strips of ground in view."""

from collections import deque

import numpy as np

from controllers.ftrace.parameters import PresenceParameters
from controllers.ftrace.rut.strips import Stretch
from controllers.ground_motion.ground_patch import Floats


class Presence:
    """Decides, frame by frame, whether the trace is present.

    A trace that was present needs less evidence than one that appears. Until the rover has moved far enough
    to leave a trace that counts, the evidence must persist while ground passes by: a shadow does not.

    Args:
        start_m: Distance after which a trace that counts can be in view.
        known_m: Distance after which what is fixed in the picture is known.
        parameters: Tuned numbers.

    Attributes:
        locked: The trace is present.
    """

    def __init__(self, start_m: float, known_m: float, parameters: PresenceParameters) -> None:
        self._start_m, self._known_m = start_m, known_m
        self._parameters = parameters
        self._travelled_m = 0.0
        self._doubtful_m = np.inf
        self._signature = np.zeros(0)
        self._recent: deque[tuple[float, float]] = deque()
        self.locked = False

    @property
    def signature(self) -> Floats:
        """Mean answers of the trace as a unit vector, one weight for each kernel; empty while unknown."""
        return self._signature

    def forget(self) -> None:
        """Set the trace to absent; its signature is kept."""
        self.locked = False

    def update(self, stretch: Stretch, moved_m: float) -> bool:
        """Take the evidence of the next frame; return whether the trace is present.

        Args:
            stretch: The most likely stretch of trace.
            moved_m: Distance since the frame before.
        """
        numbers = self._parameters
        self._travelled_m += moved_m
        self._doubtful_m += moved_m
        persists = self._persists(stretch.log_odds)
        if self.locked:
            bridges = self._doubtful_m < numbers.bridged_m
            present = stretch.log_odds > (numbers.bridge_odds if bridges else numbers.keep_odds)
        elif self._travelled_m > self._start_m + numbers.start_error_m:
            present = stretch.log_odds > numbers.lock_odds
        else:
            counts = stretch.fills_view or (stretch.is_followed and stretch.length_m > numbers.shortest_m)
            present = persists and counts
        # The length of a clear trace is known; a shorter one does not count as present. One that was present
        # and begins at the wheel is seen in part only: it cannot become shorter.
        is_clear = stretch.log_odds > numbers.clear_odds
        may_be_short = stretch.fills_view or not self.locked
        present = present and not (is_clear and may_be_short and stretch.length_m < numbers.shortest_m)
        self.locked = present
        # What was seen before the trace was present bridges nothing: it may have ended since.
        if not present:
            self._doubtful_m = np.inf
        elif stretch.log_odds > numbers.bridged_odds:
            self._doubtful_m = 0.0
        if present:
            now = stretch.sums / max(float(np.linalg.norm(stretch.sums)), 1e-6)
            gain = numbers.signature_gain if self._signature.size else 1.0
            signature = now if gain == 1.0 else self._signature + gain * (now - self._signature)
            self._signature = signature / max(float(np.linalg.norm(signature)), 1e-6)
        return present

    def _persists(self, log_odds: float) -> bool:
        """Take the odds of a frame; return whether they and their median over the last travel suffice."""
        numbers, recent = self._parameters, self._recent
        if self._travelled_m < self._known_m:
            return False
        if recent and recent[-1][0] == self._travelled_m:
            recent.pop()  # a rover that stands sees the same once more
        recent.append((self._travelled_m, log_odds))
        while len(recent) > 1 and self._travelled_m - recent[1][0] >= numbers.persists_m:
            recent.popleft()
        if self._travelled_m - recent[0][0] < numbers.persists_m or log_odds <= numbers.lock_odds:
            return False
        return float(np.median([odds for _, odds in recent])) > numbers.lock_odds
