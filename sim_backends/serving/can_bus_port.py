"""A node on a CAN bus supported by python-can: SocketCAN (vcan) or python-can's virtual bus."""

import contextlib
import socket

import can

from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.errors import NotConnectedError
from sim_backends.serving.port import Port


class CanBusPort(Port[bytes]):
    """A node on the bus; payloads are 16-byte CAN frames.

    A bus has no plug: when this port is closed, the node neither sends nor receives. A network interface that
    is removed and made again is joined again; without it the node is alone.

    Args:
        interface: Name of python-can's interface, "socketcan" or "virtual".
        channel: Name of the bus, e.g. "vcan0".
    """

    def __init__(self, interface: str, channel: str) -> None:
        self.where = f"{channel} ({interface})"
        self._interface = interface
        self._channel = channel
        self._bus: can.BusABC | None = None
        self._index = 0
        self._is_open = False

    def open(self) -> None:
        """Join the bus; does nothing when it has been joined."""
        if self._is_open:
            return
        index = self._index_now()
        if self._interface == "socketcan" and not index:  # python-can would leave a socket open
            raise NotConnectedError(f"cannot serve CAN bus {self.where}: there is no such network interface")
        try:
            self._bus = can.Bus(self._channel, interface=self._interface, ignore_config=True)
        except (can.CanError, OSError, ValueError) as error:
            raise NotConnectedError(f"cannot serve CAN bus {self.where}: {error}") from error
        self._index = index
        self._is_open = True

    def close(self) -> None:
        """Leave the bus."""
        self._is_open = False
        self._leave()

    def _leave(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(can.CanError, OSError):
                bus.shutdown()

    def _index_now(self) -> int:
        """Return the kernel's number of the interface: a new one whenever it is made, 0 without it."""
        if self._interface != "socketcan":
            return 0
        try:
            return socket.if_nametoindex(self._channel)
        except OSError:
            return 0

    def _follow_interface(self) -> None:
        """Join an interface that was made again: a socket of the old one stays silent for ever."""
        if not self._is_open or self._index_now() == self._index:
            return
        self._leave()
        self._is_open = False
        try:
            self.open()
        except NotConnectedError:  # not there yet
            self._is_open = True
            self._index = 0

    def read(self) -> list[bytes]:
        """Return the classic frames sent by other nodes."""
        self._follow_interface()
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
