"""The region that holds the body of the rover with 95 % probability, and its distance from points.

The 95 % region of a normal distribution of x and y is the ellipse of all points c with
(c - p)^T P^-1 (c - p) <= k: the squared Mahalanobis distance is chi-square with two degrees of freedom, whose
distribution function is 1 - exp(-k / 2). The farthest and the nearest point of an ellipse from another point
solve one equation each (Golub and Van Loan, Matrix Computations, 4th edition, section 6.1.3).
"""

import cmath
import math
from collections.abc import Callable
from typing import NamedTuple, Self

from controllers.estimation.pose_estimate import PoseEstimate

CHI_SQUARE = -2.0 * math.log(1.0 - 0.95)
"""Quantile of 95 % of the chi-square distribution with two degrees of freedom."""
HALVINGS = 60
"""A bracket that is halved so often is at the resolution of its numbers."""


class Region(NamedTuple):
    """All points within `body_m` of an ellipse.

    Attributes:
        centre: Centre of the ellipse as x + i y, in m.
        xx: Shape matrix of the ellipse, in m^2: the ellipse reaches by sqrt(n^T S n) in the direction n.
        xy: Of the same matrix.
        yy: Of the same matrix.
        body_m: Radius of the body about its origin.
    """

    centre: complex
    xx: float
    xy: float
    yy: float
    body_m: float

    @classmethod
    def of(cls, estimate: PoseEstimate, body_m: float) -> Self:
        """Return the 95 % region of the position of an estimate, with the body."""
        xx, xy, _, yy, _, _ = estimate.covariance
        centre = complex(estimate.x_m, estimate.y_m)
        return cls(centre, CHI_SQUARE * xx, CHI_SQUARE * xy, CHI_SQUARE * yy, body_m)

    @classmethod
    def of_line(cls, start: complex, end: complex, body_m: float) -> Self:
        """Return what a body covers on a straight line: the ellipse is the line itself."""
        half = 0.5 * (end - start)
        return cls(start + half, half.real * half.real, half.real * half.imag, half.imag * half.imag, body_m)

    @property
    def is_known(self) -> bool:
        """Whether every number is finite, and so small that no product below exceeds the range of numbers."""
        x_m, y_m = self.centre.real, self.centre.imag
        size_m2 = x_m * x_m + y_m * y_m + abs(self.xx) + abs(self.yy) + abs(self.xy)
        return math.isfinite(size_m2 * size_m2)

    def shape(self, one: complex, other: complex) -> float:
        """Return one^T S other, of two directions."""
        across = one.real * other.imag + one.imag * other.real
        return self.xx * one.real * other.real + self.xy * across + self.yy * one.imag * other.imag

    def extent_m(self, direction: complex) -> float:
        """Return how far the ellipse reaches from its centre in a direction of length 1."""
        return math.sqrt(max(0.0, self.shape(direction, direction)))

    @property
    def longest_m(self) -> float:
        """Semi-axis of the ellipse in its longest direction."""
        return self._axes()[0]

    def from_nearest(self, point: complex) -> complex:
        """Return the vector to a point from the nearest point of the ellipse; 0 where the point is inside.

        Its nearest point is (a^2 u / (a^2 + t), b^2 v / (b^2 + t)) for the point (u, v) in the system of the
        axes a and b, with the t >= 0 for which that lies on the ellipse.
        """
        a, b, axes = self._axes()
        u, v = _parts((point - self.centre) / axes)
        if u * u * b * b + v * v * a * a <= a * a * b * b and u <= a and v <= b:
            return 0j

        def is_outside(t: float) -> bool:
            return math.hypot(a * u / (a * a + t), b * v / (b * b + t)) > 1.0

        t = _root(is_outside, math.hypot(a * u, b * v))
        nearest = complex(_share(a * a * u, a * a + t), _share(b * b * v, b * b + t))
        return _signed(complex(u, v) - nearest, (point - self.centre) / axes) * axes

    def to_farthest(self, point: complex) -> complex:
        """Return the vector from a point to the farthest point of the ellipse.

        As for the nearest one, with t < -a^2 of the longer axis a.
        """
        a, b, axes = self._axes()
        seen = (self.centre - point) / axes
        u, v = _parts(seen)

        def is_outside(s: float) -> bool:
            return math.hypot(a * u / s, b * v / (a * a - b * b + s)) > 1.0

        s = _root(is_outside, math.hypot(a * u, b * v))
        y = min(b, _share(b * b * v, a * a - b * b + s))
        x = a * math.sqrt(max(0.0, 1.0 - _share(y, b) ** 2))
        return _signed(complex(u + x, v + y), seen) * axes

    def _axes(self) -> tuple[float, float, complex]:
        """Return the longer and the shorter semi-axis, and the direction of the longer one."""
        mean, half = 0.5 * (self.xx + self.yy), math.hypot(0.5 * (self.xx - self.yy), self.xy)
        long_m, short_m = math.sqrt(max(0.0, mean + half)), math.sqrt(max(0.0, mean - half))
        return long_m, short_m, cmath.rect(1.0, 0.5 * math.atan2(2.0 * self.xy, self.xx - self.yy))


def _root(is_below: Callable[[float], bool], high: float) -> float:
    """Return the root between 0 and `high`, below which `is_below` holds; 0 for none."""
    low = 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if middle > 0.0 and is_below(middle) else (low, middle)
    return high


def _share(part: float, whole: float) -> float:
    return part / whole if whole > 0.0 else 0.0


def _parts(vector: complex) -> tuple[float, float]:
    return abs(vector.real), abs(vector.imag)


def _signed(vector: complex, like: complex) -> complex:
    """Return a vector of the first quadrant in the quadrant of another."""
    return complex(math.copysign(vector.real, like.real), math.copysign(vector.imag, like.imag))
