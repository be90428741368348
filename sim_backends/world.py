"""A simulated rover with its devices: runs plant and emulators in the order of their events."""

from collections.abc import Mapping
from typing import Generic, Protocol

from drivers.link import CameraImage, PayloadT
from sim_backends.line import Line
from sim_backends.plant import Plant


class Emulator(Protocol):
    """The far end of a bus: hears what the host sends, speaks at its own pace.

    It is called only when the plant stands at the given time, so it may read the truth and set the wheels.
    """

    @property
    def next_event_ns(self) -> int:
        """When it wants to act next, e.g. its next sampling instant or the end of a watchdog."""
        ...

    def act(self, t_ns: int) -> None:
        """Do what is due at `t_ns`; must move `next_event_ns` on."""
        ...

    def hear(self, t_ns: int, payload: bytes) -> None:
        """Take what the host sent, complete at `t_ns`."""
        ...


class EmulatedDevice(Generic[PayloadT]):
    """An emulator and the two directions of its bus.

    `unplugged` is set by whoever pulls the plug: nothing passes, neither now nor later.
    """

    def __init__(
        self, name: str, emulator: Emulator, to_host: Line[PayloadT], to_device: Line[bytes]
    ) -> None:
        self.name = name
        self.emulator = emulator
        self.to_host: Line[PayloadT] = to_host
        self.to_device = to_device
        self.unplugged = False

    @property
    def next_event_ns(self) -> int:
        """When the emulator must run next."""
        return min(self.emulator.next_event_ns, self.to_device.next_arrival_ns)

    def run_event(self, t_ns: int) -> None:
        """Let the emulator hear what has arrived and do what is due."""
        for received in self.to_device.take(t_ns):
            self.emulator.hear(received.t_ns, received.payload)
        if self.emulator.next_event_ns <= t_ns:
            self.emulator.act(t_ns)
        if self.unplugged:
            self.to_host.clear()
            self.to_device.clear()


AnyEmulatedDevice = EmulatedDevice[bytes] | EmulatedDevice[CameraImage]


class World:
    """Plant and devices on one time line."""

    def __init__(self, plant: Plant, devices: Mapping[str, AnyEmulatedDevice]) -> None:
        self.plant = plant
        self.devices = devices

    def advance(self, now_ns: int) -> None:
        """Run every event up to `now_ns`, in order, then the plant to `now_ns`."""
        devices = tuple(self.devices.values())
        while True:
            device = min(devices, key=_next_event_ns)
            t_ns = device.next_event_ns
            if t_ns > now_ns:
                break
            self.plant.advance(t_ns)
            device.run_event(t_ns)
        self.plant.advance(now_ns)


def _next_event_ns(device: AnyEmulatedDevice) -> int:
    return device.next_event_ns
