"""Reads a mapping and its DBC file, and checks that they fit each other."""

import logging
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cantools
from cantools.database.can import Database, Message, Signal
from pydantic import ValidationError

from drivers.can_wheels.layout import bits_of, choices_of
from drivers.can_wheels.mapping import (
    CanWheelsMapping,
    MeasuredSignal,
    PowerMapping,
    Protection,
    Setpoint,
    SignalName,
    SpeedSource,
    SteeringSource,
    WheelMapping,
    YawRateSource,
)
from drivers.can_wheels.mapping_check import close_match, find_mistakes, parts_of
from drivers.can_wheels.signals import Scale, make_scale
from drivers.errors import ConfigError
from drivers.files import SETTINGS_BYTES, is_file, read_bytes
from drivers.settings import direct_mistakes, read_toml

logging.getLogger("cantools").addHandler(logging.NullHandler())
"""Of two messages with one identifier, only those that a mapping names matter."""
SHIPPED_FOLDER = Path(__file__).parent
MOST_BITS = 512
MOST_SIGNAL_BITS = 64
_OF_A_WHEEL = re.compile(r"wheel\.(\d+)\.(\w+)")
MOST_MESSAGE_BYTES = 1785
"""Of the transport protocol of J1939; a frame of CAN FD has 64."""
MOST_MULTIPLEX_VALUES = 16_384
"""Values in all ranges of SG_MUL_VAL_ of a file, which cantools lists singly."""
_TEXT = re.compile(r'"(?:\\"|[^"])*?"|//[^\n]*')
"""Texts and remarks of a DBC file, as cantools separates them."""
_LENGTH = re.compile(r"BO_(?!\w)\s*+[-+]?\d++\s*+\w++\s*+:\s*+[-+]?(\d++)")
"""Number of bytes of a message."""
_RANGES = re.compile(r"SG_MUL_VAL_([^;]*)")
_RANGE = re.compile(r"(?<!\d)(\d++)\s*+[-+](\d++)")
_BITS = re.compile(r"(?<!\d)(\d++)\s*+\|\s*+[-+]?(\d++)\s*+@")
"""First bit and number of bits of a signal."""
_BEGIN = 'VERSION ""\nBU_:\n'
_MESSAGE = re.compile(
    r"^[ \t]*BO_[ \t]+(?P<number>\d+)[ \t]+(?P<name>[^\s:]+).*(?:\n(?:[ \t]*SG_[ \t].*|[ \t]*$))*",
    re.MULTILINE,
)
"""A message with its signals."""
_STATEMENT = re.compile(
    r"^[ \t]*(?:SIG_VALTYPE_|SG_MUL_VAL_|VAL_)[ \t]+(?P<number>\d+)[^;\"]*(?:\"[^\"]*\"[^;\"]*)*;",
    re.MULTILINE,
)
"""What says more of the signals of a message."""
_TURNS = re.compile(
    r"(turn|revolution|rotation|wrap|lap)(s|_?(count|counter|cnt|num|number|no))?$", re.IGNORECASE
)


@dataclass(frozen=True, slots=True)
class BusDescription:
    """A mapping and the DBC files it refers to; every name in the mapping has been found in them."""

    mapping_file: Path
    dbc_files: tuple[Path, ...]
    mapping: CanWheelsMapping
    database: Database

    def message(self, name: str) -> Message:
        """Return a message that the mapping names."""
        return self.database.get_message_by_name(name)

    def protection(self, message: str) -> Protection | None:
        """Return the protection of a message; None without one."""
        return next((entry for entry in self.mapping.protection if message in entry.messages), None)

    def wheel_scales(self, wheel: WheelMapping) -> dict[str, Scale]:
        """Return the conversions of a wheel's signals, by quantity, e.g. position or steering."""
        turning = wheel.sign / wheel.gear_ratio
        sources: dict[str, tuple[MeasuredSignal | None, float]] = {
            "position": (wheel.position, turning),
            "speed": (wheel.speed, _speed_factor(wheel, wheel.speed)),
            "current": (wheel.current, wheel.sign if wheel.current_is_signed else 1.0),
            "voltage": (wheel.voltage, wheel.sign),
        }
        return {
            quantity: self._scale(source, factor)
            for quantity, (source, factor) in sources.items()
            if source is not None
        } | ({} if wheel.steering is None else {"steering": self.steering_scale(wheel, wheel.steering)})

    def setpoint_scale(self, wheel: WheelMapping, setpoint: Setpoint) -> Scale:
        """Return the conversion of a wheel's speed setpoint."""
        return self._scale(setpoint, _speed_factor(wheel, setpoint))

    def steering_scale(self, wheel: WheelMapping, source: SteeringSource) -> Scale:
        """Return the conversion of a wheel's steering angle, measured or commanded."""
        scale = self._scale(source, wheel.steering_sign)
        zero_rad = wheel.steering_sign * source.zero * source.si_per_unit
        return replace(scale, si_offset=scale.si_offset - zero_rad)

    def power_scales(self, power: PowerMapping) -> tuple[Scale, Scale | None]:
        """Return the conversions of supply voltage and current."""
        current = None if power.current is None else self._scale(power.current, 1.0)
        return self._scale(power.voltage, 1.0), current

    def yaw_rate_scale(self, source: YawRateSource) -> Scale:
        """Return the conversion of the yaw rate."""
        scale = self._scale(source, source.sign)
        return replace(scale, si_offset=scale.si_offset - source.sign * source.zero * source.si_per_unit)

    def position_span(self, wheel: WheelMapping) -> float | None:
        """Return after how many raw steps a wheel's position wraps; None for never."""
        source = wheel.position
        if source is None:
            return None
        signal = self._signal(source)
        if source.wrap is not None:
            span = source.wrap / abs(signal.scale)
            return span if signal.is_float else round(span)
        return None if signal.is_float else 2**signal.length

    def turn_scale(self, wheel: WheelMapping) -> Scale | None:
        """Return the conversion of a wheel's count of turns to raw steps of its position, if there is one."""
        source, span = wheel.position, self.position_span(wheel)
        if source is None or source.turns is None or span is None:
            return None
        return make_scale(source.message, self.message(source.message).get_signal_by_name(source.turns), span)

    def counter_span(self, wheel: WheelMapping) -> float | None:
        """Return after how many raw steps a wheel's position wraps together with its count of turns."""
        turns, span = self.turn_scale(wheel), self.position_span(wheel)
        if turns is None or span is None:
            return span
        signal = self.message(turns.message).get_signal_by_name(turns.signal)
        return None if signal.is_float else abs(turns.si_per_raw) * 2**signal.length

    def unmarked_revolution(self, wheel: WheelMapping) -> float | None:
        """Return the raw steps of a revolution, where the mapping does not state after what it wraps."""
        source = wheel.position
        if source is None or source.wrap is not None or source.turns is not None:
            return None
        revolution = source.units_per_revolution / abs(self._signal(source).scale)
        span = self.position_span(wheel)
        return revolution if span is None or revolution < span else None

    def unnamed_turns(self, wheel: WheelMapping) -> str | None:
        """Return the signal beside a wheel's position that by its name counts turns, though not `turns`."""
        source = wheel.position
        if source is None or source.turns is not None or self.position_span(wheel) is None:
            return None
        message = self.message(source.message)
        choices = choices_of(message, source.signal)
        names = [signal.name for signal in message.signals]
        unnamed = [
            signal.name
            for signal in message.signals
            if _TURNS.search(signal.name)
            and not signal.is_float
            and signal.name != source.signal
            and names.count(signal.name) == 1
            and choices_of(message, signal.name) == choices
            and max(bits_of(signal)) < 8 * message.length
            and not bits_of(signal) & bits_of(self._signal(source))
        ]
        return unnamed[0] if len(unnamed) == 1 else None

    def value_names(self, name: SignalName) -> dict[int, str]:
        """Return the names that the DBC file gives to values of a signal."""
        return {value: str(text) for value, text in (self._signal(name).choices or {}).items()}

    def position_wrap_rad(self, wheel: WheelMapping) -> float | None:
        """Return after which angle a wheel's position wraps; None where the mapping does not give it."""
        span = self.counter_span(wheel)
        return None if span is None else span * abs(self.wheel_scales(wheel)["position"].si_per_raw)

    def _signal(self, name: SignalName) -> Signal:
        return self.message(name.message).get_signal_by_name(name.signal)

    def _scale(self, source: MeasuredSignal, factor: float) -> Scale:
        return make_scale(source.message, self._signal(source), source.si_per_unit * factor)


def load_mapping(name_or_path: str) -> BusDescription:
    """Read a mapping by the name of a shipped one or the path of a TOML file, and its DBC file.

    Raises:
        ConfigError: A file is missing or wrong; the message names file, key and fix, a line per mistake.
    """
    path = _mapping_path(name_or_path)
    table = read_toml(path, f"mapping {path}", "make it readable")
    try:
        mapping = CanWheelsMapping.model_validate(_fill_in(path, table))
    except ValidationError as error:
        raise ConfigError(_report(path, table, _describe(error))) from error
    dbc_paths = tuple(path.parent / name for name in mapping.dbc)
    needed = {message for part in parts_of(mapping) for message, _, _ in part.names()}
    database = _load_databases(path, dbc_paths, needed)
    mistakes = find_mistakes(mapping, database)
    if mistakes:
        raise ConfigError(_report(path, table, mistakes))
    return BusDescription(path, dbc_paths, mapping, database)


def _speed_factor(wheel: WheelMapping, source: SpeedSource | None) -> float:
    """Return what makes a speed of a source that of the wheel."""
    return wheel.sign / (1.0 if source is not None and source.is_at_rim else wheel.gear_ratio)


def _mapping_path(name_or_path: str) -> Path:
    shipped = {path.stem: path for path in sorted(SHIPPED_FOLDER.glob("*.toml"))}
    if name_or_path in shipped:
        return shipped[name_or_path]
    path = Path(name_or_path)
    if not is_file(path):
        raise ConfigError(
            f"no mapping '{name_or_path}': give the path of a TOML file, beside the configuration or from "
            f"the current folder, or one of {', '.join(shipped)}{close_match(name_or_path, shipped)}"
        )
    return path


def _fill_in(path: Path, table: dict[str, object]) -> dict[str, object]:
    table = dict(table)
    every_wheel = table.pop("every_wheel", {})
    wheels = table.get("wheel")
    if (
        not isinstance(every_wheel, dict)
        or not isinstance(wheels, list)
        or not all(isinstance(wheel, dict) and "node" in wheel for wheel in wheels)
    ):
        raise ConfigError(
            f"{path}: wheel: give one [[wheel]] with a node per wheel, and what they share in [every_wheel]"
        )
    nodes = [str(wheel["node"]) for wheel in wheels]
    table["wheel"] = [
        _with_node({**_shared_with(wheel, every_wheel), **wheel}, node)
        for wheel, node in zip(wheels, nodes, strict=True)
    ]
    for key in ("start", "stop"):
        entries = table.get(key)
        if isinstance(entries, list):
            table[key] = [filled for entry in entries for filled in _per_node(entry, nodes)]
    protection = table.get("protection")
    if isinstance(protection, list):
        table["protection"] = [
            {**entry, "messages": [name for text in entry["messages"] for name in _per_node(text, nodes)]}
            if isinstance(entry, dict) and isinstance(entry.get("messages"), list)
            else entry
            for entry in protection
        ]
    return table


def _shared_with(wheel: dict[str, object], every_wheel: dict[str, object]) -> dict[str, object]:
    """Return the keys of [every_wheel] that hold for a wheel."""
    if wheel.get("measured", every_wheel.get("measured")) is not False:
        return every_wheel
    return {key: value for key, value in every_wheel.items() if key not in ("position", "speed")}


def _per_node(value: object, nodes: list[str]) -> list[object]:
    if _with_node(value, "") == value:
        return [value]
    return [_with_node(value, node) for node in nodes]


def _with_node(value: object, node: str) -> object:
    if isinstance(value, str):
        return value.replace("{node}", node)
    if isinstance(value, dict):
        return {key: _with_node(part, node) for key, part in value.items()}
    if isinstance(value, list):
        return [_with_node(part, node) for part in value]
    return value


def _describe(error: ValidationError) -> list[str]:
    lines = []
    for detail in direct_mistakes(error.errors()):
        key = ".".join(str(part) for part in detail["loc"]) or "the file"
        text = detail["msg"].removeprefix("Value error, ")
        if detail["type"] == "extra_forbidden":
            text = "unknown key; correct or remove it"
        elif detail["type"] == "missing":
            text = "this key is missing; add it"
        lines.append(f"{key}: {text}")
    return lines


def _report(path: Path, table: Mapping[str, object], mistakes: Sequence[str]) -> str:
    """Return a line per mistake; one under [every_wheel] once, for the first wheel that has it."""
    shared, wheels = table.get("every_wheel"), table.get("wheel")
    lines: list[str] = []
    first_wheels: dict[str, str] = {}
    for mistake in mistakes:
        of_wheel = _OF_A_WHEEL.match(mistake)
        if of_wheel is not None and isinstance(shared, dict) and isinstance(wheels, list):
            wheel, key = of_wheel.groups()
            if key in shared and key not in wheels[int(wheel)]:
                if first_wheels.setdefault(key, wheel) == wheel:
                    lines.append(f"{path}: every_wheel.{mistake[of_wheel.start(2) :]}")
                continue
        lines.append(f"{path}: {mistake}")
    return "\n".join(lines)


def _load_databases(mapping_path: Path, paths: Sequence[Path], needed: Collection[str]) -> Database:
    for path in paths:
        if not is_file(path):
            raise ConfigError(f"{mapping_path}: dbc: no file {path.name} in the same folder")
    return read_dbc_files(paths, needed)


def read_dbc_files(paths: Sequence[Path], needed: Collection[str] = ()) -> Database:
    """Read DBC files as one; a message whose name an earlier file has is left out.

    Args:
        paths: The files.
        needed: As for `read_dbc`.

    Raises:
        ConfigError: A file cannot be read, or holds no CAN messages.
    """
    first, *others = [read_dbc(path, needed) for path in paths]
    if not others:
        return first
    messages = list(first.messages)
    for database in others:
        names = {message.name for message in messages}
        messages += [message for message in database.messages if message.name not in names]
    return Database(messages, strict=False)


def read_dbc(path: Path, needed: Collection[str] = ()) -> Database:
    """Read a DBC file; messages with mistakes are accepted, or left out where they cannot be read.

    Args:
        path: The file.
        needed: Names of messages that must be readable, if they are in the file.

    Raises:
        ConfigError: The file cannot be read, a message that is needed is wrong, or none is sound.
    """
    try:
        text = read_bytes(path, SETTINGS_BYTES).decode("cp1252", "replace").replace("\r\n", "\n")
    except OSError as error:
        raise ConfigError(f"cannot read DBC file {path}: {error.strerror}") from error
    database = None if _size_fault(text) else _load(text)
    if database is None:
        database = _load(_sound_part(path, text, needed))
    if database is None or not database.messages:
        fault = _size_fault(text)
        what = f"a message {fault}: correct or remove it" if fault else "it holds no CAN messages"
        raise ConfigError(f"cannot read DBC file {path}: {what}")
    return database


def _load(text: str) -> Database | None:
    """Return the messages in the text of a DBC file; None where it is none."""
    try:
        database = cantools.database.load_string(text, database_format="dbc", strict=False)
    # What the library raises depends on the mistake.
    except (cantools.Error, ValueError, KeyError, AttributeError, TypeError):
        return None
    return database if isinstance(database, Database) else None


def _sound_part(path: Path, text: str, needed: Collection[str]) -> str:
    """Return a DBC file with the messages that can be read, each with what follows on its signals.

    Raises:
        ConfigError: One that is needed cannot be read.
    """
    about: dict[str, list[str]] = {}
    for statement in _STATEMENT.finditer(text):
        about.setdefault(statement["number"], []).append(statement[0])
    blocks, statements = [], []
    for block in _MESSAGE.finditer(text):
        others = about.get(block["number"], [])
        whole = "\n".join((_BEGIN, block[0], *others, ""))
        fault = _size_fault(whole)
        if not fault and _load(whole) is not None:
            blocks.append(block[0])
            statements += others
        elif block["name"] in needed:
            line = text.count("\n", 0, block.start()) + 1
            raise ConfigError(
                f"cannot read DBC file {path}: message '{block['name']}' in line {line} "
                f"{fault or 'is not written as the format demands'}: correct it"
            )
    return "\n".join((_BEGIN, *blocks, *dict.fromkeys(statements), ""))


def _size_fault(text: str) -> str:
    """Return what in a DBC file is larger than any bus allows, or empty.

    cantools makes tables and formats as long as a message, a signal or a range before it checks them.
    """
    text = _TEXT.sub(" ", text)
    for length in _LENGTH.findall(text):
        if int(length) > MOST_MESSAGE_BYTES:
            return (
                f"has {length[:20]} bytes; CAN FD allows 64 and the transport protocol of J1939 "
                f"{MOST_MESSAGE_BYTES:,}"
            )
    for start, length in _BITS.findall(text):
        if int(start) >= MOST_BITS or int(length) > MOST_SIGNAL_BITS:
            return f"has a signal of {length[:20]} bits from bit {start[:20]}, which fits into no CAN frame"
    ranges = [pair for values in _RANGES.findall(text) for pair in _RANGE.findall(values)]
    if sum(max(0, int(last) - int(first) + 1) for first, last in ranges) > MOST_MULTIPLEX_VALUES:
        return f"has more than {MOST_MULTIPLEX_VALUES:,} values in the ranges of SG_MUL_VAL_"
    return ""
