"""The differential rover of docs/examples, served at the far ends of a CAN bus and of a serial line.

The server is that of `rover-hil simulate` with other ports.
"""

import fcntl
import os
import signal
import struct
import termios
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from drivers.clock import SystemClock
from rover_hil.config import load_config
from sim_backends.build import build_world
from sim_backends.serving.can_bus_port import CanBusPort
from sim_backends.serving.port import Port
from sim_backends.serving.server import ServedDevice, Server

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "differential.toml"
LENGTH_M = 0.5
STATUS_PERIOD_S = 0.02
ResultT = TypeVar("ResultT")
DEVICE_BUFFER = 256
"""Bytes that a device keeps for a host that does not read; what is more is lost."""


def write_config(path: Path, can_interface: str, serial_port: str) -> None:
    """Write the example with other ports and a short mission."""
    text = EXAMPLE.read_text()
    for old, new in {
        'interface = "slcan" ': 'interface = "socketcan" ',
        'channel = "ports/can"': f'channel = "{can_interface}"',
        'port = "ports/imu"': f'port = "{serial_port}"',
        'type = "rectangle"\nlength_m = 0.9\nwidth_m = 0.5\nspeed_m_s = 0.2': (
            f'type = "line"\nlength_m = {LENGTH_M}\nspeed_m_s = 0.1'
        ),
    }.items():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)


class TtyPort(Port[bytes]):
    """A serial port of this machine as the far end of a line.

    Args:
        path: The port.
    """

    def __init__(self, path: str) -> None:
        self.where = path
        self._end: int | None = None

    def open(self) -> None:
        """Open the port; does nothing when it is open."""
        if self._end is not None:
            return
        self._end = os.open(self.where, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._end)
        attributes = termios.tcgetattr(self._end)
        attributes[4] = attributes[5] = termios.B115200
        termios.tcsetattr(self._end, termios.TCSANOW, attributes)

    def close(self) -> None:
        """Close the port; may be called again."""
        if self._end is not None:
            os.close(self._end)
            self._end = None

    def read(self) -> list[bytes]:
        """Return what the host has sent."""
        data = b""
        with suppress(BlockingIOError):
            data = self._do(lambda end: os.read(end, 4096)) or b""
        return [data] if data else []

    def has_listener(self) -> bool:
        """Return whether the port is open; it cannot detect a reader."""
        return self._end is not None

    def write(self, payload: bytes) -> bool:
        """Write, unless the host does not read."""
        with suppress(BlockingIOError):
            waiting = self._do(lambda end: fcntl.ioctl(end, termios.TIOCOUTQ, bytes(4)))
            if waiting is None or struct.unpack("=i", waiting)[0] > DEVICE_BUFFER:
                return False
            return self._do(lambda end: os.write(end, payload)) == len(payload)
        return False

    def _do(self, deed: Callable[[int], ResultT]) -> ResultT | None:
        """Return what a deed on the port gives; None when the host has hung up, then it is opened anew."""
        self.open()
        assert self._end is not None
        try:
            return deed(self._end)
        except BlockingIOError:
            raise
        except OSError:
            self.close()
            return None


def serve(config_path: Path, can_interface: str, serial_port: str, truth_path: Path) -> None:
    """Serve until interrupted.

    Each line of the truth file: time in ns, monotonic; x, y in m, yaw in rad, largest wheel speed in rad/s;
    how many of the server's cycles of 1 ms were skipped so far.
    """
    config = load_config(str(config_path))
    clock = SystemClock()
    world = build_world(config.devices, config.require_simulation(), clock.now_ns())
    served = [
        ServedDevice(world.byte_devices["wheels"], CanBusPort("socketcan", can_interface)),
        ServedDevice(world.byte_devices["imu"], TtyPort(serial_port)),
    ]
    with Server(world, served, clock) as server, truth_path.open("w") as lines:
        while True:
            server.run(STATUS_PERIOD_S)
            truth = world.plant.truth()
            fastest_rad_s = max(map(abs, truth.wheel_speed_rad_s))
            lines.write(
                f"{truth.t_ns} {truth.x_m} {truth.y_m} {truth.yaw_rad} {fastest_rad_s} "
                f"{server.skipped_cycles}\n"
            )
            lines.flush()


def main(config_path: Path, can_interface: str, serial_port: str, truth_path: Path) -> None:
    """Serve until the process is asked to end."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with suppress(KeyboardInterrupt):
        serve(config_path, can_interface, serial_port, truth_path)
