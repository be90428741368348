"""Links that end in an emulator in the same process, on a virtual clock, without threads."""

from typing import Generic

from drivers.clock import Clock
from drivers.link import LinkChange, LinkItem, PayloadT
from sim_backends.world.world import EmulatedDevice, World


class LoopbackLink(Generic[PayloadT]):
    """A link in lockstep with the simulated world: receiving runs the world up to now.

    Args:
        world: The simulated rover.
        device: The device on this link.
        clock: The clock of the control loop.
    """

    dropped = 0

    def __init__(self, world: World, device: EmulatedDevice[PayloadT], clock: Clock) -> None:
        self._world = world
        self._device: EmulatedDevice[PayloadT] = device
        self._clock = clock
        self._is_open = False
        self._was_unplugged = False

    def open(self, timeout_s: float) -> None:
        """Attach to the emulated device; what it has sent before is discarded."""
        now_ns = self._clock.now_ns()
        self._world.advance(now_ns)
        self._device.to_host.take(now_ns)
        self._is_open = True

    def close(self) -> None:
        """Detach."""
        self._is_open = False

    def receive(self) -> list[LinkItem[PayloadT]]:
        """Run the world to now and return what reached the host, a pulled or restored plug included."""
        now_ns = self._clock.now_ns()
        self._world.advance(now_ns)
        items: list[LinkItem[PayloadT]] = list(self._device.to_host.take(now_ns))
        if self._device.unplugged != self._was_unplugged:
            self._was_unplugged = self._device.unplugged
            if self._was_unplugged:
                items.append(LinkChange(now_ns, up=False, reason="unplugged"))
            else:  # at the latest when the first payload came
                up_ns = items[0].t_ns if items else now_ns
                items.insert(0, LinkChange(up_ns, up=True, reason="reopened"))
        return items

    def send(self, payload: bytes) -> bool:
        """Put bytes on the line to the device; return False when it is unplugged."""
        if self._device.unplugged or not self._is_open:
            return False
        self._device.to_device.put(self._clock.now_ns(), payload)
        return True
