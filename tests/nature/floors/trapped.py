"""The rover on bristles that does not get on any more from some place on."""

import math

import numpy as np

from tests.nature.floors.bristle import BristlePlant
from tests.nature.floors.machine import Floats
from tests.nature.floors.patchwork import Floor

LIFTED, DUG_IN, WALL, ONE_WHEEL = "lifted", "dug in", "wall", "one wheel stuck"
CHECK_NS = 1_000_000
"""What holds the rover acts this often."""


class TrappedBristle(BristlePlant):
    """A rover whose traction follows the slip velocity, trapped for good at a distance from its start.

    Args:
        floor: The ground and the rover's constants.
        rng: Source of what differs between two runs on one floor.
        start_ns: Time of the start.
        trap: `LIFTED`: its wheels hang in the air, and the body stays where it is. `DUG_IN`: the body stays
            where it is, and the wheels work against the ground. `WALL`: a wall across x stops the body
            without a bounce; it may slide along it, and turn. `ONE_WHEEL`: wheel 0 is wedged.
        at_m: The distance.
    """

    def __init__(
        self, floor: Floor, rng: np.random.Generator, start_ns: int, *, trap: str, at_m: float
    ) -> None:
        super().__init__(floor, rng, start_ns)
        self._trap, self._at_m = trap, at_m
        self._held: Floats | None = None
        self._held_wheel_rad = 0.0

    def advance(self, t_ns: int) -> None:
        """Integrate in steps of a millisecond, and hold the rover once it is trapped."""
        while self._t_ns + CHECK_NS <= t_ns:
            super().advance(self._t_ns + CHECK_NS)
            if self._held is None and math.hypot(self.body[0], self.body[1]) >= self._at_m:
                self._held, self._held_wheel_rad = self.body.copy(), float(self.drive.angle_rad[0])
                self._lifted = self._trap == LIFTED
            if self._held is not None:
                self._hold(self._held)
        super().advance(t_ns)

    def _hold(self, held: Floats) -> None:
        if self._trap == ONE_WHEEL:
            self.drive.angle_rad[0], self.drive.speed_rad_s[0] = self._held_wheel_rad, 0.0
        elif self._trap != WALL:
            self.body[:3], self.body[3:] = held[:3], 0.0
        elif self.body[0] >= held[0]:
            self.body[0] = held[0]
            ahead, aside = math.cos(self.body[2]), math.sin(self.body[2])
            into_m_s = ahead * self.body[3] - aside * self.body[4]
            if into_m_s > 0.0:
                self.body[3] -= into_m_s * ahead
                self.body[4] += into_m_s * aside
