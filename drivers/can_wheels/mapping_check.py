"""Finds what in a mapping does not fit its DBC file.

Messages that the mapping does not name are not looked at: a vehicle's DBC file is full of mistakes in them.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from itertools import combinations

from cantools.database.can import Database, Message, Signal

from drivers.can_wheels.layout import bits_of, choices_of
from drivers.can_wheels.mapping import (
    CanWheelsMapping,
    NamesSignals,
    PositionSource,
    Protection,
)
from drivers.can_wheels.signals import raw_limits, raw_value
from drivers.errors import ConfigError
from drivers.settings import Settings

LONGEST_MESSAGE = 8


def find_mistakes(mapping: CanWheelsMapping, database: Database) -> list[str]:
    """Return what is wrong, a line for each mistake; the key in the mapping file begins each."""
    mistakes = list(_find_wrong_names("", mapping, database))
    return mistakes or list(_find_wrong_messages(mapping, database))


def close_match(name: str, known: Iterable[str]) -> str:
    """Return a suggestion of the most similar known name, "" without one."""
    close = get_close_matches(name, known, n=1, cutoff=0.5)
    return f"; did you mean '{close[0]}'?" if close else ""


def _find_wrong_names(key: str, value: object, database: Database) -> Iterator[str]:
    """Yield what is wrong with the names below `value`; `key` is their place in the mapping file."""
    if isinstance(value, NamesSignals):
        for message_name, signal_name, held in value.names():
            try:
                message = _find_message(key, database, message_name)
                if signal_name is not None:
                    signal = _find_signal(key, message, signal_name)
                    _check_signal(key, message, signal)
                    _check_fit(key, value, signal, held)
                    _check_page(key, value, message, signal)
            except ConfigError as error:
                yield str(error)
    if isinstance(value, Settings):
        for name in type(value).model_fields:
            yield from _find_wrong_names(f"{key}.{name}".lstrip("."), getattr(value, name), database)
    elif isinstance(value, tuple):
        for index, part in enumerate(value):
            yield from _find_wrong_names(f"{key}.{index}", part, database)


def _find_message(where: str, database: Database, name: str) -> Message:
    named = [message for message in database.messages if message.name == name]
    if not named:
        names = [message.name for message in database.messages]
        raise ConfigError(f"{where}: the DBC file has no message '{name}'{_did_you_mean(name, names)}")
    if len(named) > 1:
        raise ConfigError(
            f"{where}: the DBC file has {len(named)} messages '{name}'; rename those of other devices in it"
        )
    if named[0].length > LONGEST_MESSAGE:
        raise ConfigError(
            f"{where}: message '{name}' is {named[0].length} bytes long; only classic CAN frames of up to "
            f"{LONGEST_MESSAGE} bytes are supported"
        )
    return named[0]


def _find_signal(where: str, message: Message, name: str) -> Signal:
    named = [signal for signal in message.signals if signal.name == name]
    if not named:
        hint = _did_you_mean(name, [signal.name for signal in message.signals])
        raise ConfigError(f"{where}: message '{message.name}' has no signal '{name}'{hint}")
    if len(named) > 1:
        raise ConfigError(
            f"{where}: message '{message.name}' has {len(named)} signals '{name}'; remove from the DBC file "
            "those that the device does not send"
        )
    return named[0]


def _check_signal(where: str, message: Message, signal: Signal) -> None:
    name = f"signal '{signal.name}' of message '{message.name}'"
    if signal.scale == 0 or not math.isfinite(signal.scale) or not math.isfinite(signal.offset):
        raise ConfigError(
            f"{where}: {name} has factor {signal.scale:g} and offset {signal.offset:g} in the DBC file, so "
            "it carries no value; correct the factor there"
        )
    if max(bits_of(signal)) >= 8 * message.length:
        raise ConfigError(f"{where}: {name} lies outside of the message; correct the DBC file")
    if not _is_choice_told(message, signal):
        raise ConfigError(
            f"{where}: the DBC file does not say which multiplexer of message '{message.name}' chooses what; "
            "correct its lines SG_MUL_VAL_"
        )


def _is_choice_told(message: Message, signal: Signal) -> bool:
    """Return whether it is known in which frames a signal is; cantools drops what it does not understand."""
    try:
        choices_of(message, signal.name)
    except KeyError:
        return False
    multiplexers = {each.name for each in message.signals if each.is_multiplexer}
    return len(multiplexers) < 2 or multiplexers <= {each.multiplexer_signal for each in message.signals}


def _check_fit(where: str, part: NamesSignals, signal: Signal, held: float | None) -> None:
    low, high = raw_limits(signal)
    if held is not None and not low <= raw_value(signal, held) <= high:
        raise ConfigError(f"{where}: signal '{signal.name}' cannot hold {held:g}; correct the value")
    first_bit = 0 if signal.byte_order == "little_endian" else 7
    is_one_byte = signal.length == 8 and signal.start % 8 == first_bit
    if isinstance(part, Protection) and signal.name == part.checksum and not is_one_byte:
        raise ConfigError(
            f"{where}: checksum '{signal.name}' is not one whole byte; only such checksums are supported"
        )
    if isinstance(part, PositionSource) and signal.name == part.signal:
        _check_wrap(where, part, signal)


def _check_wrap(where: str, part: PositionSource, signal: Signal) -> None:
    if signal.is_float:
        if part.turns is not None and part.wrap is None:
            raise ConfigError(f"{where}: turns: give also after how much the position wraps, as `wrap`")
        return
    most = abs(signal.scale) * 2**signal.length
    if part.wrap is not None and part.wrap > most:
        raise ConfigError(
            f"{where}: wrap = {part.wrap:g} is more than signal '{signal.name}' can hold, "
            f"{most:g}; correct it"
        )


def _check_page(where: str, part: NamesSignals, message: Message, signal: Signal) -> None:
    choices = choices_of(message, signal.name)
    if isinstance(part, Protection) and choices:
        raise ConfigError(
            f"{where}: '{signal.name}' of message '{message.name}' is multiplexed; counters and checksums "
            "must be in every frame"
        )
    if isinstance(part, PositionSource) and choices != choices_of(message, part.signal):
        raise ConfigError(
            f"{where}: '{signal.name}' is never in one frame with '{part.signal}'; leave it out"
        )


def _find_wrong_messages(mapping: CanWheelsMapping, database: Database) -> Iterator[str]:
    """Yield what is wrong with the messages as a whole, once all names have been found."""
    used: dict[str, set[str]] = {}
    for part in parts_of(mapping):
        for message_name, signal_name, _ in part.names():
            used.setdefault(message_name, set()).update(() if signal_name is None else (signal_name,))
    sent = {
        part.message for wheel in mapping.wheel for part in (wheel.setpoint, wheel.steering_setpoint) if part
    }
    sent |= {frame.message for frame in (*mapping.start, *mapping.stop)}
    by_number: dict[tuple[int, bool], str] = {}
    for name, signals in used.items():
        message = database.get_message_by_name(name)
        if name in sent and message.is_multiplexed():
            yield f"dbc: message '{name}' is multiplexed; such messages are read, but never sent"
            continue
        written = {signal.name for signal in message.signals} if name in sent else set()
        yield from _find_overlaps(message, signals | written)
        first_name = by_number.setdefault((message.frame_id, message.is_extended_frame), name)
        if first_name != name:
            yield f"dbc: messages '{first_name}' and '{name}' have one identifier; correct the DBC file"
    power = mapping.power
    if power is not None and power.current is not None:
        message = database.get_message_by_name(power.voltage.message)
        if choices_of(message, power.voltage.signal) != choices_of(message, power.current.signal):
            yield "power: voltage and current are never in one frame; leave the current out"


def parts_of(value: object) -> Iterator[NamesSignals]:
    """Yield the parts of a mapping that name signals."""
    if isinstance(value, NamesSignals):
        yield value
    if isinstance(value, Settings):
        for name in type(value).model_fields:
            yield from parts_of(getattr(value, name))
    elif isinstance(value, tuple):
        for part in value:
            yield from parts_of(part)


def _find_overlaps(message: Message, names: Iterable[str]) -> Iterator[str]:
    """Yield each signal in use of which some bits belong to another signal in the same frame as well."""
    used = set(names)
    for name in names:
        used |= {choice.multiplexer for choice in choices_of(message, name)}
    for first, second in combinations(message.signals, 2):
        is_used = first.name in used or second.name in used
        if is_used and bits_of(first) & bits_of(second) and _can_meet(message, first, second):
            yield (
                f"dbc: signals '{first.name}' and '{second.name}' of message '{message.name}' overlap; "
                "remove from the DBC file the one that you do not use"
            )


def _can_meet(message: Message, signal: Signal, neighbour: Signal) -> bool:
    """Return whether a frame can hold both signals."""
    try:
        first, second = choices_of(message, signal.name), choices_of(message, neighbour.name)
    except KeyError:
        return True
    return not any(
        choice.multiplexer == condition.multiplexer and not choice.values & condition.values
        for choice in first
        for condition in second
    )


def _did_you_mean(name: str, known: Sequence[str]) -> str:
    return close_match(name, known) or f"; it has {', '.join(known[:8])}"
