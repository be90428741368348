"""Serial ports and pseudo-terminals through pyserial."""

import contextlib
import termios
from typing import Annotated

import serial
from pydantic import Field

from drivers.clock import Clock
from drivers.errors import NotConnectedError
from drivers.link import Received
from drivers.settings import DeviceSettings
from drivers.threaded_link import ThreadedLink

READ_TIMEOUT_S = 0.05


class SerialSettings(DeviceSettings):
    """A device on a serial port.

    Attributes:
        port: Path of the port; prefer `/dev/serial/by-id/...`, it survives a replug.
        baud_rate: Line speed in bit/s, 8N1.
    """

    port: Annotated[str, Field(min_length=1)]
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)]


class SerialLink(ThreadedLink[bytes]):
    """A serial port; payloads are byte chunks as they arrive."""

    def __init__(self, settings: SerialSettings, clock: Clock) -> None:
        super().__init__(f"serial port {settings.port}", clock, settings.reconnect_limit_s)
        self._settings = settings
        self._serial: serial.Serial | None = None

    def _open_handle(self) -> None:
        port = serial.Serial(
            self._settings.port,
            self._settings.baud_rate,
            timeout=READ_TIMEOUT_S,
            write_timeout=READ_TIMEOUT_S,
            exclusive=True,
        )
        with contextlib.suppress(OSError, ValueError, NotImplementedError):
            port.set_low_latency_mode(True)  # FTDI adapters hold bytes back for 16 ms; a pty has no such mode
        with contextlib.suppress(OSError, termios.error):
            port.reset_input_buffer()  # a reply to somebody else's request is not ours
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
            msg = f"{self.where} is not open"
            raise NotConnectedError(msg)
        return self._serial
