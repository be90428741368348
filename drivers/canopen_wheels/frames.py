"""CANopen messages that the driver sends, and what their numbers mean.

Source: CiA 301 (NMT, SDO, heartbeat, PDO parameters, EMCY codes) and CiA 402 (controlword, statusword, 6007h,
modes) as used by canopen-python `nmt.py`, `emcy.py`, `profiles/p402.py`; manuals of Festo CMMS (SDO bytes)
and Faulhaber MC 5004 (PDOs).
"""

from enum import IntEnum
from typing import NamedTuple

from drivers.can.frame import CanFrame, pack_can_frame
from drivers.canopen_wheels.parameters import CanopenWheelsParameters

EMCY, TPDO_1, TPDO_2, RPDO_1 = 0x080, 0x180, 0x280, 0x200
SDO_REPLY, SDO_REQUEST, HEARTBEAT = 0x580, 0x600, 0x700
NMT_START, NMT_PRE_OPERATIONAL = 0x01, 0x80
BOOT_UP, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x05, 0x7F

_MODES = {"profile_velocity": 3, "cyclic_velocity": 9}
_INVALID = 0x8000_0000
_BY_EVENT = 255
_EMCY_CLASSES = {
    0x10: "generic error",
    0x20: "current",
    0x30: "voltage",
    0x40: "temperature",
    0x50: "device hardware",
    0x60: "device software",
    0x70: "additional modules",
    0x80: "monitoring",
    0x90: "external error",
    0xF0: "additional functions",
    0xFF: "device specific",
}


class State(IntEnum):
    """States of a drive."""

    NOT_READY = 0
    SWITCH_ON_DISABLED = 1
    READY = 2
    SWITCHED_ON = 3
    ENABLED = 4
    QUICK_STOP = 5
    FAULT = 6


SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, FAULT_RESET = 0x06, 0x07, 0x0F, 0x00, 0x80
NEXT_CONTROLWORD = {
    State.NOT_READY: DISABLE_VOLTAGE,
    State.SWITCH_ON_DISABLED: SHUTDOWN,
    State.READY: SWITCH_ON,
    State.SWITCHED_ON: ENABLE,
    State.ENABLED: ENABLE,
    State.QUICK_STOP: DISABLE_VOLTAGE,
    State.FAULT: DISABLE_VOLTAGE,
}
"""The controlword that brings a drive from each state towards operation; a fault needs a reset besides."""


def state_of(statusword: int) -> State:
    """Return the state that a statusword reports."""
    if statusword & 0x08:
        return State.FAULT
    if statusword & 0x4F == 0x40:
        return State.SWITCH_ON_DISABLED
    by_bits = {0x21: State.READY, 0x23: State.SWITCHED_ON, 0x27: State.ENABLED, 0x07: State.QUICK_STOP}
    return by_bits.get(statusword & 0x6F, State.NOT_READY)


def emcy_text(code: int) -> str:
    """Return an emergency code in words, by the classes of CiA 301."""
    name = _EMCY_CLASSES.get(code >> 8) or _EMCY_CLASSES.get(code >> 8 & 0xF0, "")
    return f"emergency 0x{code:04X}" + (f", {name}" if name else "")


class ObjectValue(NamedTuple):
    """A value for one object of a drive."""

    object_index: int
    sub: int
    size: int
    value: int


def nmt(command: int, node: int) -> bytes:
    """Return the frame that changes the network state of a node."""
    return pack_can_frame(CanFrame(0x000, bytes((command, node))))


def heartbeat(node: int) -> bytes:
    """Return the heartbeat of an operational node."""
    return pack_can_frame(CanFrame(HEARTBEAT + node, bytes((OPERATIONAL,))))


def sdo_download(node: int, item: ObjectValue) -> bytes:
    """Return the expedited SDO that writes an object."""
    command = 0x23 | (4 - item.size) << 2
    data = bytes((command,)) + item.object_index.to_bytes(2, "little") + bytes((item.sub,))
    data += item.value.to_bytes(item.size, "little").ljust(4, b"\x00")
    return pack_can_frame(CanFrame(SDO_REQUEST + node, data))


def rpdo_1(node: int, controlword: int, velocity: int) -> bytes:
    """Return controlword and target velocity."""
    data = controlword.to_bytes(2, "little") + velocity.to_bytes(4, "little", signed=True)
    return pack_can_frame(CanFrame(RPDO_1 + node, data))


def configuration(settings: CanopenWheelsParameters, node: int) -> list[ObjectValue]:
    """Return what the drive must be set to before it is started, in order."""
    objects = [
        ObjectValue(0x1016, 1, 4, settings.host_node << 16 | settings.heartbeat_timeout_ms),
        ObjectValue(0x1017, 0, 2, 100),
        ObjectValue(0x6007, 0, 2, 1),  # a lost heartbeat is a fault
        ObjectValue(0x6060, 0, 1, _MODES[settings.mode]),
    ]
    objects += _pdo(0x1400, RPDO_1 + node, (0x6040_0010, 0x60FF_0020), None)
    objects += _pdo(0x1800, TPDO_1 + node, (0x6041_0010, 0x606C_0020), settings.pdo_period_ms)
    measured = (0x6064_0020,) if settings.rated_current_a is None else (0x6064_0020, 0x6078_0010)
    objects += _pdo(0x1801, TPDO_2 + node, measured, settings.pdo_period_ms)
    return objects


def _pdo(index: int, can_id: int, mapped: tuple[int, ...], period_ms: int | None) -> list[ObjectValue]:
    """Return parameters and mapping of a PDO; it is switched off meanwhile."""
    mapping = index + 0x200
    objects = [
        ObjectValue(index, 1, 4, can_id | _INVALID),
        ObjectValue(index, 2, 1, _BY_EVENT),
        ObjectValue(mapping, 0, 1, 0),
    ]
    objects += [ObjectValue(mapping, place, 4, entry) for place, entry in enumerate(mapped, start=1)]
    objects.append(ObjectValue(mapping, 0, 1, len(mapped)))
    if period_ms is not None:
        objects.append(ObjectValue(index, 5, 2, period_ms))
    return [*objects, ObjectValue(index, 1, 4, can_id)]
