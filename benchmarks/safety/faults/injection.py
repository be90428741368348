"""Faults between emulator and driver: of single payloads, of their numbers, of the plug."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol

import cv2
import numpy as np

from benchmarks.safety.faults.wires import Change, Reading, Wire
from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds
from drivers.link import CameraImage, PayloadT, Received
from sim_backends.world.line import NEVER_NS, Line
from sim_backends.world.plant import Truth

MOVES_RAD_S = 0.05


@dataclass(slots=True)
class Window:
    """When the fault holds: from some time after the rover first turns a wheel.

    Attributes:
        after_s: From the first motion to the fault.
        duration_s: Length of the fault.
        begin_ns: Begin of the fault; `NEVER_NS` before the first motion.
    """

    after_s: float
    duration_s: float
    begin_ns: int = NEVER_NS

    def watch(self, t_ns: int, truth: Truth) -> None:
        """Look whether the rover has begun to move."""
        if self.begin_ns == NEVER_NS and max(map(abs, truth.wheel_speed_rad_s)) > MOVES_RAD_S:
            self.begin_ns = t_ns + nanoseconds(self.after_s)

    @property
    def end_ns(self) -> int:
        """End of the fault."""
        return self.begin_ns + nanoseconds(self.duration_s)

    def holds(self, t_ns: int) -> bool:
        """Return whether the fault acts at this time."""
        return self.begin_ns <= t_ns < self.end_ns


class Disturb(Protocol[PayloadT]):
    """What becomes of a payload that was complete at its time while the fault acts."""

    def __call__(self, arrival: Received[PayloadT], window: Window) -> Sequence[Received[PayloadT]]:
        """Return what arrives instead."""
        ...


class Switched(Generic[PayloadT]):
    """Lets a fault act in its window only."""

    def __init__(self, window: Window, disturb: Disturb[PayloadT]) -> None:
        self._window = window
        self._disturb: Disturb[PayloadT] = disturb

    def __call__(self, arrival: Received[PayloadT]) -> Sequence[Received[PayloadT]]:
        """Return what arrives."""
        if self._window.holds(arrival.t_ns):
            return self._disturb(arrival, self._window)
        if isinstance(self._disturb, Looped):
            self._disturb.record(arrival.t_ns, arrival.payload)
        return (arrival,)


def inject(line: Line[PayloadT], window: Window, disturb: Disturb[PayloadT]) -> None:
    """Put a fault on one direction of a bus."""
    line.disturb = Switched(window, disturb)


def silence(arrival: Received[PayloadT], window: Window) -> Sequence[Received[PayloadT]]:
    """Nothing arrives."""
    return ()


def stall(arrival: Received[PayloadT], window: Window) -> Sequence[Received[PayloadT]]:
    """Everything arrives at the end of the fault, at once."""
    return (Received(window.end_ns, arrival.payload),)


def late(arrival: Received[PayloadT], window: Window) -> Sequence[Received[PayloadT]]:
    """Everything arrives 0.3 s late."""
    return (Received(arrival.t_ns + nanoseconds(0.3), arrival.payload),)


def old_stamps(arrival: Received[bytes], window: Window) -> Sequence[Received[bytes]]:
    """Everything arrives in time with a stamp of a second before, as from an adapter with another clock."""
    return (Received(arrival.t_ns - NANOSECONDS_PER_SECOND, arrival.payload),)


def duplicate(arrival: Received[PayloadT], window: Window) -> Sequence[Received[PayloadT]]:
    """Everything arrives twice."""
    return (arrival, arrival)


def flood(arrival: Received[bytes], window: Window) -> Sequence[Received[bytes]]:
    """Everything arrives five hundred times, valid each time."""
    return (arrival,) * 500


@dataclass(frozen=True, slots=True)
class Multiplied:
    """Delivers every payload several times, spread over a hundredth of a second."""

    count: int

    def __call__(self, arrival: Received[bytes], window: Window) -> Sequence[Received[bytes]]:
        """Return the copies."""
        step_ns = nanoseconds(0.01) // self.count
        return [Received(arrival.t_ns + copy * step_ns, arrival.payload) for copy in range(self.count)]


@dataclass(slots=True)
class OneIn:
    """Lets one of `count` payloads pass."""

    count: int
    seen: int = 0

    def __call__(self, arrival: Received[bytes], window: Window) -> Sequence[Received[bytes]]:
        """Return the payload or nothing."""
        self.seen += 1
        return (arrival,) if self.seen % self.count == 0 else ()


@dataclass(slots=True)
class Chance:
    """Loses payloads at random."""

    rng: np.random.Generator
    probability: float = 0.5

    def __call__(self, arrival: Received[bytes], window: Window) -> Sequence[Received[bytes]]:
        """Return the payload or nothing."""
        return () if self.rng.random() < self.probability else (arrival,)


@dataclass(slots=True)
class Reorder:
    """Delivers every second payload after the one that follows it."""

    held: Received[bytes] | None = None

    def __call__(self, arrival: Received[bytes], window: Window) -> Sequence[Received[bytes]]:
        """Return both payloads of a pair in the wrong order, at the second one's time."""
        if self.held is None:
            self.held = arrival
            return ()
        first, self.held = self.held, None
        return (arrival, Received(arrival.t_ns, first.payload))


class Repeated:
    """The first payload of the fault again and again, or a given one: a device that hangs.

    Args:
        payload: What it repeats; None for the first one that comes.
    """

    def __init__(self, payload: bytes | None = None) -> None:
        self._payload = payload

    def __call__(self, arrival: Received[bytes], window: Window) -> Sequence[Received[bytes]]:
        """Return it instead of what came."""
        if self._payload is None:
            self._payload = arrival.payload
        return [Received(arrival.t_ns, self._payload)]


@dataclass(slots=True)
class Looped:
    """What came before the fault again and again: a buffer that is read twice.

    Attributes:
        period_s: So much of it.
    """

    period_s: float
    recorded: deque[tuple[int, bytes]] = field(default_factory=deque)
    sent: int = 0

    def record(self, t_ns: int, payload: bytes) -> None:
        """Keep what comes."""
        self.recorded.append((t_ns, payload))
        while t_ns - self.recorded[0][0] >= nanoseconds(self.period_s):
            self.recorded.popleft()

    def __call__(self, arrival: Received[bytes], window: Window) -> Sequence[Received[bytes]]:
        """Return the next of what was recorded."""
        payload = self.recorded[self.sent % len(self.recorded)][1]
        self.sent += 1
        return (Received(arrival.t_ns, payload),)


@dataclass(slots=True)
class Drifting:
    """A value that grows from the begin of the fault is added to some channels; units of the wire per s."""

    rate: float
    channels: tuple[int, ...]
    begin_ns: int | None = None

    def __call__(self, t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        """Return the values."""
        self.begin_ns = t_ns if self.begin_ns is None else self.begin_ns
        offset = self.rate * (t_ns - self.begin_ns) / NANOSECONDS_PER_SECOND
        return [value + offset * (channel in self.channels) for channel, value, _ in readings]


@dataclass(slots=True)
class White:
    """White noise instead of every channel, with this standard deviation in units of the wire."""

    rng: np.random.Generator
    sd: float

    def __call__(self, t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        """Return the values."""
        return [float(self.rng.normal(0.0, self.sd)) for _ in readings]


@dataclass(slots=True)
class Garbage:
    """Random bytes instead of the payload, as many; of a CAN frame only the data (`keep` bytes stay)."""

    rng: np.random.Generator
    keep: int = 0

    def __call__(self, arrival: Received[bytes], window: Window) -> Sequence[Received[bytes]]:
        """Return the damaged payload."""
        payload = arrival.payload
        return (Received(arrival.t_ns, payload[: self.keep] + self.rng.bytes(len(payload) - self.keep)),)


@dataclass(slots=True)
class Changed:
    """Opens each payload and changes its numbers."""

    wire: Wire
    change: Change

    def __call__(self, arrival: Received[bytes], window: Window) -> Sequence[Received[bytes]]:
        """Return the changed payload."""
        return (Received(arrival.t_ns, self.wire.change(arrival.t_ns, arrival.payload, self.change)),)


@dataclass(slots=True)
class Scaled:
    """Rates times a factor; totals go on from the begin of the fault with this factor. -1 reverses, 0 stops.

    Attributes:
        factor: The factor.
        channels: Which wheels or axes; None for all.
    """

    factor: float
    channels: tuple[int, ...] | None = None
    begin: dict[int, float] = field(default_factory=dict)

    def __call__(self, t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        """Return the values."""
        return [self._value(reading) for reading in readings]

    def _value(self, reading: Reading) -> float:
        channel, value, is_total = reading
        if self.channels is not None and channel not in self.channels:
            return value
        start = self.begin.setdefault(channel, value) if is_total else 0.0
        return start + self.factor * (value - start)


@dataclass(slots=True)
class Biased:
    """A constant is added to some channels, in units of the wire."""

    offset: float
    channels: tuple[int, ...]

    def __call__(self, t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        """Return the values."""
        return [value + self.offset * (channel in self.channels) for channel, value, _ in readings]


@dataclass(slots=True)
class Held:
    """The first values of the fault, for ever: a sensor that hangs behind an interface that lives."""

    first: dict[tuple[int, bool], float] = field(default_factory=dict)

    def __call__(self, t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        """Return the values."""
        return [self.first.setdefault((channel, total), value) for channel, value, total in readings]


@dataclass(slots=True)
class Rotated:
    """Another axis is read in each place: x, y, z become y, z, x. Also swapped wheels."""

    order: tuple[int, ...]

    def __call__(self, t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        """Return the values."""
        return [readings[index].value for index in self.order]


@dataclass(slots=True)
class LowPassed:
    """A first-order low-pass of every channel."""

    time_constant_s: float
    state: dict[tuple[int, bool], tuple[int, float]] = field(default_factory=dict)

    def __call__(self, t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        """Return the values."""
        return [self._value(t_ns, reading) for reading in readings]

    def _value(self, t_ns: int, reading: Reading) -> float:
        key = (reading.channel, reading.is_total)
        before_ns, value = self.state.get(key, (t_ns, reading.value))
        share = 1.0 - float(np.exp(-(t_ns - before_ns) / nanoseconds(self.time_constant_s)))
        value += share * (reading.value - value)
        self.state[key] = (t_ns, value)
        return value


@dataclass(slots=True)
class RandomValues:
    """Values drawn evenly from all that the field can hold."""

    rng: np.random.Generator
    low: float
    high: float

    def __call__(self, t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        """Return the values."""
        return [float(self.rng.uniform(self.low, self.high)) for _ in readings]


Paint = Callable[[CameraImage, CameraImage], CameraImage]
"""From the first frame of the fault and the present one to what the camera sends."""


@dataclass(slots=True)
class Painted:
    """Other frames instead of the camera's."""

    paint: Paint
    first: CameraImage | None = None

    def __call__(self, arrival: Received[CameraImage], window: Window) -> Sequence[Received[CameraImage]]:
        """Return the frame."""
        self.first = self.first or arrival.payload
        return (Received(arrival.t_ns, self.paint(self.first, arrival.payload)),)


def black(first: CameraImage, present: CameraImage) -> CameraImage:
    """Return a black frame."""
    return CameraImage(np.zeros_like(present.image), present.t_capture_ns)


def frozen(first: CameraImage, present: CameraImage) -> CameraImage:
    """Return the first frame again with its own stamp."""
    return first


def frozen_with_new_stamps(first: CameraImage, present: CameraImage) -> CameraImage:
    """Return the first frame again with the present stamp."""
    return CameraImage(first.image, present.t_capture_ns)


def with_old_stamp(first: CameraImage, present: CameraImage) -> CameraImage:
    """Return the frame with a stamp two seconds before its own."""
    stamp_ns = present.t_capture_ns
    return CameraImage(present.image, None if stamp_ns is None else stamp_ns - 2 * NANOSECONDS_PER_SECOND)


def mirrored(first: CameraImage, present: CameraImage) -> CameraImage:
    """Return the frame with left and right exchanged: a camera that is mounted the wrong way."""
    return CameraImage(np.ascontiguousarray(present.image[:, ::-1]), present.t_capture_ns)


def turned(first: CameraImage, present: CameraImage) -> CameraImage:
    """Return the frame turned by 10 degrees about its centre: a camera that has slipped in its mount."""
    height, width = present.image.shape[:2]
    turn = cv2.getRotationMatrix2D((0.5 * width, 0.5 * height), 10.0, 1.0)
    image = np.asarray(cv2.warpAffine(present.image, turn, (width, height)), np.uint8)
    return CameraImage(image, present.t_capture_ns)


def hunting(first: CameraImage, present: CameraImage) -> CameraImage:
    """Return the frame with an exposure that swings between a third and three times every 0.8 s."""
    at_s = (present.t_capture_ns or 0) / NANOSECONDS_PER_SECOND
    gain = 3.0 ** math.sin(math.tau * at_s / 0.8)
    return CameraImage(np.clip(gain * present.image, 0.0, 255.0).astype(np.uint8), present.t_capture_ns)


@dataclass(slots=True)
class Noise:
    """Frames of random pixels."""

    rng: np.random.Generator

    def __call__(self, first: CameraImage, present: CameraImage) -> CameraImage:
        """Return such a frame."""
        pixels = self.rng.integers(0, 256, present.image.shape, dtype=np.uint8)
        return CameraImage(pixels, present.t_capture_ns)
