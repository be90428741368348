"""A node on a CAN bus supported by python-can: SocketCAN (vcan) or python-can's virtual bus."""

import contextlib

import can

from drivers.can_frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.errors import NotConnectedError
from sim_backends.serving.port import Port


class CanBusPort(Port[bytes]):
    """A node on the bus; payloads are 16-byte CAN frames.

    A bus has no plug: when this port is closed, the node neither sends nor receives.

    Args:
        interface: Name of python-can's interface, "socketcan" or "virtual".
        channel: Name of the bus, e.g. "vcan0".
    """

    def __init__(self, interface: str, channel: str) -> None:
        self.where = f"{channel} ({interface})"
        self._interface = interface
        self._channel = channel
        self._bus: can.BusABC | None = None

    def open(self) -> None:
        """Join the bus; does nothing when it has been joined."""
        if self._bus is not None:
            return
        try:
            self._bus = can.Bus(self._channel, interface=self._interface, ignore_config=True)
        except (can.CanError, OSError, ValueError) as error:
            raise NotConnectedError(f"cannot serve CAN bus {self.where}: {error}") from error

    def close(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def read(self) -> list[bytes]:
        """Return the classic frames sent by other nodes."""
        frames: list[bytes] = []
        with contextlib.suppress(can.CanError, OSError):  # the bus is down: nothing to receive
            while self._bus is not None and (message := self._bus.recv(0)) is not None:
                if not message.is_fd:
                    frames.append(_payload(message))
        return frames

    def has_listener(self) -> bool:
        """Return whether the bus has been joined; a CAN node cannot detect listeners."""
        return self._bus is not None

    def write(self, payload: bytes) -> bool:
        """Send a frame; return False when the payload is not a frame or the bus does not accept it now."""
        frame = unpack_can_frame(payload)
        if frame is None or self._bus is None:
            return False
        try:
            self._bus.send(_message(frame), timeout=0)
        except (can.CanError, OSError):
            return False
        return True


def _payload(message: can.Message) -> bytes:
    data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
    return pack_can_frame(
        CanFrame(
            message.arbitration_id,
            data,
            message.is_extended_id,
            message.is_remote_frame,
            message.is_error_frame,
        )
    )


def _message(frame: CanFrame) -> can.Message:
    return can.Message(
        arbitration_id=frame.can_id,
        is_extended_id=frame.is_extended,
        is_remote_frame=frame.is_remote,
        is_error_frame=frame.is_error,
        dlc=len(frame.data),
        data=None if frame.is_remote else frame.data,
    )
