"""Check which messages of the mapping are on the bus, and how often."""

from collections.abc import Iterator

from drivers.can.frame import EXTENDED_FLAG, unpack_can_frame
from drivers.can_wheels.mapping import CanWheelsMapping
from drivers.can_wheels.mapping_file import load_mapping
from drivers.can_wheels.messages import bus_id
from drivers.can_wheels.settings import CanWheelsSettings
from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.devices.streams import stream_of
from rover_hil.doctor.finding import Finding, ok, problem

CHECK = "CAN messages"
MOST_NAMED = 8


def check_traffic(reception: Reception, settings: CanWheelsSettings) -> list[Finding]:
    """Compare the frames on the bus with the mapping; no finding when no frame came."""
    bus = load_mapping(settings.mapping)
    names = {bus_id(bus.message(name)): name for name in _messages_of(bus.mapping)}
    arrivals_ns = _arrivals_by_id(reception)
    if not arrivals_ns:
        return []
    findings: list[Finding] = []
    missing = [f"{name} ({_hex(can_id)})" for can_id, name in names.items() if can_id not in arrivals_ns]
    others = [_hex(can_id) for can_id in sorted(arrivals_ns) if can_id not in names]
    if missing:
        also = f"; on the bus but not in the mapping: {_some(others)}" if others else ""
        findings.append(
            problem(
                CHECK,
                reception.device,
                f"never came: {_some(missing)}{also}",
                "that drive is off or has another node number, or its cyclic sending is switched off",
                f"in the mapping '{settings.mapping}' of [devices.{reception.device}] set node to its "
                "number, or switch on cyclic sending of these messages in the drive",
            )
        )
    rates = [
        f"{name} {stream_of(arrivals_ns[can_id], reception.start_ns, reception.end_ns).rate_hz:.0f} Hz"
        for can_id, name in names.items()
        if can_id in arrivals_ns
    ]
    if rates:
        findings.append(ok(CHECK, reception.device, _some(rates)))
    return findings


def _arrivals_by_id(reception: Reception) -> dict[int, list[int]]:
    arrivals_ns: dict[int, list[int]] = {}
    for arrival in reception.arrivals:
        frame = unpack_can_frame(arrival.payload)
        if frame is not None and not frame.is_error:
            can_id = frame.can_id | EXTENDED_FLAG if frame.is_extended else frame.can_id
            arrivals_ns.setdefault(can_id, []).append(arrival.t_ns)
    return arrivals_ns


def _messages_of(mapping: CanWheelsMapping) -> Iterator[str]:
    for wheel in mapping.wheel:
        measured = (wheel.position, wheel.speed, wheel.current, wheel.voltage, wheel.steering)
        for source in (*measured, wheel.state, *wheel.fault):
            if source is not None:
                yield source.message
    if mapping.power is not None:
        yield mapping.power.voltage.message
    for fault in mapping.fault:
        yield fault.message


def _hex(can_id: int) -> str:
    return f"0x{can_id & ~EXTENDED_FLAG:X}"


def _some(texts: list[str]) -> str:
    unnamed = len(texts) - MOST_NAMED
    return ", ".join(texts[:MOST_NAMED]) + (f" and {unnamed} more" if unnamed > 0 else "")
