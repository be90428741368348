"""Decode signals of CAN messages from many frames at once.

The numbers equal those of cantools and of the codec of `drivers.can_wheels` to the last bit.
"""

import math

import numpy as np
from cantools.database.can import Message, Signal
from numpy.typing import NDArray

from drivers.can_wheels.layout import bits_of, choices_of
from rover_hil.drives.arrays import Array, Flags

WORD_BITS = 64
_FLOATS = {16: "f2", 32: "f4", 64: "f8"}


class MessageFrames:
    """Frames of one message.

    Args:
        message: Of at most 8 bytes.
        lengths: Number of data bytes of each frame, n.
        data: Data bytes, zero behind the length, n x 8.

    Attributes:
        is_whole: Which frames are at least as long as the message, n; of others no signal is decoded.
    """

    def __init__(self, message: Message, lengths: NDArray[np.uint8], data: NDArray[np.uint8]) -> None:
        self._message = message
        self.is_whole: Flags = lengths >= message.length
        words = np.ascontiguousarray(data)
        self._words = {
            "little_endian": words.view("<u8").ravel().astype(np.uint64, copy=False),
            "big_endian": words.view(">u8").ravel().astype(np.uint64),
        }

    def raw(self, name: str) -> NDArray[np.int64] | NDArray[np.uint64] | Array:
        """Return the raw numbers of a signal in all frames, whether they hold it or not, n.

        Raises:
            KeyError: The message has no such signal, or it lies outside of 8 bytes.
        """
        signal = self._message.get_signal_by_name(name)
        if max(bits_of(signal)) >= WORD_BITS:
            raise KeyError(name)
        shift = signal.start
        if signal.byte_order == "big_endian":
            shift = WORD_BITS - (8 * (signal.start // 8) + 7 - signal.start % 8) - signal.length
        bits = self._words[signal.byte_order] >> np.uint64(shift)
        if signal.length < WORD_BITS:
            bits = bits & np.uint64(2**signal.length - 1)
        if signal.is_float:
            kind = _FLOATS[signal.length]
            return bits.astype(f"u{signal.length // 8}").view(kind).astype(np.float64)
        if not signal.is_signed:
            return bits
        sign = np.int64(-(2 ** (WORD_BITS - 1)) if signal.length == WORD_BITS else 2 ** (signal.length - 1))
        return bits.view(np.int64) if signal.length == WORD_BITS else (bits.view(np.int64) ^ sign) - sign

    def is_held(self, name: str) -> Flags:
        """Return in which frames a signal is: long enough, and chosen by the multiplexers, n.

        Raises:
            KeyError: As for `choices_of`.
        """
        held = self.is_whole.copy()
        for choice in choices_of(self._message, name):
            held &= np.isin(self.raw(choice.multiplexer), list(choice.values))
        return held

    def values(self, name: str) -> Array:
        """Return a signal in the unit of the DBC file in all frames, NaN where they do not hold it, n."""
        numbers = _scaled(self._message.get_signal_by_name(name), self.raw(name))
        numbers[~self.is_held(name)] = math.nan
        return numbers


def _scaled(signal: Signal, raw: NDArray[np.int64] | NDArray[np.uint64] | Array) -> Array:
    """Return physical numbers; whole factors are applied to whole numbers, as cantools does."""
    scale, offset = signal.scale, signal.offset
    is_whole = not signal.is_float and float(scale).is_integer() and float(offset).is_integer()
    if is_whole and signal.length + int(abs(scale)).bit_length() + int(abs(offset)).bit_length() < WORD_BITS:
        return (raw.astype(np.int64) * np.int64(scale) + np.int64(offset)).astype(np.float64)
    if is_whole:
        whole = [int(number) * int(scale) + int(offset) for number in raw.tolist()]
        return np.array(whole, np.float64)
    numbers = raw.astype(np.float64)
    return numbers if (scale, offset) == (1, 0) else numbers * scale + offset
