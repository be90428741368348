"""How much of the directions a rover has shown so far, for the display while it turns."""

import math

from rover_hil.ready.compass.parameters import COMPASS_FIT

BAR = 18
"""Characters of the bar."""


class Coverage:
    """Counts turns and covered directions of a yaw."""

    def __init__(self) -> None:
        self._yaw_rad: float | None = None
        self._turned_rad = 0.0
        self._covered: set[int] = set()

    @property
    def turns(self) -> float:
        """Turns so far, both senses together."""
        return self._turned_rad / math.tau

    @property
    def covered(self) -> int:
        """Covered sectors, of `COMPASS_FIT.sectors`."""
        return len(self._covered)

    def add(self, yaw_rad: float) -> None:
        """Note the present yaw in rad; call it at least four times per turn."""
        if self._yaw_rad is not None:
            self._turned_rad += abs(math.remainder(yaw_rad - self._yaw_rad, math.tau))
        self._yaw_rad = yaw_rad
        self._covered.add(int((yaw_rad % math.tau) / math.tau * COMPASS_FIT.sectors) % COMPASS_FIT.sectors)

    def text(self, wanted_turns: float) -> str:
        """Return turns and coverage in one line."""
        full = round(BAR * self.covered / COMPASS_FIT.sectors)
        bar = "#" * full + "." * (BAR - full)
        return (
            f"turned {self.turns:.1f} of {wanted_turns:.0f} times, "
            f"directions [{bar}] {100 * self.covered // COMPASS_FIT.sectors} %"
        )
