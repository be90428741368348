"""Listen to a port and find out which device it is. Nothing is sent that could turn a wheel.

A port that talks by itself is only listened to. A silent one is asked: whether it is an slcan adapter ("C",
close the channel), then whether it is the board of a Robotino (a request with zero speeds).
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.camera.settings import CameraSettings
from drivers.can.frame import CanFrame, unpack_can_frame
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.clock import Clock, nanoseconds, seconds
from drivers.device_settings import DriveSettings, SerialDeviceSettings
from drivers.driver import Rejection
from drivers.errors import NotConnectedError
from drivers.link import Link, Received
from drivers.registry import AnyDeviceSettings, device_types
from drivers.robotino3_board.settings import Robotino3BoardSettings
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import AttitudeSample, HeadingSample, LinkSample, PoseFixSample, RateSample
from drivers.serial_link import SerialLink
from rover_hil.doctor.devices.listening import listen, open_device
from rover_hil.drives.files.can_frames import read_can_log, timed_payloads

LISTEN_S = 0.8
FIRST_LISTEN_S = 1.5
"""To a serial port that may be silent: a compass may send once per second."""
BAUD_RATES = (115_200, 9_600, 4_800, 38_400, 57_600, 230_400, 460_800, 921_600)
TALKERS = tuple(
    kind
    for kind in device_types()
    if issubclass(kind, SerialDeviceSettings) and not issubclass(kind, DriveSettings)
)
"""Sensors that talk by themselves on a serial port."""
CAN_BIT_RATES = (500_000, 1_000_000, 250_000, 125_000)
MOST_FRAMES = 20_000
"""So many frames of a log show what is on its bus."""
LEAST_SAMPLES = 2
MOST_REJECTED = 0.2
"""Of all frames; others of the same protocol do not count."""
CLOSE_CHANNEL = b"\rC\r"
POLL_NS = 10_000_000
BUSY_WAITS = 20
BUSY = 1.5
"""Waits over the time wanted, and running programs over processors, from which on devices may be missed."""
REQUEST_RATE_HZ = 20.0
AGE_PERIODS = 2.5
"""Age limit of a device over the period of its samples: one lost sample is no alarm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A device, and what was heard.

    Attributes:
        settings: What it needs in the configuration.
        what: What was heard, in words.
        kinds: Names of what it measures: `rate`, `heading`, `attitude`, `position`, `frames`, `wheels`,
            `can`.
        rate_hz: Samples per second of the slowest kind that is used.
        frames: CAN frames that were on the bus.
    """

    settings: AnyDeviceSettings
    what: str
    kinds: frozenset[str]
    rate_hz: float
    frames: tuple[CanFrame, ...] = ()


def probe_serial(port: str, clock: Clock, step: Callable[[str], None]) -> Found | str:
    """Return the device at a serial port, or why it was not recognised."""
    heard = 0
    try:
        for baud_rate in BAUD_RATES:
            step(f"{port}: listening at {baud_rate} bit/s")
            duration_s = LISTEN_S if heard else FIRST_LISTEN_S
            arrivals = _listen_raw(SerialLink(port, baud_rate, clock, 0.0), clock, duration_s)
            heard += sum(len(each.payload) for each in arrivals)
            if not heard:
                break
            talker = _talker(port, baud_rate, arrivals, duration_s)
            if talker is not None:
                return talker
        if heard:
            return "sends bytes of an unknown device"
        step(f"{port}: silent; asking for an slcan adapter")
        if _is_slcan(port, clock):
            return probe_can("slcan", port, clock, step)
        step(f"{port}: silent; asking for a Robotino board")
        return _board(port, clock) or "silent"
    except NotConnectedError as error:
        return str(error)


def probe_can(interface: str, channel: str, clock: Clock, step: Callable[[str], None]) -> Found | str:
    """Return what is on a CAN bus, or why nothing was heard."""
    heard = ""
    for bit_rate in CAN_BIT_RATES if interface == "slcan" else CAN_BIT_RATES[:1]:
        step(f"{channel}: listening to the CAN bus at {bit_rate} bit/s")
        settings = CanWheelsSettings.model_validate(
            {"interface": interface, "channel": channel, "bit_rate": bit_rate, "mapping": "generic_wheel"}
        )
        try:
            arrivals = _listen_raw(settings.make_link(clock), clock, LISTEN_S)
        except NotConnectedError as error:
            return str(error)
        unpacked = [unpack_can_frame(each.payload) for each in arrivals]
        frames = tuple(frame for frame in unpacked if frame is not None and not frame.is_error)
        if frames:
            return _bus(settings, f"CAN bus at {bit_rate} bit/s", frames, LISTEN_S)
        heard = heard or "a CAN bus on which nothing is sent: switch the drives on"
    return heard


def probe_can_log(path: Path) -> Found:
    """Return what is on the bus of a CAN log.

    Which interface leads to the bus is not in a log: it is called can0.

    Raises:
        LogError: The file cannot be read, or holds several buses.
        ConfigError: A library is missing.
    """
    log = read_can_log(path)
    payloads = timed_payloads(log, np.arange(min(len(log), MOST_FRAMES)), float(log.t_s[0]))
    unpacked = [(t_ns, unpack_can_frame(payload)) for t_ns, payload in payloads]
    frames = tuple(frame for _, frame in unpacked if frame is not None and not frame.is_error)
    settings = CanWheelsSettings(interface="socketcan", channel="can0", mapping="generic_wheel")
    duration_s = max(seconds(unpacked[-1][0]), LISTEN_S)
    return _bus(settings, f"CAN bus in {path.name}", frames, duration_s)


def _bus(settings: CanWheelsSettings, name: str, frames: tuple[CanFrame, ...], duration_s: float) -> Found:
    numbers = sorted({frame.can_id for frame in frames})
    shown = ", ".join(f"0x{number:X}" for number in numbers[:8])
    return Found(
        settings=settings,
        what=f"{name} with {len(numbers)} messages: {shown}",
        kinds=frozenset({"can"}),
        rate_hz=len(frames) / duration_s / max(len(numbers), 1),
        frames=frames,
    )


def probe_camera(path: str, clock: Clock, *, is_folder: bool, step: Callable[[str], None]) -> Found | str:
    """Return the camera at a path, or why it gave no frames."""
    step(f"{path}: waiting for frames")
    import cv2

    sizes: list[tuple[int, int]] = [(640, 480), (1280, 720), (320, 240)]
    if is_folder:
        pictures = (cv2.imread(str(each)) for each in sorted(Path(path).iterdir()) if each.is_file())
        picture = next((each for each in pictures if each is not None), None)
        if picture is None:
            return "a folder without pictures"
        sizes = [(picture.shape[1], picture.shape[0])]
    problem = "no frames"
    for width, height in sizes:
        settings = CameraSettings.model_validate(
            {
                "type": "camera",
                "source": "live_folder" if is_folder else "v4l2",
                "path": path,
                "width": width,
                "height": height,
                "frame_rate_hz": 5,
            }
        )
        try:
            samples, rate_hz = _listen_to(settings, clock, 2.0)
        except NotConnectedError as error:
            problem = str(error)
            continue
        if samples:
            frame_rate_hz = float(max(1, round(rate_hz)))
            update = {"frame_rate_hz": frame_rate_hz, "max_age_s": max_age_s(frame_rate_hz)}
            return Found(
                settings=settings.model_copy(update=update),
                what=f"camera, {width} x {height} at {rate_hz:.0f} Hz",
                kinds=frozenset({"frames"}),
                rate_hz=rate_hz,
            )
    return problem


def busy_words(clock: Clock) -> str:
    """Return why this machine may have missed devices; "" where it is not busy."""
    begin_ns = clock.now_ns()
    for _ in range(BUSY_WAITS):
        clock.sleep_until(clock.now_ns() + POLL_NS)
    wait_ms = (clock.now_ns() - begin_ns) / BUSY_WAITS / 1e6
    load, processors = os.getloadavg()[0], os.cpu_count() or 1
    if wait_ms < 1e-6 * BUSY * POLL_NS and load < BUSY * processors:
        return ""
    return (
        f"this machine is too busy: {load:.0f} programs want its {processors} processors, and a wait of "
        f"{POLL_NS / 1e6:.0f} ms took {wait_ms:.0f} ms. Devices may have been missed, simulated ones above "
        "all: end other programs and try again"
    )


def max_age_s(rate_hz: float) -> float:
    """Return the age limit for a device that sends at a rate."""
    return float(min(10.0, max(0.15, round(AGE_PERIODS / max(rate_hz, 0.26), 2))))


def _listen_raw(link: Link[bytes], clock: Clock, duration_s: float) -> list[Received[bytes]]:
    link.open(0.5)
    arrivals: list[Received[bytes]] = []
    try:
        now_ns = clock.now_ns()
        end_ns = now_ns + nanoseconds(duration_s)
        while now_ns < end_ns:
            clock.sleep_until(now_ns + POLL_NS)
            arrivals += [each for each in link.receive() if isinstance(each, Received)]
            now_ns = clock.now_ns()
    finally:
        link.close()
    return arrivals


def _talker(
    port: str, baud_rate: int, arrivals: Sequence[Received[bytes]], duration_s: float
) -> Found | None:
    """Return the device whose codec understands what arrived."""
    for kind in TALKERS:
        settings = kind.model_validate({"type": _tag(kind), "port": port, "baud_rate": baud_rate})
        codec = settings.make_codec("probe")
        results = [result for each in arrivals for result in codec.decode(each)]
        samples = [each for each in results if not isinstance(each, Rejection)]
        # The first bytes are often the rest of a frame.
        wrong = [
            each for each in results if isinstance(each, Rejection) and not each.reason.startswith("other")
        ]
        if len(samples) < LEAST_SAMPLES or len(wrong) - 1 > MOST_REJECTED * len(samples):
            continue
        names = {
            RateSample: "rate",
            HeadingSample: "heading",
            AttitudeSample: "attitude",
            PoseFixSample: "position",
        }
        kinds = {names[type(each)] for each in samples if type(each) in names}
        counts = [sum(names.get(type(each)) == name for each in samples) for name in kinds]
        rate_hz = min(counts, default=0) / duration_s
        settings = settings.model_copy(update={"max_age_s": max_age_s(rate_hz)})
        shown = ", ".join(sorted(kinds)) or "other samples"
        return Found(
            settings=settings,  # type: ignore[arg-type]  # the talkers are devices of the registry
            what=f"{settings.type} at {baud_rate} bit/s: {shown} at {rate_hz:.0f} Hz",  # type: ignore[attr-defined]
            kinds=frozenset(kinds),
            rate_hz=rate_hz,
        )
    return None


def _tag(kind: type[SerialDeviceSettings]) -> str:
    from typing import get_args

    return str(get_args(kind.model_fields["type"].annotation)[0])


def _is_slcan(port: str, clock: Clock) -> bool:
    link = SerialLink(port, BAUD_RATES[0], clock, 0.0)
    link.open(0.5)
    answer = b""
    try:
        link.send(CLOSE_CHANNEL)
        for _ in range(40):
            clock.sleep_until(clock.now_ns() + POLL_NS)
            answer += b"".join(each.payload for each in link.receive() if isinstance(each, Received))
            if answer:
                break
    finally:
        link.close()
    return bool(answer) and set(answer) <= set(b"\r\a")


def _board(port: str, clock: Clock) -> Found | None:
    candidates: list[AnyDeviceSettings] = [
        RobotinoBoardSettings.model_validate({"type": "robotino_board", "port": port, "board": board})
        for board in ("EA05", "EA09")
    ]
    candidates.append(Robotino3BoardSettings.model_validate({"type": "robotino3_board", "port": port}))
    for settings in candidates:
        samples, rate_hz = _listen_to(settings, clock, LISTEN_S)
        if samples >= LEAST_SAMPLES:
            what = f"{settings.type}, it answers"
            return Found(settings=settings, what=what, kinds=frozenset({"wheels"}), rate_hz=rate_hz)
    return None


def _listen_to(settings: AnyDeviceSettings, clock: Clock, duration_s: float) -> tuple[int, float]:
    """Return number and rate of the samples of a device."""
    device = open_device("probe", settings, clock)
    try:
        (reception,) = listen(
            [device], clock, duration_s=duration_s, request_rate_hz=REQUEST_RATE_HZ, on_progress=_ignore
        )
    finally:
        device.driver.close()
    count = sum(not isinstance(sample, LinkSample) for sample in reception.samples)
    return count, count / duration_s


def _ignore(seconds: float) -> None:
    pass
