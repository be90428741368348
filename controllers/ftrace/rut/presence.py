"""Presence of the trace, decided on the strips of ground in view."""

import numpy as np

from controllers.ftrace.parameters import PresenceParameters
from controllers.ftrace.rut.strips import Stretch
from controllers.ground_motion.ground_patch import Floats


class Presence:
    """Decides, frame by frame, whether the trace is present.

    A trace that was present needs less evidence than one that appears. Until the rover has moved far enough
    to leave a trace that counts, more evidence is needed, and the trace must move with the ground.

    Args:
        start_m: Distance after which a trace that counts can be in view.
        parameters: Tuned numbers.

    Attributes:
        locked: The trace is present.
    """

    def __init__(self, start_m: float, parameters: PresenceParameters) -> None:
        self._start_m = start_m
        self._parameters = parameters
        self._travelled_m = self._doubtful_m = 0.0
        self._signature = np.zeros(0)
        self._first: tuple[float, float] | None = None
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
        self._doubtful_m = 0.0 if stretch.log_odds > numbers.bridged_odds else self._doubtful_m + moved_m
        if self.locked:
            bridges = self._doubtful_m < numbers.bridged_m
            present = stretch.log_odds > (numbers.bridge_odds if bridges else numbers.keep_odds)
        elif self._travelled_m > self._start_m + numbers.start_error_m:
            present = stretch.log_odds > numbers.lock_odds
        else:
            present = stretch.log_odds > numbers.start_odds and self._was_there_before(stretch)
        # The length of a clear trace is known; a shorter one does not count as present. One that was present
        # and begins at the wheel is seen in part only: it cannot become shorter.
        is_clear = stretch.log_odds > numbers.clear_odds
        may_be_short = stretch.fills_view or not self.locked
        present = present and not (is_clear and may_be_short and stretch.length_m < numbers.shortest_m)
        self.locked = present
        if stretch.log_odds < numbers.start_odds:
            self._first = None
        if present:
            now = stretch.sums / max(float(np.linalg.norm(stretch.sums)), 1e-6)
            gain = numbers.signature_gain if self._signature.size else 1.0
            signature = now if gain == 1.0 else self._signature + gain * (now - self._signature)
            self._signature = signature / max(float(np.linalg.norm(signature)), 1e-6)
        return present

    def _was_there_before(self, stretch: Stretch) -> bool:
        """Return whether a clear trace at the start moves with the ground, as far as one can see.

        It fills the view; or its ground was followed over a length that counts; or its far end moves away
        from the wheel, which that of a shadow of the wheel does not.
        """
        numbers = self._parameters
        if stretch.fills_view and self._travelled_m > numbers.light_known_m:
            return True
        if stretch.is_followed and stretch.length_m > numbers.followed_m:
            return True
        if self._first is None:
            self._first = self._travelled_m, stretch.length_m
        since_m, grown_m = self._travelled_m - self._first[0], stretch.length_m - self._first[1]
        return since_m > numbers.end_known_m and grown_m > numbers.end_share * since_m
