"""Least squares through zero."""

import math


class Slope:
    """Least squares of y over x, through zero.

    Attributes:
        xx: Sum of x².
        length: Sum of |x|.
    """

    def __init__(self) -> None:
        self.xx = self._xy = self._yy = self.length = self._count = 0.0

    def fade(self, kept: float) -> None:
        """Let all that was added weigh this share of before."""
        self.xx, self._xy, self._yy = kept * self.xx, kept * self._xy, kept * self._yy
        self.length, self._count = kept * self.length, kept * self._count

    def add(self, x: float, y: float) -> None:
        """Add a pair of values."""
        self.xx, self._xy, self._yy = self.xx + x * x, self._xy + x * y, self._yy + y * y
        self.length += abs(x)
        self._count += 1.0

    @property
    def slope(self) -> float:
        """Slope; 0 without x."""
        return self._xy / self.xx if self.xx > 0.0 else 0.0

    @property
    def sd(self) -> float:
        """Standard deviation of the slope, by what it leaves; infinite with less than two values."""
        if self._count < 2.0 or self.xx <= 0.0:
            return math.inf
        residual = max(0.0, self._yy - self._xy * self.slope)
        return math.sqrt(residual / (self._count - 1.0) / self.xx)
