"""Receives from all devices at once for a short time. Nothing is sent that could turn a wheel."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from drivers.clock import Clock, nanoseconds, seconds
from drivers.device_settings import FrameDeviceSettings
from drivers.driver import AnyDriver, Health
from drivers.link import CameraImage, Link, LinkItem, Received
from drivers.registry import AnyDeviceSettings
from drivers.robotino3_board.settings import Robotino3BoardSettings
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import FrameSample, Sample
from drivers.witmotion.codec import READ_BANDWIDTH
from drivers.witmotion.settings import WitMotionSettings

POLL_STEP_NS = 5_000_000
NO_PIXELS = np.zeros((0, 0), dtype=np.uint8)


class RawRecorder:
    """A raw tap that keeps the payloads of a byte device."""

    def __init__(self) -> None:
        self.arrivals: list[Received[bytes]] = []

    def received(self, device: str, item: LinkItem[bytes] | LinkItem[CameraImage]) -> None:
        """Keep a payload."""
        if isinstance(item, Received) and isinstance(item.payload, bytes):
            self.arrivals.append(Received(item.t_ns, item.payload))

    def sent(self, device: str, t_ns: int, payload: bytes, delivered: bool) -> None:
        """Ignore what was sent."""


@dataclass(frozen=True, slots=True)
class Reception:
    """What one device sent while the doctor listened; frames without their pixels.

    Attributes:
        start_ns: When listening began.
        end_ns: When listening ended.
        pause_s: Longest time in which this program got no processor time to poll the devices.
        arrivals: Payloads before decoding; empty for cameras.
    """

    device: str
    settings: AnyDeviceSettings
    start_ns: int
    end_ns: int
    pause_s: float
    samples: tuple[Sample, ...]
    arrivals: tuple[Received[bytes], ...]
    health: Health


@dataclass(frozen=True, slots=True)
class OpenDevice:
    """A connected device.

    Attributes:
        request: Requests a reply from a device that only answers; does nothing for all others.
    """

    settings: AnyDeviceSettings
    driver: AnyDriver
    request: Callable[[], None]
    recorder: RawRecorder
    samples: list[Sample] = field(default_factory=list)


def open_device(name: str, settings: AnyDeviceSettings, clock: Clock) -> OpenDevice:
    """Connect a device.

    Raises:
        NotConnectedError: Its port cannot be opened.
        ConfigError: A data file that it needs is missing or wrong.
    """
    recorder = RawRecorder()
    request: Callable[[], None] = _request_nothing
    driver: AnyDriver
    if isinstance(settings, FrameDeviceSettings):
        driver = settings.make_driver(name, settings.make_link(clock), clock, recorder)
    else:
        link = settings.make_link(clock)
        driver = settings.make_driver(name, link, clock, recorder)
        if isinstance(settings, RobotinoBoardSettings | Robotino3BoardSettings):
            request = partial(_send, link, settings.make_codec(name).encode_stop())
        elif isinstance(settings, WitMotionSettings):
            request = _Once(partial(_send, link, (READ_BANDWIDTH,)))
    driver.connect(timeout_s=0.0)
    return OpenDevice(settings, driver, request, recorder)


def listen(
    devices: Sequence[OpenDevice],
    clock: Clock,
    *,
    duration_s: float,
    request_rate_hz: float,
    on_progress: Callable[[float], None],
) -> list[Reception]:
    """Return what connected devices send within `duration_s`.

    Args:
        devices: The devices.
        clock: The host's clock.
        duration_s: Duration.
        request_rate_hz: Rate of the requests to a device that only answers.
        on_progress: Called with the seconds that have passed.
    """
    start_ns = next_request_ns = last_ns = clock.now_ns()
    end_ns = start_ns + nanoseconds(duration_s)
    pause_ns = 0
    while (now_ns := clock.now_ns()) < end_ns:
        pause_ns, last_ns = max(pause_ns, now_ns - last_ns), now_ns
        if now_ns >= next_request_ns:
            next_request_ns = now_ns + nanoseconds(1.0 / request_rate_hz)
            for device in devices:
                device.request()
        for device in devices:
            device.samples.extend(map(_without_pixels, device.driver.poll()))
        on_progress(seconds(now_ns - start_ns))
        clock.sleep_until(min(now_ns + POLL_STEP_NS, next_request_ns, end_ns))
    pause_s = seconds(max(pause_ns, now_ns - last_ns))
    return [_reception(device, start_ns, clock.now_ns(), pause_s) for device in devices]


class _Once:
    """Sends a request at the second call only: the first bytes to a new link may be lost."""

    def __init__(self, send: Callable[[], None]) -> None:
        self._send, self._calls = send, 0

    def __call__(self) -> None:
        self._calls += 1
        if self._calls == 2:
            self._send()


def _request_nothing() -> None:
    pass


def _send(link: Link[bytes], payloads: Sequence[bytes]) -> None:
    for payload in payloads:
        link.send(payload)


def _without_pixels(sample: Sample) -> Sample:
    return replace(sample, image=NO_PIXELS) if isinstance(sample, FrameSample) else sample


def _reception(device: OpenDevice, start_ns: int, end_ns: int, pause_s: float) -> Reception:
    device.samples.extend(map(_without_pixels, device.driver.poll()))
    name = device.driver.name
    return Reception(
        device=name,
        settings=device.settings,
        start_ns=start_ns,
        end_ns=end_ns,
        pause_s=pause_s,
        samples=tuple(device.samples),
        arrivals=tuple(device.recorder.arrivals),
        health=device.driver.health(),
    )
