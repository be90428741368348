"""The record of each cycle as a line of JSON over UDP, for programs without ROS."""

import socket
from collections.abc import Callable, Mapping

from controllers.operator import OperatorInput
from drivers.clock import Clock, SystemClock
from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.connect.cycle_bytes import CyclePacker, CycleUnpacker
from rover_hil.connect.cycle_record import CycleRecorder
from rover_hil.connect.wall_clock import WallOffset
from rover_hil.recording.text import strict_json
from rover_hil.run.executive import CycleView, End

OPTION = "--odometry-to"
LOCALHOST = "127.0.0.1"
MOST_PORTS = 65_535
NO_FACTS: Mapping[str, object] = {}


class JsonLines:
    """Sends the record of each cycle as one datagram; nothing is taken from the network.

    A datagram that the system does not take at once is lost, the loop never waits.

    Args:
        target: `HOST:PORT`, or `PORT` on this computer.
        config: The rover.
        simulated_offset_ns: Returns real minus simulated time; 0 for a real rover.

    Raises:
        ConfigError: The target is none, or its name cannot be resolved.
    """

    def __init__(
        self, target: str, config: Config, simulated_offset_ns: Callable[[], int] = lambda: 0
    ) -> None:
        family, self._address = _resolve(target)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._packer, self._unpacker = CyclePacker(config), CycleUnpacker()
        self._recorder = CycleRecorder(config, WallOffset())
        self._simulated_offset_ns = simulated_offset_ns
        self._clock: Clock = SystemClock()

    def close(self) -> None:
        """End sending."""
        self._socket.close()

    def wanted(self) -> OperatorInput | None:
        """Return None: nobody commands by this way."""
        return None

    def end(self) -> tuple[End, str] | None:
        """Return None: a reader that is gone ends no run."""
        return None

    def show(self, view: CycleView) -> None:
        """Send the record of a cycle."""
        facts = self._unpacker.unpack(self._packer.pack(view, self._simulated_offset_ns(), NO_FACTS))
        line = strict_json(self._recorder.record(facts, self._clock.now_ns())) + b"\n"
        try:
            self._socket.sendto(line, self._address)
        except OSError:  # nobody listens, or the network is down
            return


def _resolve(target: str) -> tuple[socket.AddressFamily, tuple[object, ...]]:
    host, _, port = target.rpartition(":")
    if not port.isdecimal() or not 0 < int(port) <= MOST_PORTS:
        raise ConfigError(
            f"{OPTION}: '{target}' is not HOST:PORT with a port from 1 to {MOST_PORTS}, as localhost:5005"
        )
    try:
        addresses = socket.getaddrinfo(host.strip("[]") or LOCALHOST, int(port), type=socket.SOCK_DGRAM)
    except OSError as error:
        raise ConfigError(f"{OPTION}: cannot find '{host}': {error.strerror}; correct the host") from error
    family, _, _, _, address = addresses[0]
    return family, address
