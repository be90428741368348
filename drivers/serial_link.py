"""Serial ports and pseudo-terminals through pyserial."""

import contextlib
import errno
import termios
from pathlib import Path

import serial

from drivers.clock import Clock
from drivers.errors import NotConnectedError
from drivers.link import Received
from drivers.threaded_link import ThreadedLink

READ_TIMEOUT_S = 0.05


class SerialLink(ThreadedLink[bytes]):
    """A serial port, 8N1; payloads are byte chunks as they arrive.

    Args:
        port: Path of the port; prefer `/dev/serial/by-id/...`, it survives a replug.
        baud_rate: Line speed in bit/s.
        clock: The host's clock.
        reconnect_limit_s: Stop trying this long after a break.
    """

    def __init__(self, port: str, baud_rate: int, clock: Clock, reconnect_limit_s: float) -> None:
        super().__init__(f"serial port {port}", clock, reconnect_limit_s)
        self._port = port
        self._baud_rate = baud_rate
        self._serial: serial.Serial | None = None

    def _open_handle(self) -> None:
        if not Path(self._port).exists():
            raise NotConnectedError("there is no such port")
        try:
            port = serial.Serial(
                self._port,
                self._baud_rate,
                timeout=READ_TIMEOUT_S,
                write_timeout=READ_TIMEOUT_S,
                exclusive=True,
            )
        except serial.SerialException as error:
            if errno.EAGAIN in error.args:
                raise NotConnectedError("another program has opened it: end that program") from error
            raise
        with contextlib.suppress(OSError, ValueError, NotImplementedError):
            port.set_low_latency_mode(True)  # FTDI adapters hold bytes back for 16 ms; a pty has no such mode
        with contextlib.suppress(OSError, termios.error):
            port.reset_input_buffer()  # drop replies to requests of other programs
        self._serial = port

    def _close_handle(self) -> None:
        if self._serial is not None:
            with contextlib.suppress(OSError, termios.error):
                self._serial.close()
            self._serial = None

    def _read(self) -> Received[bytes] | None:
        port = self._require_port()
        data = port.read(max(1, port.in_waiting))
        return Received(self._clock.now_ns(), data) if data else None

    def _write(self, payload: bytes) -> bool:
        try:
            return self._require_port().write(payload) == len(payload)
        except serial.SerialTimeoutException:
            return False

    def _require_port(self) -> serial.Serial:
        if self._serial is None:
            raise NotConnectedError(f"{self.where} is not open")
        return self._serial
