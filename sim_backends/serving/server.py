"""The server: runs a simulated world on the host's clock and carries bytes between it and real ports."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Generic, Self, TypeAlias

from drivers.camera.settings import FrameSourceSettings
from drivers.clock import Clock, nanoseconds
from drivers.device_settings import CanDeviceSettings
from drivers.errors import ConfigError
from drivers.link import CameraImage, PayloadT
from drivers.registry import AnyDeviceSettings
from sim_backends.serving.frame_port import FramePort
from sim_backends.serving.port import Port
from sim_backends.serving.pty_port import PtyPort
from sim_backends.serving.slcan_port import SlcanPort
from sim_backends.world.world import EmulatedDevice, World

CYCLE_NS = 1_000_000


class ServedDevice(Generic[PayloadT]):
    """An emulated device and the port it is served on.

    Attributes:
        sent: Payloads sent to a listening host.
        dropped: Payloads that the port could not accept.
    """

    def __init__(self, device: EmulatedDevice[PayloadT], port: Port[PayloadT]) -> None:
        self.port: Port[PayloadT] = port
        self.sent = 0
        self.dropped = 0
        self._device: EmulatedDevice[PayloadT] = device

    @property
    def name(self) -> str:
        """Name of the device in the configuration."""
        return self._device.name

    def receive_from_host(self, now_ns: int) -> None:
        """Put what the host has sent on the line to the device."""
        for payload in self.port.read():
            self._device.to_device.put(now_ns, payload)

    def send_to_host(self, now_ns: int) -> None:
        """Open or close the port with the device's plug; send what has reached the host."""
        if self._device.unplugged:
            self.port.close()
            return
        self.port.open()
        for arrival in self._device.to_host.take(now_ns):
            if self.port.has_listener():
                was_taken = self.port.write(arrival.payload)
                self.sent += was_taken
                self.dropped += not was_taken


AnyServedDevice: TypeAlias = ServedDevice[bytes] | ServedDevice[CameraImage]


class Server:
    """Serves a world in real time, in cycles of 1 ms; a late cycle is skipped and counted.

    A context manager: it opens the ports on entry and closes them on exit.

    Args:
        world: The simulated rover, built for the present time of `clock`.
        served: Its devices on their ports.
        clock: The host's clock.

    Attributes:
        skipped_cycles: How many cycles were skipped because the machine, or a camera frame, took too long.
    """

    def __init__(self, world: World, served: Sequence[AnyServedDevice], clock: Clock) -> None:
        self.world = world
        self.served = served
        self.skipped_cycles = 0
        self._clock = clock
        self._next_cycle_ns = 0

    def __enter__(self) -> Self:
        try:
            for device in self.served:
                device.port.open()
        except BaseException:
            self.close()
            raise
        self._next_cycle_ns = self._clock.now_ns()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Make every port vanish; may be called again."""
        for device in reversed(self.served):  # the port that made a folder is the last to leave it
            device.port.close()

    def run(self, duration_s: float) -> None:
        """Serve for `duration_s`.

        Raises:
            NotConnectedError: A plug was restored, but its port could not be opened.
        """
        end_ns = self._clock.now_ns() + nanoseconds(duration_s)
        while self._next_cycle_ns < end_ns:
            self._clock.sleep_until(self._next_cycle_ns)
            now_ns = self._clock.now_ns()
            self._cycle(now_ns)
            skipped = (self._clock.now_ns() - self._next_cycle_ns) // CYCLE_NS
            self.skipped_cycles += skipped
            self._next_cycle_ns += (skipped + 1) * CYCLE_NS

    def _cycle(self, now_ns: int) -> None:
        for device in self.served:
            device.receive_from_host(now_ns)
        self.world.advance(now_ns)
        for device in self.served:
            device.send_to_host(now_ns)


def put_on_ports(world: World, settings: Mapping[str, AnyDeviceSettings]) -> list[AnyServedDevice]:
    """Give every device of a world the port that its settings name; nothing is opened yet.

    Raises:
        ConfigError: The settings name a port that no other process can reach.
    """
    for conflict in find_unservable(settings):
        raise ConfigError(conflict)
    served: list[AnyServedDevice] = []
    for name, device in settings.items():
        if isinstance(device, FrameSourceSettings):
            served.append(ServedDevice(world.image_devices[name], FramePort(device.path)))
        elif isinstance(device, CanDeviceSettings):
            served.append(ServedDevice(world.byte_devices[name], _can_port(device)))
        else:
            served.append(ServedDevice(world.byte_devices[name], PtyPort(device.port)))
    return served


def find_unservable(settings: Mapping[str, AnyDeviceSettings]) -> Iterator[str]:
    """Yield which devices name a port that no other process can reach, with the fix."""
    for name, device in settings.items():
        if isinstance(device, FrameSourceSettings) and device.source != "live_folder":
            yield f"devices.{name}.source: a simulated camera is served as source = 'live_folder'; set that"
        if isinstance(device, CanDeviceSettings) and device.interface == "virtual":
            yield (
                f"devices.{name}.interface: no other process can reach a virtual bus; use slcan or socketcan"
            )


def _can_port(bus: CanDeviceSettings) -> Port[bytes]:
    from sim_backends.serving.can_bus_port import CanBusPort  # python-can loads slowly

    return SlcanPort(bus.channel) if bus.interface == "slcan" else CanBusPort(bus.interface, bus.channel)
