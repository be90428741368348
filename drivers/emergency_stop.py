"""How another process stops a drive: the port, and what to send there, as plain data."""

from dataclasses import dataclass
from enum import StrEnum


class PortKind(StrEnum):
    """How frames reach the drive.

    SERIAL: Bytes to a serial port.
    SLCAN: CAN frames as text lines to a serial adapter.
    SOCKETCAN: CAN frames to a network interface.
    NONE: No other process can reach it; only its own time-out stops it.
    """

    SERIAL = "serial"
    SLCAN = "slcan"
    SOCKETCAN = "socketcan"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class StopPort:
    """The port of a drive.

    Attributes:
        kind: What it is.
        path: Path of the serial port, or name of the network interface.
        baud_rate: Line speed of a serial port in bit/s, 0 for the others.
    """

    kind: PortKind
    path: str
    baud_rate: int = 0


@dataclass(frozen=True, slots=True)
class EmergencyStop:
    """What stops a drive without its driver.

    Attributes:
        port: Where it goes.
        payloads: What is sent, in this order; CAN frames have the 16 bytes of `struct can_frame`.
    """

    port: StopPort
    payloads: tuple[bytes, ...]
