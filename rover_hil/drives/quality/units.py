"""What a factor between two measurements of one quantity may be: a unit, a ratio, or a scale."""

import math

UNITS = (
    (math.degrees(1.0), "deg where rad is meant, or the other way round"),
    (60.0 / math.tau, "rpm where rad/s is meant, or the other way round"),
    (math.tau, "revolutions where rad is meant, or the other way round"),
    (3.6, "km/h where m/s is meant, or the other way round"),
    (10.0, "mm where cm is meant, or the other way round"),
    (100.0, "cm where m is meant, or the other way round"),
    (1000.0, "mm where m is meant, or ms where s is meant, or the other way round"),
)
SAME_UNIT = 0.12
"""A factor is that of a unit within this share."""


def unit_of(factor: float, others: str) -> str:
    """Return which units differ by a factor, or by its inverse, and what else may.

    Args:
        factor: Positive.
        others: What else a factor may come from.
    """
    size = max(factor, 1.0 / factor)
    named = [text for unit, text in UNITS if abs(size / unit - 1.0) <= SAME_UNIT]
    return ", or ".join([*named, others])
