"""Physical constants that define units."""

STANDARD_GRAVITY_M_S2 = 9.80665
"""Standard acceleration of free fall, exact by definition (3rd CGPM, 1901); one g of a datasheet."""
