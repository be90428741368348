"""What is in a log of a CAN bus: identifiers, rates, and what a DBC file makes of them."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from cantools.database.can import Database, Message, Signal
from numpy.typing import NDArray

from drivers.can.frame import ERROR_FLAG, EXTENDED_FLAG, EXTENDED_ID_MASK
from drivers.can_wheels.messages import bus_id
from rover_hil.drives.arrays import Array
from rover_hil.drives.files.can_frames import LARGEST_PAYLOAD, CanFrames
from rover_hil.drives.files.can_signals import MessageFrames

_ANGLES = "rad deg degrees °"
_RATES = "rad/s deg/s rev/s rpm m/s mm/s km/h kph kmh mph"
MOTION = {
    "wheel": (r"wh(ee)?l|encoder|axis|motor|mcu|drive", f"{_ANGLES} rev ticks {_RATES}"),
    "steering": (r"steer|ste_?(whl|pin)|^str_", _ANGLES),
    "yaw": (r"yaw|gyro", "rad/s deg/s"),
}
"""What the signals of a rover that moves are called, a regular expression, and their units."""
PLAUSIBLE = {
    "m/s2": 50.0, "m/s^2": 50.0, "m/s²": 50.0, "g": 5.0, "m/s": 150.0, "km/h": 500.0, "kph": 500.0,
    "mph": 300.0, "rad/s": 1000.0, "rpm": 100_000.0,
}  # fmt: skip
"""No vehicle does more as a rule, in the unit of a signal."""
_WANTED = re.compile(
    r"(_|\b)(rq|req|request|cmd|command|setpoint|target|des(ired)?|lim(it)?|mn|mx)(_|\b)|torque|_tq",
    re.IGNORECASE,
)
"""Signals that carry what somebody wants, or a torque."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ListedSignal:
    """One signal of the frames of an identifier, in the unit of the DBC file.

    Attributes:
        message: Its message in the DBC file.
        odd: Why the numbers are not those of what name and unit say; "" where they may be.
        kind: "wheel", "steering" or "yaw" where its name and unit are those of such a signal; else "".
        count: Number of frames that hold it.
        first, last, least, greatest, mean: None where no frame holds it.
    """

    message: str
    signal: str
    unit: str
    kind: str
    odd: str
    count: int
    first: float | None
    last: float | None
    least: float | None
    greatest: float | None
    mean: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ListedIdentifier:
    """The frames of one identifier.

    Attributes:
        identifier: Hexadecimal, three digits or eight of an extended one; "error" for reports of errors.
        rate_hz: Of most of its frames: one over the median of their distances; None for a single frame.
        longest_gap_s: Longest time between two frames; None for a single frame.
        signals: Of all messages with this identifier in the DBC files.
    """

    identifier: str
    frames: int
    rate_hz: float | None
    longest_gap_s: float | None
    lengths: tuple[int, ...]
    signals: tuple[ListedSignal, ...]


def list_frames(frames: CanFrames, databases: Sequence[Database]) -> list[ListedIdentifier]:
    """Return what is in a log, by identifier.

    Args:
        frames: The log.
        databases: DBC files, each asked for the messages of each identifier.
    """
    messages: dict[int, list[Message]] = {}
    for database in databases:
        for message in database.messages:
            messages.setdefault(bus_id(message), []).append(message)
    return [
        _listed(frames, identifier, places, messages.get(identifier, ()))
        for identifier, places in frames.by_identifier().items()
    ]


def motion_kinds(listed: Sequence[ListedIdentifier]) -> set[str]:
    """Return which of "wheel", "steering" and "yaw" the signals of a log hold."""
    return {signal.kind for entry in listed for signal in entry.signals if signal.kind and signal.count}


def absence_of(kinds: set[str]) -> str:
    """Return the sentence part on signals that are not in a log; "" where all are."""
    missing = [kind for kind in MOTION if kind not in kinds]
    if not missing:
        return ""
    return f"no {' or '.join(filter(None, [', '.join(missing[:-1]), missing[-1]]))} signal is in it"


def kind_of(message: Message, signal: Signal) -> str:
    """Return "wheel", "steering" or "yaw" where name and unit are those of such a signal; else ""."""
    if _WANTED.search(signal.name) or _WANTED.search(message.name):
        return ""
    steers = re.search(MOTION["steering"][0], signal.name, re.IGNORECASE)
    for kind, (pattern, units) in MOTION.items():
        named = f"{message.name} {signal.name}" if kind == "wheel" else signal.name
        is_named = re.search(pattern, named, re.IGNORECASE) and (kind == "steering" or not steers)
        if is_named and (signal.unit or "").strip().lower() in units.split():
            return kind
    return ""


def oddity_of(signal: Signal, values: Array) -> str:
    """Return why numbers are not those of a quantity of a vehicle with the unit of a signal; "" else."""
    limit = PLAUSIBLE.get((signal.unit or "").strip().lower())
    if limit is None or not len(values) or _WANTED.search(signal.name):
        return ""
    middle = float(np.median(values))
    if abs(middle) <= limit:
        return ""
    what = f"a median of {middle:.6g} {signal.unit} is none of a vehicle"
    return f"{what}: name, offset or factor in the DBC file are wrong"


def _listed(
    frames: CanFrames, identifier: int, places: NDArray[np.intp], messages: Sequence[Message]
) -> ListedIdentifier:
    gaps_s = np.diff(frames.t_s[places])
    typical_s = float(np.median(gaps_s)) if len(gaps_s) else 0.0
    return ListedIdentifier(
        identifier=identifier_text(identifier),
        frames=len(places),
        rate_hz=1.0 / typical_s if typical_s > 0.0 else None,
        longest_gap_s=float(gaps_s.max()) if len(gaps_s) else None,
        lengths=tuple(np.unique(frames.lengths[places]).tolist()),
        signals=tuple(signal for message in messages for signal in _signals(frames, places, message)),
    )


def identifier_text(identifier: int) -> str:
    """Return an identifier as a listing shows it."""
    if identifier & ERROR_FLAG:
        return "error"
    return f"{identifier & EXTENDED_ID_MASK:0{8 if identifier & EXTENDED_FLAG else 3}X}"


def _signals(frames: CanFrames, places: NDArray[np.intp], message: Message) -> Iterator[ListedSignal]:
    if message.length > LARGEST_PAYLOAD:
        return
    decoded = MessageFrames(message, frames.lengths[places], frames.data[places])
    for signal in message.signals:
        try:
            values = decoded.values(signal.name)
        except KeyError:  # the DBC file does not say where or when it is
            continue
        held = values[~np.isnan(values)]
        numbers = [held[0], held[-1], held.min(), held.max(), held.mean()] if len(held) else [math.nan] * 5
        first, last, least, greatest, mean = (
            None if math.isnan(number) else float(number) for number in numbers
        )
        yield ListedSignal(
            message=message.name,
            signal=signal.name,
            unit=signal.unit or "",
            kind=kind_of(message, signal),
            odd=oddity_of(signal, held),
            count=len(held),
            first=first,
            last=last,
            least=least,
            greatest=greatest,
            mean=mean,
        )
