"""Least squares through zero."""

import math

LEAST_VARIANCE = 1e-10
"""Of a value: below, sums of exact values could not be solved."""


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


class SlopeWithBias(Slope):
    """The same, where y has a part in proportion to the time, too, as by the bias of a gyro.

    Args:
        bias_sd: Standard deviation of that part, per second, before anything was seen.
    """

    def __init__(self, bias_sd: float) -> None:
        super().__init__()
        self._bias_sd = bias_sd
        self._tt = self._xt = self._ty = 0.0

    def fade(self, kept: float) -> None:
        """Let all that was added weigh this share of before."""
        super().fade(kept)
        self._tt, self._xt, self._ty = kept * self._tt, kept * self._xt, kept * self._ty

    def add_over(self, x: float, duration_s: float, y: float) -> None:
        """Add a pair of values, and its time."""
        self.add(x, y)
        self._tt += duration_s**2
        self._xt += x * duration_s
        self._ty += duration_s * y

    @property
    def fitted(self) -> tuple[float, float]:
        """Slope beside the bias, and its standard deviation, infinite with less than three values."""
        if self._count < 3.0 or self.xx <= 0.0:
            return 0.0, math.inf
        slope, variance = self.slope, max(self.sd**2 * self.xx, LEAST_VARIANCE)
        for _ in range(2):
            weight = self._tt + variance / self._bias_sd**2
            determinant = self.xx * weight - self._xt**2
            slope = (self._xy * weight - self._ty * self._xt) / determinant
            bias = (self._ty * self.xx - self._xy * self._xt) / determinant
            left = max(0.0, self._yy - slope * self._xy - bias * self._ty)
            variance = max(left / (self._count - 2.0), LEAST_VARIANCE)
        return slope, math.sqrt(variance * weight / determinant)
