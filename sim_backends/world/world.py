"""A simulated rover with its devices: runs plant and emulators in the order of their events."""

from collections import deque
from collections.abc import Mapping
from types import MappingProxyType
from typing import Generic, Protocol

from drivers.link import CameraImage, PayloadT
from sim_backends.world.line import Line
from sim_backends.world.plant import Plant


class Emulator(Protocol):
    """The far end of a bus: receives what the host sends, and sends at its own rate.

    It is called only when the plant has reached the given time, so it may read the truth and set the wheels.
    """

    @property
    def next_event_ns(self) -> int:
        """When it must act next, e.g. its next sampling instant or the expiry of a watchdog."""
        ...

    def act(self, t_ns: int) -> None:
        """Do what is due at `t_ns`; must move `next_event_ns` on."""
        ...

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Process what the host sent; it was complete at `t_ns`."""
        ...


class EmulatedDevice(Generic[PayloadT]):
    """An emulator and the two directions of its bus.

    Attributes:
        unplugged: The plug is pulled: nothing passes in either direction.
        plug_moves: When the plug will be pulled (True) or restored (False), in order of time.
    """

    def __init__(
        self, name: str, emulator: Emulator, to_host: Line[PayloadT], to_device: Line[bytes]
    ) -> None:
        self.name = name
        self.emulator = emulator
        self.to_host: Line[PayloadT] = to_host
        self.to_device = to_device
        self.unplugged = False
        self.plug_moves: deque[tuple[int, bool]] = deque()

    @property
    def next_event_ns(self) -> int:
        """When the emulator must run or the plug moves next."""
        next_ns = min(self.emulator.next_event_ns, self.to_device.next_arrival_ns)
        return min(next_ns, self.plug_moves[0][0]) if self.plug_moves else next_ns

    def run_event(self, t_ns: int) -> None:
        """Move the plug when that is due, deliver what has arrived, and let the emulator do what is due."""
        while self.plug_moves and self.plug_moves[0][0] <= t_ns:
            _, self.unplugged = self.plug_moves.popleft()
        for received in self.to_device.take(t_ns):
            self.emulator.receive(received.t_ns, received.payload)
        if self.emulator.next_event_ns <= t_ns:
            self.emulator.act(t_ns)
        if self.unplugged:
            self.to_host.clear()
            self.to_device.clear()


AnyEmulatedDevice = EmulatedDevice[bytes] | EmulatedDevice[CameraImage]
NO_CAMERAS: Mapping[str, EmulatedDevice[CameraImage]] = MappingProxyType({})


class World:
    """Plant and devices on one time line.

    Args:
        plant: The simulated rover.
        byte_devices: Its devices that talk in bytes, by name; at least one.
        image_devices: Its cameras, by name.
    """

    def __init__(
        self,
        plant: Plant,
        byte_devices: Mapping[str, EmulatedDevice[bytes]],
        image_devices: Mapping[str, EmulatedDevice[CameraImage]] = NO_CAMERAS,
    ) -> None:
        self.plant = plant
        self.byte_devices = byte_devices
        self.image_devices = image_devices
        self._devices: tuple[AnyEmulatedDevice, ...] = (*byte_devices.values(), *image_devices.values())

    def advance(self, now_ns: int) -> None:
        """Run every event up to `now_ns`, in order, then the plant to `now_ns`."""
        events_ns = [device.next_event_ns for device in self._devices]
        while (t_ns := min(events_ns)) <= now_ns:
            index = events_ns.index(t_ns)
            device = self._devices[index]
            self.plant.advance(t_ns)
            device.run_event(t_ns)
            events_ns[index] = device.next_event_ns  # an event changes those of its own device only
        self.plant.advance(now_ns)
