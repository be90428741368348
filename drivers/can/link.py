"""CAN buses through python-can: SocketCAN, adapters on a serial port, or a bus inside this process."""

import contextlib
import errno
import fcntl
import os
import socket
import struct

import can
from can.interfaces.slcan import slcanBus
from can.interfaces.socketcan import SocketcanBus

from drivers.can.controller_mode import read_silent_modes
from drivers.can.frame import EXTENDED_ID_MASK, CanFrame, pack_can_frame, unpack_can_frame
from drivers.clock import NANOSECONDS_PER_SECOND, Clock, wall_to_monotonic_ns
from drivers.errors import NotConnectedError
from drivers.link import Received
from drivers.threaded_link import ThreadedLink

READ_TIMEOUT_S = 0.05
"""Counted by python-can on the wall clock: a step of that clock may stretch one wait until the next frame."""
WRITE_TIMEOUT_S = 0.005
OLDEST_STAMP_NS = NANOSECONDS_PER_SECOND

SO_MEMINFO = 55
"""Of Linux's asm-generic/socket.h: counters of a socket, 32 bits each."""
MEMINFO_SIZE = 9 * 4
MEMINFO_DROPS = 8 * 4
BREAKS = {errno.ENETDOWN, errno.ENODEV, errno.ENXIO}
"""What the kernel reports, once and to one caller, when an interface goes down or is removed."""

GARBLED = b""
"""Payload in the place of data that is not a classic CAN frame; the codec rejects and counts it."""


class CanLink(ThreadedLink[bytes]):
    """A CAN bus; payloads are 16-byte frames, those in which the controller reports errors included.

    Setpoints are sent one by one: cyclic sending by the kernel would continue when this program hangs, and
    so defeat the watchdogs of the drives.

    Args:
        interface: "socketcan", "slcan" or "virtual".
        channel: Network interface, serial port, or any name.
        bit_rate: Speed of the bus in bit/s; used by slcan only.
        clock: The host's clock.
        reconnect_limit_s: Stop trying this long after a break.
    """

    def __init__(
        self, interface: str, channel: str, bit_rate: int, clock: Clock, reconnect_limit_s: float
    ) -> None:
        super().__init__(f"CAN bus {channel} ({interface})", clock, reconnect_limit_s)
        self._interface = interface
        self._channel = channel
        self._bit_rate = bit_rate
        self._bus: can.BusABC | None = None
        self._lock: int | None = None
        self._last_ns = 0
        self._lost_in_kernel = 0

    def _open_handle(self) -> None:
        if self._interface == "socketcan":
            self._lost_in_kernel = 0
            self._bus = _open_socketcan(self._channel)
        elif self._interface == "slcan":
            self._bus = self._open_slcan()
        else:
            self._bus = can.Bus(self._channel, interface=self._interface, ignore_config=True)

    def _open_slcan(self) -> can.BusABC:
        """Open an adapter that no other program uses: a second opening closes the first's channel."""
        lock = os.open(self._channel, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            bus = slcanBus(
                self._channel, bitrate=self._bit_rate, sleep_after_open=0.0, timeout=READ_TIMEOUT_S
            )
        except BlockingIOError as error:
            os.close(lock)
            raise NotConnectedError(f"another program uses {self._channel}: end it first") from error
        except BaseException:
            os.close(lock)
            raise
        self._lock = lock
        return bus

    def _close_handle(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
        bus, self._bus = self._bus, None
        if bus is None:
            return
        with contextlib.suppress(can.CanError, OSError):
            bus.shutdown()
        if isinstance(bus, slcanBus):
            # shutdown() gives up before this when the port is gone; an open handle would keep its name in use
            with contextlib.suppress(OSError):
                bus.serialPortOrig.close()

    def _read(self) -> Received[bytes] | None:
        bus = self._require_bus()
        self._count_lost(bus)
        try:
            message = bus.recv(READ_TIMEOUT_S)
        except (ValueError, IndexError):  # not an slcan line
            return Received(self._clock.now_ns(), GARBLED)
        except can.CanOperationError as error:
            if not isinstance(bus, slcanBus) or not isinstance(error.__cause__, UnicodeDecodeError):
                raise
            bus.flush()  # python-can would fail on the same bytes again and again
            return Received(self._clock.now_ns(), GARBLED)
        if message is None:
            return None
        return Received(self._arrival_ns(message), _payload_of(message))

    def _write(self, payload: bytes) -> bool:
        frame = unpack_can_frame(payload)
        if frame is None or frame.is_error:
            return False
        message = can.Message(
            arbitration_id=frame.can_id,
            data=frame.data,
            is_extended_id=frame.is_extended,
            is_remote_frame=frame.is_remote,
            check=True,
        )
        try:
            self._require_bus().send(message, WRITE_TIMEOUT_S)
        except can.CanOperationError as error:
            if error.error_code in BREAKS:
                raise
            return False  # the queue is full
        return True

    def _count_lost(self, bus: can.BusABC) -> None:
        """Add to `dropped` the frames that the kernel had no room for since the last call."""
        if not isinstance(bus, SocketcanBus):
            return
        counters = bus.socket.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, MEMINFO_SIZE)
        lost: int = struct.unpack_from("=I", counters, MEMINFO_DROPS)[0]
        self.dropped += (lost - self._lost_in_kernel) % 2**32
        self._lost_in_kernel = lost

    def _arrival_ns(self, message: can.Message) -> int:
        """Return the kernel's stamp of a frame where it is plausible, else the present time."""
        t_ns = now_ns = self._clock.now_ns()
        if self._interface == "socketcan":
            stamp_ns = wall_to_monotonic_ns(message.timestamp)
            if 0 <= now_ns - stamp_ns <= OLDEST_STAMP_NS:
                t_ns = stamp_ns
        self._last_ns = max(t_ns, self._last_ns)
        return self._last_ns

    def _require_bus(self) -> can.BusABC:
        if self._bus is None:
            raise NotConnectedError(f"{self.where} is not open")
        return self._bus


def _open_socketcan(channel: str) -> can.BusABC:
    advice = f"bring it up with `ip link set {channel} up type can bitrate ...`"
    try:
        socket.if_nametoindex(channel)
    except OSError as error:
        raise NotConnectedError(
            f"there is no network interface {channel}: connect the adapter, load its driver, {advice}"
        ) from error
    bus = SocketcanBus(channel)
    # Opening an interface that is down succeeds; the kernel reports the error to the first reader.
    pending = bus.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
    if pending:
        bus.shutdown()
        hint = f"; {advice}" if pending == errno.ENETDOWN else ""
        raise NotConnectedError(f"{os.strerror(pending)}{hint}")
    modes = read_silent_modes(channel)
    if modes:
        bus.shutdown()
        switch_off = " ".join(f"{mode} off" for mode in modes)
        raise NotConnectedError(
            f"{channel} is in {' and '.join(modes)} mode, in which nothing is sent to the bus: "
            f"`ip link set {channel} down`, then `ip link set {channel} up type can {switch_off}`"
        )
    return bus


def _payload_of(message: can.Message) -> bytes:
    """Return the 16 bytes of a frame; python-can checks nothing it receives."""
    length = 0 if message.is_remote_frame else message.dlc
    if (
        message.is_fd
        or len(message.data) != length
        or length > 8
        or not 0 <= message.arbitration_id <= EXTENDED_ID_MASK
    ):
        return GARBLED
    return pack_can_frame(
        CanFrame(
            message.arbitration_id,
            bytes(message.data),
            message.is_extended_id,
            message.is_remote_frame,
            message.is_error_frame,
        )
    )
