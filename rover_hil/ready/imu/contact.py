"""How the body follows the turns of its wheels in place, on contacts that spring.

With the yaw inertia J, the stiffness k and damping c of the contacts about the centre, and what drags or
flows besides d, the body turns as its wheels do times

    (1 + a s) / (s^2 / w^2 + (a + b) s + 1),    w^2 = k / J, a = c / k, b = d / k

A contact whose deflection flows off while it rolls, as a tread with a relaxation length does, has a = 0 and b
= r / w^2, with r the rate of that flow. On rigid contacts w is beyond all turns, and the body turns as its
wheels.
"""

import math
from typing import NamedTuple

from scipy.signal import lfilter

from rover_hil.drives.arrays import Array


class ContactSpring(NamedTuple):
    """The contacts of a rover in place.

    Attributes:
        period_s: 1 / w.
        damping_s: a.
        drag_s: b.
    """

    period_s: float
    damping_s: float
    drag_s: float

    @property
    def frequency_hz(self) -> float:
        """Frequency at which the body springs on its contacts."""
        return 1.0 / (math.tau * self.period_s)

    def response(self, frequency_hz: float) -> complex:
        """Return the turn of the body over that of its wheels at a frequency; a negative angle is a lag."""
        s = 1j * math.tau * frequency_hz
        both_s = self.damping_s + self.drag_s
        return (1.0 + self.damping_s * s) / ((self.period_s * s) ** 2 + both_s * s + 1.0)

    def body_rate(self, wheel_rate_rad_s: Array, step_s: float) -> Array:
        """Return the yaw rate of the body for that of its wheels, by the bilinear transform.

        Args:
            wheel_rate_rad_s: At equal steps, shape (n,).
            step_s: Between them.
        """
        per_step = 2.0 / step_s
        square = (self.period_s * per_step) ** 2
        both = (self.damping_s + self.drag_s) * per_step
        damping = self.damping_s * per_step
        turned: Array = lfilter(
            [1.0 + damping, 2.0, 1.0 - damping],
            [square + both + 1.0, 2.0 - 2.0 * square, square - both + 1.0],
            wheel_rate_rad_s,
        )
        return turned
