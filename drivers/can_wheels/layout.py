"""Where the signals of a CAN message are, and which of them a frame holds."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from cantools.database.can import Message, Signal
from cantools.database.utils import create_encode_decode_formats


@dataclass(frozen=True, slots=True)
class Choice:
    """A multiplexer, and its raw values with which a frame holds a signal."""

    multiplexer: str
    values: frozenset[int]


def choices_of(message: Message, name: str) -> tuple[Choice, ...]:
    """Return what a frame must fulfil to hold a signal, the outermost multiplexer first; () for every frame.

    Raises:
        KeyError: The message has no such signal, or not the multiplexer of one, or multiplexers in a circle.
    """
    signals = {signal.name: signal for signal in message.signals}
    signal = signals[name]
    choices: list[Choice] = []
    while signal.multiplexer_ids is not None:
        if len(choices) == len(signals):
            raise KeyError(name)
        choices.insert(0, Choice(signal.multiplexer_signal or "", frozenset(signal.multiplexer_ids)))
        signal = signals[signal.multiplexer_signal or ""]
    return tuple(choices)


def bits_of(signal: Signal) -> frozenset[int]:
    """Return the bits of a signal, byte times eight plus the place in the byte from its low end."""
    if signal.byte_order == "little_endian":
        return frozenset(range(signal.start, signal.start + signal.length))
    first = 8 * (signal.start // 8) + 7 - signal.start % 8
    return frozenset(8 * (bit // 8) + 7 - bit % 8 for bit in range(first, first + signal.length))


class Layout:
    """Where signals of a message are.

    cantools knows the layout; its own `encode` and `decode` look at each signal again in each message.

    Args:
        message: The message.
        names: Signals to read or to write; their multiplexers are added. No two that a frame can hold
            together may overlap.
    """

    def __init__(self, message: Message, names: Iterable[str]) -> None:
        choices = {name: choices_of(message, name) for name in names}
        for above in list(choices.values()):
            for choice in above:
                choices[choice.multiplexer] = choices_of(message, choice.multiplexer)
        groups: dict[tuple[Choice, ...], list[Signal]] = {}
        for signal in message.signals:
            if signal.name in choices:
                groups.setdefault(choices[signal.name], []).append(signal)
        outermost_first = sorted(groups.items(), key=lambda item: len(item[0]))
        self._groups = [(above, _Group(message.length, signals)) for above, signals in outermost_first]
        self._length = message.length

    def unpack(self, data: bytes) -> dict[str, float]:
        """Return the raw numbers of the signals that a frame holds; `data` is as long as the message."""
        values: dict[str, float] = {}
        for choices, group in self._groups:
            if not choices or _are_met(choices, values):
                group.unpack_into(values, data)
        return values

    def pack(self, values: dict[str, float]) -> bytes:
        """Return the message; `values` holds every signal, and is changed: integers are rounded.

        Of signals that share their place, those are written that the multiplexers in `values` choose.
        """
        bits = 0
        for choices, group in self._groups:
            if not choices or _are_met(choices, values):
                bits |= group.pack(values)
        return bits.to_bytes(self._length, "big")


def _are_met(choices: tuple[Choice, ...], values: dict[str, float]) -> bool:
    # A multiplexer that the frame does not hold has no value, but then one further out already differs.
    return all(values[choice.multiplexer] in choice.values for choice in choices)


class _Group:
    """Signals that a frame holds together or not at all."""

    def __init__(self, length: int, signals: Sequence[Signal]) -> None:
        self._length = length
        # cantools takes little-endian signals in the order of their first bits.
        signals = sorted(signals, key=lambda signal: signal.start)
        self._formats = create_encode_decode_formats(signals, length)
        orders = {signal.byte_order for signal in signals}
        self._has_big, self._has_little = "big_endian" in orders, "little_endian" in orders
        self._integers = [signal.name for signal in signals if not signal.is_float]

    def unpack_into(self, values: dict[str, float], data: bytes) -> None:
        if self._has_big:
            values.update(self._formats.big_endian.unpack(data))
        if self._has_little:
            values.update(self._formats.little_endian.unpack(data[::-1]))

    def pack(self, values: dict[str, float]) -> int:
        for name in self._integers:
            values[name] = round(values[name])
        bits = 0
        if self._has_big:
            bits |= int.from_bytes(self._formats.big_endian.pack(values), "big")
        if self._has_little:
            bits |= int.from_bytes(self._formats.little_endian.pack(values), "little")
        return bits
