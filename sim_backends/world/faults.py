"""Scheduled faults of one device: a pulled plug, a silent device, and what a bad bus does to payloads."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Annotated, Generic, Literal, TypeAlias

import numpy as np
from pydantic import Field

from drivers.clock import nanoseconds
from drivers.link import CameraImage, PayloadT, Received
from drivers.settings import Settings
from sim_backends.world.world import EmulatedDevice

REORDER_INTERVALS = 1.5
GREY = 128


class TimedFault(Settings):
    """A fault of one device, at a time counted from the start of the simulation.

    Attributes:
        device: Name of the device that fails.
        start_s: Start of the fault after the start of the simulation.
        duration_s: Duration of the fault.
    """

    device: str
    start_s: Annotated[float, Field(ge=0, le=1e6)]
    duration_s: Annotated[float, Field(gt=0, le=1e6)]

    def holds(self, since_start_ns: int) -> bool:
        """Return whether the fault is active at this time after the start."""
        return self.start_ns <= since_start_ns < self.end_ns

    @property
    def start_ns(self) -> int:
        """Begin of the fault after the start."""
        return nanoseconds(self.start_s)

    @property
    def end_ns(self) -> int:
        """End of the fault after the start."""
        return nanoseconds(self.start_s + self.duration_s)


class StateFault(TimedFault):
    """A pulled plug ("unplug"), or a device that receives and acts but sends nothing ("freeze")."""

    type: Literal["unplug", "freeze"]


class ChanceFault(TimedFault):
    """A fault that affects each payload with some probability.

    "drop" loses it, in both directions. The others affect what the host receives: "duplicate" delivers it
    twice, "reorder" after the next one, "corrupt" damages it: one bit flipped, or the lower half of an image
    grey. On a CAN bus the controller's checksum would catch a flipped bit; there it represents a device that
    reports wrong values.

    Attributes:
        probability: Probability that a payload is affected.
    """

    type: Literal["drop", "duplicate", "reorder", "corrupt"]
    probability: Annotated[float, Field(gt=0, le=1)]


class DelayFault(TimedFault):
    """Everything that the device sends arrives late.

    Attributes:
        delay_s: Delay of every payload to the host.
    """

    type: Literal["delay"]
    delay_s: Annotated[float, Field(gt=0, le=10)]


FaultSettings: TypeAlias = Annotated[StateFault | ChanceFault | DelayFault, Field(discriminator="type")]
Corrupt: TypeAlias = Callable[[PayloadT, np.random.Generator], PayloadT]


def schedule_faults(
    device: EmulatedDevice[PayloadT],
    faults: Sequence[FaultSettings],
    corrupt: Corrupt[PayloadT],
    rng: np.random.Generator,
    start_ns: int,
) -> None:
    """Make the plug and the bus of a device fail on schedule.

    Args:
        device: The device in good order.
        faults: Those of this device.
        corrupt: How a payload to the host is damaged.
        rng: Source of all chance.
        start_ns: Start of the simulation.
    """
    unplugs = [fault for fault in faults if fault.type == "unplug"]
    moves_ns = sorted({t_ns for fault in unplugs for t_ns in (fault.start_ns, fault.end_ns)})
    device.plug_moves = deque(
        (start_ns + t_ns, any(fault.holds(t_ns) for fault in unplugs)) for t_ns in moves_ns
    )
    host_rng, device_rng = rng.spawn(2)
    on_bus = [fault for fault in faults if fault.type != "unplug"]
    drops = [fault for fault in faults if fault.type == "drop"]
    device.to_host.disturb = _Disturbance(on_bus, corrupt, host_rng, start_ns)
    device.to_device.disturb = _Disturbance(drops, flip_bit, device_rng, start_ns)


class _Disturbance(Generic[PayloadT]):
    """Applies the faults of one device to each arrival on one line."""

    def __init__(
        self,
        faults: Sequence[FaultSettings],
        corrupt: Corrupt[PayloadT],
        rng: np.random.Generator,
        start_ns: int,
    ) -> None:
        self._faults = faults
        self._corrupt: Corrupt[PayloadT] = corrupt
        self._rng = rng
        self._start_ns = start_ns
        self._previous_ns: int | None = None

    def __call__(self, arrival: Received[PayloadT]) -> list[Received[PayloadT]]:
        interval_ns = 0 if self._previous_ns is None else arrival.t_ns - self._previous_ns
        self._previous_ns = arrival.t_ns
        arrivals = [arrival]
        for fault in self._faults:
            if fault.holds(arrival.t_ns - self._start_ns):
                arrivals = [end for begin in arrivals for end in self._apply(fault, begin, interval_ns)]
        return arrivals

    def _apply(
        self, fault: FaultSettings, arrival: Received[PayloadT], interval_ns: int
    ) -> tuple[Received[PayloadT], ...]:
        if isinstance(fault, DelayFault):
            return (Received(arrival.t_ns + nanoseconds(fault.delay_s), arrival.payload),)
        if isinstance(fault, StateFault):
            return ()
        if self._rng.random() >= fault.probability:
            return (arrival,)
        match fault.type:
            case "drop":
                return ()
            case "duplicate":
                return (arrival, arrival)
            case "reorder":
                return (Received(arrival.t_ns + round(REORDER_INTERVALS * interval_ns), arrival.payload),)
            case "corrupt":
                return (Received(arrival.t_ns, self._corrupt(arrival.payload, self._rng)),)


def flip_bit(payload: bytes, rng: np.random.Generator) -> bytes:
    """Return a payload of at least one byte with one random bit flipped."""
    damaged = bytearray(payload)
    damaged[rng.integers(len(payload))] ^= 1 << rng.integers(8)
    return bytes(damaged)


def grey_lower_half(frame: CameraImage, rng: np.random.Generator) -> CameraImage:
    """Return a frame like that of a truncated JPEG: grey from a random line below the middle."""
    image = frame.image.copy()
    image[rng.integers(len(image) // 2, len(image)) :] = GREY
    return CameraImage(image, frame.t_capture_ns)
