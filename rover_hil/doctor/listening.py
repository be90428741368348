"""Listens to all devices at once for a short while. Nothing is sent that could turn a wheel."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from drivers.clock import Clock, nanoseconds, seconds
from drivers.device_settings import FrameDeviceSettings
from drivers.driver import AnyDriver, Health
from drivers.link import CameraImage, Link, LinkItem, Received
from drivers.registry import AnyDeviceSettings
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import FrameSample, Sample

POLL_STEP_NS = 5_000_000
NO_PIXELS = np.zeros((0, 0), dtype=np.uint8)


class Overhearing:
    """A raw tap that keeps what arrives from a byte device."""

    def __init__(self) -> None:
        self.arrivals: list[Received[bytes]] = []

    def received(self, device: str, item: LinkItem[bytes] | LinkItem[CameraImage]) -> None:
        """Keep what arrived."""
        if isinstance(item, Received) and isinstance(item.payload, bytes):
            self.arrivals.append(Received(item.t_ns, item.payload))

    def sent(self, device: str, t_ns: int, payload: bytes, delivered: bool) -> None:
        """Ignore what was sent."""


@dataclass(frozen=True, slots=True)
class Heard:
    """What one device said while it was listened to; frames without their pixels.

    Attributes:
        end_ns: When listening ended.
        arrivals: What came before it was decoded; empty for cameras.
    """

    device: str
    settings: AnyDeviceSettings
    end_ns: int
    samples: tuple[Sample, ...]
    arrivals: tuple[Received[bytes], ...]
    health: Health


@dataclass(frozen=True, slots=True)
class OpenDevice:
    """A connected device.

    Attributes:
        ask: Makes a device speak that answers only to requests; does nothing for all others.
    """

    settings: AnyDeviceSettings
    driver: AnyDriver
    ask: Callable[[], None]
    overhearing: Overhearing
    samples: list[Sample] = field(default_factory=list)


def open_device(name: str, settings: AnyDeviceSettings, clock: Clock) -> OpenDevice:
    """Connect a device.

    Raises:
        NotConnectedError: Its port cannot be opened.
        ConfigError: A data file that it needs is missing or wrong.
    """
    overhearing = Overhearing()
    ask: Callable[[], None] = _ask_nothing
    driver: AnyDriver
    if isinstance(settings, FrameDeviceSettings):
        driver = settings.make_driver(name, settings.make_link(clock), clock, overhearing)
    else:
        link = settings.make_link(clock)
        driver = settings.make_driver(name, link, clock, overhearing)
        if isinstance(settings, RobotinoBoardSettings):
            ask = partial(_send, link, settings.make_codec(name).encode_stop())
    driver.connect(timeout_s=0.0)
    return OpenDevice(settings, driver, ask, overhearing)


def listen(
    devices: Sequence[OpenDevice],
    clock: Clock,
    *,
    duration_s: float,
    ask_rate_hz: float,
    on_progress: Callable[[float], None],
) -> list[Heard]:
    """Return what connected devices say within `duration_s`.

    Args:
        devices: The devices.
        clock: The host's clock.
        duration_s: For how long.
        ask_rate_hz: How often to ask a device that answers only to requests.
        on_progress: Told the seconds that have passed.
    """
    start_ns = next_ask_ns = clock.now_ns()
    end_ns = start_ns + nanoseconds(duration_s)
    while (now_ns := clock.now_ns()) < end_ns:
        if now_ns >= next_ask_ns:
            next_ask_ns = now_ns + nanoseconds(1.0 / ask_rate_hz)
            for device in devices:
                device.ask()
        for device in devices:
            device.samples.extend(map(_without_pixels, device.driver.poll()))
        on_progress(seconds(now_ns - start_ns))
        clock.sleep_until(min(now_ns + POLL_STEP_NS, next_ask_ns, end_ns))
    return [_heard(device, clock.now_ns()) for device in devices]


def _ask_nothing() -> None:
    pass


def _send(link: Link[bytes], payloads: Sequence[bytes]) -> None:
    for payload in payloads:
        link.send(payload)


def _without_pixels(sample: Sample) -> Sample:
    return replace(sample, image=NO_PIXELS) if isinstance(sample, FrameSample) else sample


def _heard(device: OpenDevice, end_ns: int) -> Heard:
    name = device.driver.name
    return Heard(
        device=name,
        settings=device.settings,
        end_ns=end_ns,
        samples=tuple(device.samples),
        arrivals=tuple(device.overhearing.arrivals),
        health=device.driver.health(),
    )
