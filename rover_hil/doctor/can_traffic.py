"""Which messages of the mapping are on the bus, and how often?"""

from collections import Counter
from collections.abc import Iterator

from drivers.can_frame import EXTENDED_FLAG, CanFrame, unpack_can_frame
from drivers.can_wheels.faults import read_error_frame
from drivers.can_wheels.mapping import CanWheelsMapping
from drivers.can_wheels.mapping_file import load_mapping
from drivers.can_wheels.messages import bus_id
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.driver import Rejection
from rover_hil.doctor.finding import Finding, ok, problem, warning
from rover_hil.doctor.listening import Heard

CHECK = "CAN messages"
MOST_NAMED = 8


def check_traffic(heard: Heard, settings: CanWheelsSettings, listened_s: float) -> list[Finding]:
    """Compare the frames on the bus with the mapping."""
    bus = load_mapping(settings.mapping)
    names = dict.fromkeys(_messages_of(bus.mapping))
    ids = {bus_id(bus.message(name)): name for name in names}
    frames = [frame for payload in heard.payloads if (frame := unpack_can_frame(payload)) is not None]
    counts = Counter(_id_of(frame) for frame in frames if not frame.is_error)
    if not counts:
        return _check_errors(heard.device, frames)
    findings = _check_errors(heard.device, frames)
    missing = [f"{name} ({_hex(can_id)})" for can_id, name in ids.items() if can_id not in counts]
    others = [_hex(can_id) for can_id, _ in counts.most_common() if can_id not in ids]
    if missing:
        also = f"; unknown to the mapping but on the bus: {_some(others)}" if others else ""
        findings.append(
            problem(
                CHECK,
                heard.device,
                f"never came: {_some(missing)}{also}",
                "that drive is off or has another node number, or its cyclic sending is switched off",
                f"set node in the mapping '{settings.mapping}' of [devices.{heard.device}] to the drive's "
                "number, or switch on cyclic sending of these messages in the drive",
            )
        )
    seen = [f"{name} {counts[can_id] / listened_s:.0f} Hz" for can_id, name in ids.items() if counts[can_id]]
    if seen:
        findings.append(ok(CHECK, heard.device, _some(seen)))
    return findings


def _messages_of(mapping: CanWheelsMapping) -> Iterator[str]:
    for wheel in mapping.wheel:
        for source in (wheel.position, wheel.speed, wheel.current, wheel.voltage, *wheel.fault):
            if source is not None:
                yield source.message
    if mapping.power is not None:
        yield mapping.power.voltage.message
    for fault in mapping.fault:
        yield fault.message


def _check_errors(device: str, frames: list[CanFrame]) -> list[Finding]:
    texts: Counter[str] = Counter()
    for frame in frames:
        if frame.is_error:
            told = read_error_frame(frame)
            texts[told.reason if isinstance(told, Rejection) else told[1] or "restarted"] += 1
    if not texts:
        return []
    listing = ", ".join(f"{count} x {text}" for text, count in texts.most_common())
    return [
        warning(
            CHECK,
            device,
            f"error frames: {listing}",
            "wrong bit rate, missing termination, a loose wire, or nobody else on the bus",
            "measure 60 ohm between CAN_H and CAN_L with power off, switch the drives on, compare bit rates",
        )
    ]


def _id_of(frame: CanFrame) -> int:
    return frame.can_id | EXTENDED_FLAG if frame.is_extended else frame.can_id


def _hex(can_id: int) -> str:
    return f"0x{can_id & ~EXTENDED_FLAG:X}"


def _some(texts: list[str]) -> str:
    rest = len(texts) - MOST_NAMED
    return ", ".join(texts[:MOST_NAMED]) + (f" and {rest} more" if rest > 0 else "")
