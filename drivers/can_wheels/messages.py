"""One CAN message, read or written: length, checksum, rolling counter, limits."""

import math
from collections.abc import Callable, Iterable, Mapping

from cantools.database.can import Message

from drivers.can.frame import EXTENDED_FLAG, CanFrame, pack_can_frame
from drivers.can_wheels.layout import Layout
from drivers.can_wheels.mapping import Protection
from drivers.can_wheels.signals import raw_limits, raw_value
from drivers.driver import Rejection

TOO_SHORT = Rejection("too_short")
CHECKSUM = Rejection("checksum")
COUNTER_REPEAT = Rejection("counter_repeat")
COUNTER_BACKWARDS = Rejection("counter_backwards")
FRAMES_LOST = Rejection("frames_lost")
NOT_FINITE = Rejection("not_finite")
OUT_OF_RANGE = Rejection("out_of_range")


def bus_id(message: Message) -> int:
    """Return the identifier of a message, with the flag of a 29-bit one."""
    return message.frame_id | (EXTENDED_FLAG if message.is_extended_frame else 0)


def _crc8_table() -> bytes:
    table = bytearray()
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = (crc << 1) ^ 0x11D if crc & 0x80 else crc << 1
        table.append(crc)
    return bytes(table)


_CRC8_TABLE = _crc8_table()


def crc8_j1850(data: bytes) -> int:
    """Return the CRC-8 of SAE J1850: polynomial 0x1D, start 0xFF, result inverted."""
    crc = 0xFF
    for byte in data:
        crc = _CRC8_TABLE[crc ^ byte]
    return crc ^ 0xFF


def xor8(data: bytes) -> int:
    """Return all bytes combined by exclusive or."""
    result = 0
    for byte in data:
        result ^= byte
    return result


def sum8(data: bytes) -> int:
    """Return the sum of all bytes modulo 256."""
    return sum(data) & 0xFF


ALGORITHMS: Mapping[str, Callable[[bytes], int]] = {"crc8_j1850": crc8_j1850, "xor8": xor8, "sum8": sum8}


def raw_values(message: Message, physical: Mapping[str, float]) -> dict[str, float]:
    """Return the raw numbers for physical values, by signal."""
    return {name: raw_value(message.get_signal_by_name(name), value) for name, value in physical.items()}


class _Checksum:
    """Where the checksum of a message is, and how it is computed from all other bytes."""

    def __init__(self, message: Message, signal: str, algorithm: str) -> None:
        self.index = message.get_signal_by_name(signal).start // 8
        self._algorithm = ALGORITHMS[algorithm]

    def of(self, data: bytes) -> int:
        return self._algorithm(data[: self.index] + data[self.index + 1 :])


class _Protected:
    """Common part of reading and writing a message."""

    def __init__(self, message: Message, signals: Iterable[str], protection: Protection | None) -> None:
        self._message = message
        self._checksum: _Checksum | None = None
        self._counter: str | None = None
        self._modulus = 1
        counters = () if protection is None or protection.counter is None else (protection.counter,)
        self._layout = Layout(message, {*signals, *counters})
        if protection is None:
            return
        if protection.checksum is not None and protection.algorithm is not None:
            self._checksum = _Checksum(message, protection.checksum, protection.algorithm)
        if protection.counter is not None:
            self._counter = protection.counter
            bits = message.get_signal_by_name(protection.counter).length
            self._modulus = protection.counter_modulus or 2**bits


class MessageReader(_Protected):
    """Checks and unpacks one kind of message; a message is accepted as a whole or not at all.

    A counter that does not advance, or steps back by up to a quarter of its range, rejects the message, as
    its values are old. A jump forwards is only counted: messages were lost, but this one is fresh.

    Args:
        message: The message.
        signals: Names of the signals in use; they must be finite and within the limits of the DBC file.
        protection: Its counter and checksum.
        watched: Further signals to read, whatever their values.
    """

    def __init__(
        self,
        message: Message,
        signals: Iterable[str],
        protection: Protection | None,
        watched: Iterable[str] = (),
    ) -> None:
        signals = list(signals)
        super().__init__(message, [*signals, *watched], protection)
        self._limits = tuple((name, *raw_limits(message.get_signal_by_name(name))) for name in signals)
        self._length = message.length
        self._last_counter: int | None = None

    def reset(self) -> None:
        """Accept any counter next."""
        self._last_counter = None

    def read(self, data: bytes) -> tuple[Mapping[str, float] | None, Rejection | None]:
        """Return the raw numbers of the signals that the frame holds, or None, and the rejection, or None.

        Longer data than the message has is accepted: many devices pad to eight bytes.
        """
        data = data[: self._length]
        if len(data) < self._length:
            return None, TOO_SHORT
        if self._checksum is not None and self._checksum.of(data) != data[self._checksum.index]:
            return None, CHECKSUM
        values = self._layout.unpack(data)
        rejection = None if self._counter is None else self._check_counter(int(values[self._counter]))
        if rejection is not None and rejection is not FRAMES_LOST:
            return None, rejection
        for name, low, high in self._limits:
            value = values.get(name)
            if value is not None and not low <= value <= high:
                return None, OUT_OF_RANGE if math.isfinite(value) else NOT_FINITE
        return values, rejection

    def _check_counter(self, counter: int) -> Rejection | None:
        last = self._last_counter
        step = 1 if last is None else (counter - last) % self._modulus
        if step == 0:
            return COUNTER_REPEAT
        if step >= self._modulus - self._modulus // 4:
            return COUNTER_BACKWARDS
        self._last_counter = counter
        return None if step == 1 else FRAMES_LOST


class MessageWriter(_Protected):
    """Packs one kind of message.

    Args:
        message: The message.
        protection: Its counter, which starts at 0, and checksum.
        signals: Names of the signals to write; by default all.
    """

    def __init__(
        self, message: Message, protection: Protection | None, signals: Iterable[str] | None = None
    ) -> None:
        names = {signal.name for signal in message.signals} if signals is None else set(signals)
        super().__init__(message, names, protection)
        self._template = {signal.name: signal.raw_initial or 0 for signal in message.signals}
        self._next_counter = 0

    def write(self, raw_values: Mapping[str, float]) -> bytes:
        """Return the 16-byte frame with raw numbers by signal, which must be within the signals' limits.

        A missing signal takes the start value of the DBC file, or 0. Multiplexers choose which are written.
        """
        values = {**self._template, **raw_values}
        if self._counter is not None:
            values[self._counter] = self._next_counter
            self._next_counter = (self._next_counter + 1) % self._modulus
        data = self._layout.pack(values)
        if self._checksum is not None:
            index = self._checksum.index
            data = data[:index] + bytes((self._checksum.of(data),)) + data[index + 1 :]
        return pack_can_frame(CanFrame(self._message.frame_id, data, self._message.is_extended_frame))
