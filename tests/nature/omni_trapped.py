"""The rover of `omni_contact.py` that does not get on any more from some place on."""

import math
from dataclasses import dataclass

import numpy as np

from tests.nature.omni_contact import OmniContact

ONE_WHEEL = "one wheel stuck"
TRAPS = ("lifted", "dug in", "wall", ONE_WHEEL)
CHECK_NS = 1_000_000
"""What holds the rover acts this often."""


@dataclass
class TrappedOmni(OmniContact):
    """A rover that is trapped for good once it has gone a distance from its start.

    Args:
        trap: One of `TRAPS`. `lifted`: its wheels hang in the air, and the body stays where it is. `dug in`:
            the body stays where it is, and the wheels work against the ground. `wall`: a wall across x stops
            the body without a bounce; it may slide along it, and turn. `one wheel stuck`: a wheel is wedged
            and turns no more; the two others drive the rover, which drags it along.
        at_m: The distance.
        wheel: The one that is wedged.
    """

    trap: str = "lifted"
    at_m: float = 0.5
    wheel: int = 0
    is_trapped: bool = False

    def advance(self, t_ns: int) -> None:
        """Integrate in steps of a millisecond, and hold the rover once it is trapped."""
        while self._t_ns + CHECK_NS <= t_ns:
            super().advance(self._t_ns + CHECK_NS)
            if not self.is_trapped and math.hypot(self._pose[0], self._pose[1]) >= self.at_m:
                self.is_trapped = True
                self._held, self._held_rad = self._pose.copy(), float(self._angle[self.wheel])
                self._loads_n = np.zeros(3) if self.trap == "lifted" else self._loads_n
            if self.is_trapped and self.trap == "wall":
                self._stop_at_the_wall()
            elif self.is_trapped and self.trap == ONE_WHEEL:
                self._angle[self.wheel], self._speed[self.wheel] = self._held_rad, 0.0
            elif self.is_trapped:
                self._pose[:], self._twist[:] = self._held, 0.0
        super().advance(t_ns)

    def _stop_at_the_wall(self) -> None:
        if self._pose[0] < self._held[0]:
            return
        self._pose[0] = self._held[0]
        ahead, aside = math.cos(self._pose[2]), math.sin(self._pose[2])
        into_m_s = ahead * self._twist[0] - aside * self._twist[1]
        if into_m_s > 0.0:
            self._twist[0] -= into_m_s * ahead
            self._twist[1] += into_m_s * aside
