"""Recognise the drives on a CAN bus: shipped mappings, VESCs, or a DBC file of the user's own."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit
from cantools.database.can import Message, Signal

from drivers.can.frame import CanFrame, pack_can_frame
from drivers.can_wheels.codec import CanWheelsCodec
from drivers.can_wheels.mapping_file import SHIPPED_FOLDER, load_mapping, read_dbc
from drivers.can_wheels.messages import bus_id
from drivers.driver import Rejection
from drivers.errors import ConfigError
from drivers.link import Received
from drivers.samples import WheelSample

HEARTBEAT, LAST_NODE = 0x700, 127
HEARTBEAT_STATES = (0x00, 0x04, 0x05, 0x7F)
"""Boot-up, stopped, operational and pre-operational; CiA 301."""
VESC_STATUS = {9: "status 1", 27: "status 5"}
POSITION = re.compile(r"pos|enc|tick|count|angle", re.IGNORECASE)
SPEED = re.compile(r"speed|vel|rpm", re.IGNORECASE)
CURRENT = re.compile(r"curr|iq", re.IGNORECASE)
CHECKSUM = re.compile(r"check|crc", re.IGNORECASE)
COUNTER = re.compile(r"counter|alive|seq", re.IGNORECASE)
SETPOINT = re.compile(r"set|cmd|command|target|ref|input", re.IGNORECASE)
NUMBERED = re.compile(r"(.*?)(\d+)(.*)")
PLACED = re.compile(
    r"(.*?(?:^|_|(?<=[a-z])))"
    r"((?:[Ff]ront|FRONT|[Mm]id(?:dle)?|MID(?:DLE)?|[Rr]ear|REAR|[Bb]ack|BACK)_?(?:[Ll]eft|LEFT|[Rr]ight|RIGHT)"
    r"|[FMRB][LR]|[Ll]eft|LEFT|[Rr]ight|RIGHT)"
    r"((?:_|[A-Z]|\d|$).*)"
)
"""A message of the wheel at a place, such as `MCU_FL_Feedback`."""
POSITION_UNITS = {
    "rad": "rad",
    "rev": "rev",
    "turns": "rev",
    "deg": "deg",
    "ticks": "ticks",
    "counts": "ticks",
}
SPEED_UNITS = {"rad/s": "rad/s", "rev/s": "rev/s", "turns/s": "rev/s", "rpm": "rpm", "1/min": "rpm"}
STEERING = re.compile(r"steer", re.IGNORECASE)
ANGLE = re.compile(r"angle", re.IGNORECASE)
STEERING_ANGLE = re.compile(r"steer|angle|pos", re.IGNORECASE)
ANGLE_UNITS = {"deg": "deg", "rad": "rad"}
CURRENT_UNITS = {"a": "A", "ma": "mA"}
ALGORITHMS = (None, "crc8_j1850", "xor8", "sum8")
MOST_REJECTED = 0.2
Templates = dict[str, dict[int | str, Message]]
"""Messages by name with `{node}` for number or place of the wheel, then by that."""


@dataclass(frozen=True, slots=True)
class Guess:
    """A mapping that fits a DBC file and what is on the bus.

    Attributes:
        every_wheel: Its keys for all wheels.
        nodes: Numbers of the wheels, or their places, front left first.
        protection: Keys of its protection; empty without one.
        needs_ticks: The position counts ticks of which the number per turn is not known.
    """

    every_wheel: dict[str, dict[str, object]]
    nodes: list[int | str]
    protection: dict[str, object]
    needs_ticks: bool


def shipped_mapping(frames: Sequence[CanFrame]) -> str:
    """Return the shipped mapping whose wheel messages are all on the bus; "" for none."""
    heard = {_number(frame) for frame in frames}
    best = ("", 0)
    for path in sorted(SHIPPED_FOLDER.glob("*.toml")):
        bus = load_mapping(path.stem)
        sources = [
            source
            for wheel in bus.mapping.wheel
            for source in (wheel.position, wheel.speed, wheel.current, wheel.steering)
            if source is not None
        ]
        numbers = {bus_id(bus.message(source.message)) for source in sources}
        if numbers <= heard and len(numbers) > best[1] and _decodes(path, frames):
            best = (path.stem, len(numbers))
    return best[0]


def vesc_nodes(frames: Sequence[CanFrame]) -> list[int]:
    """Return the numbers of the VESCs that send status messages 1 and 5."""
    seen: defaultdict[int, set[int]] = defaultdict(set)
    for frame in frames:
        if frame.is_extended and frame.can_id >> 8 in VESC_STATUS:
            seen[frame.can_id & 0xFF].add(frame.can_id >> 8)
    return sorted(node for node, kinds in seen.items() if kinds == set(VESC_STATUS))


def canopen_nodes(frames: Sequence[CanFrame]) -> list[int]:
    """Return the numbers of the CANopen nodes that send heartbeats, which carry one byte, the state."""
    return sorted(
        {
            frame.can_id - HEARTBEAT
            for frame in frames
            if not frame.is_extended
            and HEARTBEAT < frame.can_id <= HEARTBEAT + LAST_NODE
            and len(frame.data) == 1
            and frame.data[0] in HEARTBEAT_STATES
        }
    )


def guess_mapping(dbc: Path, frames: Sequence[CanFrame]) -> Guess:
    """Return a mapping for the drives of a DBC file, by the names and units of its signals.

    Args:
        dbc: The DBC file.
        frames: What is on the bus: messages that are not there come from the host; where none of these is a
            setpoint, those that are called so.

    Raises:
        ConfigError: The file cannot be read, or has no messages of each wheel with a position or speed and a
            setpoint.
    """
    messages = read_messages(dbc)
    heard = {_number(frame) for frame in frames}
    silent = [message for message in messages if bus_id(message) not in heard]
    if _best(_without_steering(_signals(_templates(silent))), SPEED, SPEED_UNITS, prefer=SETPOINT) is None:
        # The host was on the bus, as in the log of a drive: its messages are known by their names only.
        silent += [each for each in messages if each not in silent and SETPOINT.search(each.name)]
    sent = _templates(message for message in messages if message not in silent)
    taken = _templates(silent)
    from_drives, to_drives = _signals(sent), _signals(taken)
    turning, steering = _without_steering(from_drives), _only_steering(from_drives)
    setpoint = _best(_without_steering(to_drives), SPEED, SPEED_UNITS, prefer=SETPOINT)
    # An angle beside the setpoint of the speed is that of the steering, if the wheel's own motion is
    # measured without a signal of this name.
    beside = {
        signal.name
        for template, signal in to_drives
        if setpoint is not None and template == setpoint[0] and _is_angle(signal)
    }
    others = [each for each in turning if each[1].name not in beside]
    if _best(others, POSITION, POSITION_UNITS) or _best(others, SPEED, SPEED_UNITS):
        steering += [each for each in turning if each not in others]
        turning = others
    position, speed, current = (
        _best(turning, words, units)
        for words, units in ((POSITION, POSITION_UNITS), (SPEED, SPEED_UNITS), (CURRENT, CURRENT_UNITS))
    )
    measured = position or speed
    if measured is None or setpoint is None:
        lack = "setpoint" if measured is not None else "position or speed on the bus"
        raise ConfigError(
            f"{dbc}: no messages with a {lack} of each wheel, by number or place, were recognised: write "
            "the mapping by hand, docs/how-to/drive_your_own_rover.md"
        )
    every_wheel = {
        key: chosen[1]
        for key, chosen in (("position", position), ("speed", speed), ("current", current))
        if chosen
    }
    every_wheel["setpoint"] = setpoint[1]
    angle = _best(steering, STEERING_ANGLE, ANGLE_UNITS)
    angle_setpoint = _best(_only_steering(to_drives), STEERING_ANGLE, ANGLE_UNITS)
    if angle_setpoint is None and angle is not None:
        angle_setpoint = _best(to_drives, ANGLE, ANGLE_UNITS)
    if angle_setpoint is not None:
        every_wheel["steering_setpoint"] = angle_setpoint[1]
        if angle is not None:
            every_wheel["steering"] = angle[1]
    nodes = sorted(set(sent[measured[0]]) & set(taken[setpoint[0]]), key=_place)
    templates = [str(each["message"]) for each in every_wheel.values()]
    return Guess(
        every_wheel=every_wheel,
        nodes=nodes,
        protection=_protection_signals({**sent, **taken}, templates),
        needs_ticks=position is not None and position[1]["unit"] == "ticks",
    )


def write_mapping(path: Path, dbc: Path, guess: Guess, frames: Sequence[CanFrame], **changes: object) -> None:
    """Write a mapping beside its DBC file, with the checksum that the frames on the bus have.

    Args:
        path: File to write, in the folder of `dbc`.
        dbc: The DBC file.
        guess: The mapping.
        frames: What is on the bus.
        changes: Further keys for every wheel.

    Raises:
        ConfigError: No kind of checksum fits.
    """
    for algorithm in ALGORITHMS if "checksum" in guess.protection else (None,):
        protection = dict(guess.protection)
        if algorithm is None:
            protection.pop("checksum", None)
        else:
            protection["algorithm"] = algorithm
        useful = {"counter", "checksum"} & set(protection)
        table: dict[str, Any] = {
            "dbc": dbc.name,
            "every_wheel": {**changes},
            "wheel": [{"node": node} for node in guess.nodes],
            **({"protection": [protection]} if useful else {}),
        }
        path.write_text(mapping_text(table, guess), "utf-8")
        if _decodes(path, frames):
            if algorithm is None and "checksum" in guess.protection:
                continue  # the checksum must be sent too
            return
    if "checksum" in guess.protection:
        path.unlink(missing_ok=True)
        raise ConfigError(
            f"{dbc}: none of the known checksums ({', '.join(filter(None, ALGORITHMS))}) fits the frames on "
            "the bus: write the mapping by hand, docs/how-to/drive_your_own_rover.md"
        )
    raise ConfigError(f"{dbc}: the frames on the bus do not fit the signals of {path}: correct it by hand")


def mapping_text(table: dict[str, Any], guess: Guess) -> str:
    """Return the text of a mapping; the signals as one line each."""
    signals = {}
    for key, value in guess.every_wheel.items():
        signals[key] = tomlkit.inline_table()
        signals[key].update(value)
    whole = {**table, "every_wheel": {**table["every_wheel"], **signals}}
    head = "# Made by `rover-hil init` from the names and units in the DBC file; check each line.\n\n"
    return head + tomlkit.dumps(whole)


def reordered_text(
    text: str, order: Sequence[int], signs: Sequence[int], steering_signs: Sequence[int] = ()
) -> str:
    """Return a mapping with its wheels in another order; a sign of -1 reverses a wheel, or its steering."""
    document = tomlkit.parse(text)
    tables: Any = document["wheel"]
    wheels = [deepcopy(tables[wheel]) for wheel in order]
    for place, wheel in enumerate(wheels):
        for key, values in (("sign", signs), ("steering_sign", steering_signs)):
            sign = wheel.pop(key, 1) * (values[place] if values else 1)
            if sign < 0:
                wheel[key] = -1
        tables[place] = wheel
    return document.as_string()


def read_messages(dbc: Path) -> list[Message]:
    """Return the messages of a DBC file.

    Raises:
        ConfigError: The file cannot be read, or holds no messages.
    """
    try:
        return list(read_dbc(dbc).messages)
    except ConfigError as error:
        raise ConfigError(f"{error}; give another DBC file") from error


def _number(frame: CanFrame) -> int:
    from drivers.can.frame import EXTENDED_FLAG

    return frame.can_id | EXTENDED_FLAG if frame.is_extended else frame.can_id


def _templates(messages: Iterator[Message] | Sequence[Message]) -> Templates:
    """Return messages by name with "{node}" for number or place of the wheel, then by that."""
    templates: defaultdict[str, dict[int | str, Message]] = defaultdict(dict)
    for message in messages:
        placed = PLACED.fullmatch(message.name)
        parts = NUMBERED.fullmatch(message.name)
        if placed is not None:
            templates[f"{placed[1]}{{node}}{placed[3]}"][placed[2]] = message
        elif parts is not None:
            templates[f"{parts[1]}{{node}}{parts[3]}"][int(parts[2])] = message
    return dict(templates)


def _place(node: int | str) -> tuple[int, int]:
    """Return what orders wheels: their number, or from the front to the rear, the left one first."""
    if isinstance(node, int):
        return node, 0
    name = node.lower().replace("_", "")
    row = 0 if name.startswith("f") or name in ("left", "right") else 1 if name.startswith("m") else 2
    return row, int(name.endswith(("right", "r")))


def _signals(templates: Templates) -> list[tuple[str, Signal]]:
    """Return the signals with the templates of their messages; those of the first wheel stand for all."""
    return [
        (template, signal)
        for template, nodes in templates.items()
        for signal in next(iter(nodes.values())).signals
    ]


def _without_steering(signals: Sequence[tuple[str, Signal]]) -> list[tuple[str, Signal]]:
    return [each for each in signals if not STEERING.search(f"{each[0]} {each[1].name}")]


def _only_steering(signals: Sequence[tuple[str, Signal]]) -> list[tuple[str, Signal]]:
    return [each for each in signals if STEERING.search(f"{each[0]} {each[1].name}")]


def _is_angle(signal: Signal) -> bool:
    return ANGLE.search(signal.name) is not None and _unit(signal) in ANGLE_UNITS


def _unit(signal: Signal) -> str:
    return (signal.unit or "").strip().lower()


def _best(
    signals: Sequence[tuple[str, Signal]],
    words: re.Pattern[str],
    units: dict[str, str],
    prefer: re.Pattern[str] | None = None,
) -> tuple[str, dict[str, object]] | None:
    """Return template and keys of the best signal; by unit and name."""
    best: tuple[int, str, dict[str, object]] | None = None
    for template, signal in signals:
        unit = units.get(_unit(signal))
        is_named = bool(words.search(signal.name))
        score = 2 * (unit is not None) + 2 * is_named + bool(prefer and prefer.search(template))
        if unit is not None and score > (best[0] if best else 2 - is_named):
            best = (score, template, {"message": template, "signal": signal.name, "unit": unit})
    return None if best is None else (best[1], best[2])


def _protection_signals(templates: Templates, names: Sequence[str]) -> dict[str, object]:
    used = list(dict.fromkeys(names))
    protection: dict[str, object] = {"messages": used}
    for key, words in (("counter", COUNTER), ("checksum", CHECKSUM)):
        signals = [_named(next(iter(templates[name].values())), words) for name in used]
        if signals and all(
            each is not None and each.name == getattr(signals[0], "name", None) for each in signals
        ):
            protection[key] = getattr(signals[0], "name", "")
    return protection


def _named(message: Message, words: re.Pattern[str]) -> Signal | None:
    return next((signal for signal in message.signals if words.search(signal.name)), None)


def _decodes(path: Path, frames: Sequence[CanFrame]) -> bool:
    """Return whether the codec accepts the frames with a mapping."""
    codec = CanWheelsCodec("probe", load_mapping(str(path)))
    results = [
        result
        for index, frame in enumerate(frames)
        for result in codec.decode(Received(1 + index, pack_can_frame(frame)))
    ]
    samples = sum(isinstance(each, WheelSample) for each in results)
    wrong = sum(isinstance(each, Rejection) and not each.reason.startswith("other") for each in results)
    return samples > 0 and wrong <= MOST_REJECTED * samples
