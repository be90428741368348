"""Slip over drive force of the present ground, learned while driving. Plain floats.

One number, slip per force: at a given stiffness of the contact the slip grows with the force that it carries,
in proportion while it is small. It is learned wherever the slip is measured otherwise, by the yaw excitation
or by pose fixes, and carries the slip over the time without such a measurement. It does not know when the
ground changes: its uncertainty grows with the distance, and it ends where the force jumps.
"""

import math
from typing import NamedTuple

from controllers.slip.effort.parameters import EFFORT


class LearnedSlip(NamedTuple):
    """Slip by the learned curve.

    Attributes:
        slip: Slip ratio of the whole rover, 0 to 1.
        sd: Its standard deviation.
        reason: Why it is not valid; empty where it is.
    """

    slip: float
    sd: float
    reason: str


class LearnedCurve:
    """Learns slip per drive force.

    Args:
        greatest_jump_n: Of the force, beyond which the ground is another one.
    """

    def __init__(self, greatest_jump_n: float) -> None:
        self._greatest_jump_n = greatest_jump_n
        self._count = 0
        self._per_n = 0.0
        self._per_n_variance = 0.0
        self._force_n = 0.0
        self._distance_m = 0.0

    def forget(self) -> None:
        """Begin anew."""
        self._count = 0

    def move(self, distance_m: float) -> None:
        """Take the distance travelled by the wheels."""
        self._distance_m += distance_m

    def learn(self, force_n: float, slip: float) -> None:
        """Take a measured slip and the drive force during it.

        Args:
            force_n: Work of the wheels per distance.
            slip: Measured slip ratio.
        """
        weight = EFFORT.learning.weight
        if self._count == 0 or abs(force_n - self._force_n) > self._greatest_jump_n:
            self._count, self._force_n = 0, force_n
        per_n = slip / max(force_n, EFFORT.learning.least_force_n)
        self._count += 1
        if self._count == 1:
            self._per_n, self._per_n_variance = per_n, 0.0
        difference = per_n - self._per_n
        self._per_n += weight * difference
        self._per_n_variance += weight * (difference**2 - self._per_n_variance)
        self._force_n += weight * (force_n - self._force_n)
        self._distance_m = 0.0

    def at(self, force_n: float) -> LearnedSlip:
        """Return the slip at a drive force."""
        numbers = EFFORT.learning
        slip = min(max(self._per_n * force_n, 0.0), 1.0)
        jump_n = abs(force_n - self._force_n)
        sd = math.hypot(
            numbers.sd,
            numbers.sd_share * slip,
            numbers.sd_share_per_sqrt_m * slip * math.sqrt(self._distance_m),
            numbers.sd_per_sqrt_m * math.sqrt(self._distance_m),
            numbers.sd_jump_share * jump_n * self._per_n,
            math.sqrt(self._per_n_variance) * force_n,
        )
        reason = ""
        if self._count < numbers.least_count:
            reason = "slip over force not yet learned"
        elif jump_n > self._greatest_jump_n:
            reason = f"drive force {force_n:.1f} N, learned at {self._force_n:.1f} N: another ground"
        elif not sd <= numbers.greatest_sd:  # also true where sd is not a number
            reason = "slip over force learned too long ago"
        return LearnedSlip(slip, sd, reason)
