"""Conversion between the raw numbers in a CAN message and SI units."""

import math
import struct
from dataclasses import dataclass

from cantools.database.can import Signal

FLOATS = {16: struct.Struct("<e"), 32: struct.Struct("<f"), 64: struct.Struct("<d")}
LARGEST_FLOAT = {16: 65504.0, 32: 2.0**128 - 2.0**104, 64: 1e300}
ROUNDING = 1e-6
"""Raw steps by which a limit in the DBC file may differ from the intended raw value."""


def raw_value(signal: Signal, physical: float) -> float:
    """Return the raw number for a physical value, rounded where the signal is an integer."""
    raw = (physical - signal.offset) / signal.scale
    return raw if signal.is_float else round(raw)


def raw_limits(signal: Signal) -> tuple[float, float]:
    """Return the smallest and largest valid raw number, from the size of the signal and its DBC limits.

    A factor of 0, as in DBC files with signals that nobody uses, leaves the size.
    """
    low, high = _size_limits(signal)
    if signal.scale == 0:
        return low, high
    bounds = [
        None if bound is None else (bound - signal.offset) / signal.scale
        for bound in (signal.minimum, signal.maximum)
    ]
    if signal.scale < 0:
        bounds.reverse()
    minimum, maximum = bounds
    if minimum is not None:
        low = max(low, minimum if signal.is_float else math.ceil(minimum - ROUNDING))
    if maximum is not None:
        high = min(high, maximum if signal.is_float else math.floor(maximum + ROUNDING))
    return low, high


def _size_limits(signal: Signal) -> tuple[float, float]:
    if signal.is_float:
        return -LARGEST_FLOAT[signal.length], LARGEST_FLOAT[signal.length]
    if signal.is_signed:
        return -(2 ** (signal.length - 1)), 2 ** (signal.length - 1) - 1
    return 0, 2**signal.length - 1


@dataclass(frozen=True, slots=True)
class Scale:
    """Converts one signal: SI = raw * si_per_raw + si_offset.

    Attributes:
        low, high: Limits of the raw number.
        float_format: How the signal stores a float, None for an integer.
        unsigned_span: Number of values of an integer that holds none below zero; None for any other.
    """

    message: str
    signal: str
    si_per_raw: float
    si_offset: float
    low: float
    high: float
    float_format: struct.Struct | None
    unsigned_span: int | None

    @property
    def limits_si(self) -> tuple[float, float]:
        """Least and greatest value in SI units."""
        at_low, at_high = self.to_si(self.low), self.to_si(self.high)
        return min(at_low, at_high), max(at_low, at_high)

    def to_si(self, raw: float) -> float:
        """Return the value in SI units."""
        return raw * self.si_per_raw + self.si_offset

    def to_raw(self, value: float) -> float:
        """Return the raw number for a value in SI units, clipped and rounded as the message will hold it."""
        raw = min(max((value - self.si_offset) / self.si_per_raw, self.low), self.high)
        if self.float_format is None:
            return round(raw)
        stored: float = self.float_format.unpack(self.float_format.pack(raw))[0]
        return stored + 0.0  # no negative zero on the bus


def make_scale(message: str, signal: Signal, si_per_unit: float) -> Scale:
    """Build the conversion of a signal whose physical unit, after the DBC's own scaling, is `si_per_unit`."""
    low, high = raw_limits(signal)
    return Scale(
        message=message,
        signal=signal.name,
        si_per_raw=signal.scale * si_per_unit,
        si_offset=signal.offset * si_per_unit,
        low=low,
        high=high,
        float_format=FLOATS[signal.length] if signal.is_float else None,
        unsigned_span=None if signal.is_float or signal.is_signed or signal.offset else 2**signal.length,
    )
