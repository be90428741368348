"""Keeps track of the active faults that drives on a CAN bus, and the bus itself, report."""

from collections.abc import Mapping

from drivers.can.frame import CanFrame
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.driver import Rejection
from drivers.samples import FaultSample

LOST_ARBITRATION = Rejection("bus_lost_arbitration")
BUS_WARNING = Rejection("bus_warning")

BUS = "CAN bus"
BUS_RECOVERY_NS = NANOSECONDS_PER_SECOND
"""A bus fault is over when frames, which lower the error counters, but no error frames arrive for so long."""

_CONTROLLER = 0x004
_LOST_ARBITRATION = 0x002
_BUS_OFF = 0x040
_RESTARTED = 0x100
_COUNTERS = 0x200
_CLASSES = {
    0x001: "transmit time-out",
    _LOST_ARBITRATION: "lost arbitration",
    0x008: "protocol violation",
    0x010: "transceiver fault",
    0x020: "no acknowledge: nobody else on the bus listens",
    _BUS_OFF: "bus off: the controller has left the bus",
    0x080: "bus error",
}
_WARNING_BITS = 0x0C
_ACTIVE_BIT = 0x40
_CONTROLLER_BITS = {
    0x01: "receive overflow: frames were lost",
    0x02: "transmit overflow: frames were lost",
    0x04: "warning level of receive errors",
    0x08: "warning level of transmit errors",
    0x10: "error-passive after receive errors",
    0x20: "error-passive after transmit errors",
}


class FaultBoard:
    """Remembers active faults and reports each change once.

    Several sources may concern one wheel: its code is that of the first active one, its text names all, and
    it is clear only when all are.

    Args:
        device: Name of the device in the configuration.
    """

    def __init__(self, device: str) -> None:
        self._device = device
        self._active: dict[int | None, dict[str, tuple[int, str]]] = {}

    def reset(self) -> None:
        """Report again, at the next message of its source, what is still active or has cleared meanwhile."""
        for faults in self._active.values():
            for source, (code, _) in faults.items():
                faults[source] = (code, "")

    def report(self, t_ns: int, wheel: int | None, source: str, code: int, text: str) -> FaultSample | None:
        """Note the code of a source for a wheel, or None for the whole device; code 0 means no fault."""
        faults = self._active.setdefault(wheel, {})
        if (code, text) == faults.get(source) or (code == 0 and source not in faults):
            return None
        if code == 0:
            del faults[source]
        else:
            faults[source] = (code, text)
        if not faults:
            return FaultSample(device=self._device, t_ns=t_ns, wheel=wheel, code=0, text=f"{source}: cleared")
        first_code, _ = next(iter(faults.values()))
        texts = "; ".join(f"{name}: {fault_text}" for name, (_, fault_text) in faults.items())
        return FaultSample(device=self._device, t_ns=t_ns, wheel=wheel, code=first_code, text=texts)


class BusMonitor:
    """Turns error frames of the CAN controller into faults of the bus.

    Args:
        board: Where the fault of the bus is noted beside those of the drives.
    """

    def __init__(self, board: FaultBoard) -> None:
        self._board = board
        self._error_ns: int | None = None

    def note_error(self, t_ns: int, frame: CanFrame) -> tuple[FaultSample | Rejection, ...]:
        """Return what a frame means in which the controller reports an error."""
        report = read_error_frame(frame)
        if isinstance(report, Rejection):
            return (report,)
        code, text = report
        self._error_ns = t_ns if code else None
        fault = self._board.report(t_ns, None, BUS, code, text)
        return () if fault is None else (fault,)

    def note_frame(self, t_ns: int) -> tuple[FaultSample, ...]:
        """Return the end of a bus fault, when a frame of a device shows that it is over."""
        if self._error_ns is None or t_ns - self._error_ns < BUS_RECOVERY_NS:
            return ()
        self._error_ns = None
        fault = self._board.report(t_ns, None, BUS, 0, "")
        return () if fault is None else (fault,)


def fault_text(code: int, names: Mapping[int, str]) -> str:
    """Return an error word in words: its own name, or the names of its bits; "" for 0."""
    if code in names or code == 0:
        return names.get(code, "")
    bits = [name for bit, name in names.items() if bit > 0 and bit.bit_count() == 1 and code & bit]
    return ", ".join(bits) or f"code 0x{code:X}"


def read_error_frame(frame: CanFrame) -> tuple[int, str] | Rejection:
    """Return code and text of a frame in which the CAN controller reports an error; code 0 means recovered.

    Reports of normal operation are only counted: lost arbitration and the warning level, which the
    controller also reports on its way back from error-passive.

    Source: error classes and data bytes of linux/can/error.h.
    """
    classes = frame.can_id & ~_COUNTERS
    controller = frame.data[1] if classes & _CONTROLLER and len(frame.data) > 1 else 0
    if classes & _RESTARTED or (controller & _ACTIVE_BIT and not classes & _BUS_OFF):
        return 0, ""
    if classes in (0, _LOST_ARBITRATION):
        return LOST_ARBITRATION
    if classes == _CONTROLLER and controller and not controller & ~_WARNING_BITS:
        return BUS_WARNING
    texts = [text for bit, text in _CLASSES.items() if classes & bit]
    texts += [text for bit, text in _CONTROLLER_BITS.items() if controller & bit]
    return classes, ", ".join(texts) or f"error classes 0x{classes:X}"
