"""Presence of the trace, decided on the strips of ground in view."""

import numpy as np

from controllers.ftrace.parameters import PresenceParameters
from controllers.ftrace.rig_geometry import Floats
from controllers.ftrace.rut.strips import Stretch


class Presence:
    """Decides, frame by frame, whether the trace is present.

    A trace that was present needs less evidence than one that appears. Until the rover has moved far enough
    to leave a trace that counts, only one that fills the view is accepted.

    Args:
        start_m: Distance after which a trace that counts can be in view.
        parameters: Tuned numbers.

    Attributes:
        locked: The trace is present.
    """

    def __init__(self, start_m: float, parameters: PresenceParameters) -> None:
        self._start_m = start_m
        self._parameters = parameters
        self._travelled_m = 0.0
        self._signature = np.zeros(0)
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
        if self.locked:
            present = stretch.log_odds > numbers.keep_odds
        elif self._travelled_m > self._start_m + numbers.start_error_m:
            present = stretch.log_odds > numbers.lock_odds
        else:
            is_old = stretch.fills_view and self._travelled_m > numbers.light_known_m
            present = is_old and stretch.log_odds > numbers.start_odds
        self.locked = present
        if present:
            now = stretch.sums / max(float(np.linalg.norm(stretch.sums)), 1e-6)
            gain = numbers.signature_gain if self._signature.size else 1.0
            signature = now if gain == 1.0 else self._signature + gain * (now - self._signature)
            self._signature = signature / max(float(np.linalg.norm(signature)), 1e-6)
        return present
