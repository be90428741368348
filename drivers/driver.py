"""The driver contract: a link below, a pure codec inside, samples and health facts above.

A new device is a settings model, a codec and a registry line: `docs/contributing/add_a_device.md`.
"""

import math
import threading
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Generic, Protocol, Self, TypeVar, runtime_checkable

from drivers.clock import NANOSECONDS_PER_SECOND, Clock, nanoseconds, seconds
from drivers.errors import LinkTimeoutError, NotConnectedError, StaleSampleError
from drivers.link import CameraImage, Link, LinkChange, LinkItem, NoTap, PayloadT, RawTap, Received
from drivers.safety_event import RESTART, Outcome, SafetyEvent
from drivers.samples import FaultSample, LinkSample, Sample, SentCommand, WheelCommand

SampleT = TypeVar("SampleT", bound=Sample)

WAIT_STEP_NS = 1_000_000
RATE_WINDOW_NS = 2_000_000_000
MOST_BYTES_PER_POLL = 32_768
"""What a poll decodes at most, the newest: 0.25 s of a full CAN bus at 1 Mbit/s, 2.8 s of a serial port at
115 200 baud. More comes from a stalled program or from a device that floods, and would stall every cycle."""
RESTARTS = 3
"""How often a drive with a fault is started again."""
RESTART_AFTER_NS = NANOSECONDS_PER_SECOND
"""Wait after a fault, so that its cause can end and the rover stands still."""

EVENTS = (
    SafetyEvent(
        Outcome.CONTINUES,
        "A command comes late to the drive.",
        "Zero speeds are sent instead.",
        ("tests/drivers/test_driver.py::test_expired_command_sends_zero",),
        settings=("expiry_s",),
    ),
    SafetyEvent(
        Outcome.CONTINUES,
        "Bytes cannot be decoded, messages are lost or repeated.",
        "They are counted. The rover stops only when nothing usable is left.",
        ("tests/rover_hil/test_virtual_run.py::test_a_bad_line_never_breaks_the_loop",),
    ),
    SafetyEvent(
        Outcome.CONTINUES,
        "A device floods, or a stalled program finds more data than one cycle can decode.",
        "The newest 32 KiB are decoded. The rest is counted as `lost` in the health of the device.",
        ("tests/drivers/test_driver.py::test_a_flood_costs_one_poll_and_the_rest_is_counted_as_lost",),
    ),
    SafetyEvent(
        Outcome.CONTINUES,
        "The drive of a wheel reports a fault that its start sequence clears (a watchdog that "
        "expired while a cable was out).",
        "The fault stops the rover. The drive is started again after 1 s, at most three times. A "
        "start that was not sent does not count.",
        (
            "tests/drivers/test_driver.py::"
            "test_a_drive_with_a_fault_is_started_again_after_a_second_and_at_most_three_times",
        ),
    ),
    SafetyEvent(
        Outcome.ENDS,
        "A device cannot be opened.",
        "no run, exit code 2; nothing was commanded",
        ("tests/conformance/test_conformance.py::test_missing_port_fails_clearly_and_leaves_no_handle",),
        within="before the first motion",
        clears=RESTART,
    ),
)
"""Rows of the reference page of safety."""


class DeviceState(StrEnum):
    """State of a device; each state defines what the hardware may do.

    CLOSED: no handle; the hardware is not touched.
    CONNECTED: handle open, nothing valid received yet; commands are sent but not confirmed.
    STREAMING: valid data younger than the age limit; the hardware may move.
    DEGRADED: link broken and being reopened, or data too old; the hardware must stand still.
    FAILED: given up; the hardware must stand still until a restart.
    """

    CLOSED = "closed"
    CONNECTED = "connected"
    STREAMING = "streaming"
    DEGRADED = "degraded"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Rejection:
    """Wire data that a codec did not accept.

    Attributes:
        reason: One of a small fixed set of words per codec, e.g. "checksum"; it is counted.
    """

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """Separate facts about a device, computed on request.

    Attributes:
        rate_hz: Messages of the most frequent kind per second, over the last two seconds.
        age_s: Age of the newest sample, or None before the first since the link came up.
        rejected: How often the codec rejected wire data, by reason.
        breaks: How often the link broke; giving up afterwards does not count again.
        lost: Payloads that arrived and were not decoded: more than one poll takes, or a full queue.
    """

    device: str
    state: DeviceState
    rate_hz: float
    age_s: float | None
    accepted: int
    rejected: Mapping[str, int]
    breaks: int
    sent: int
    send_failures: int
    last_link_reason: str
    lost: int = 0


class Codec(Protocol[PayloadT]):
    """Pure translation of payloads to samples; keeps half-received frames, nothing else."""

    def decode(self, item: Received[PayloadT]) -> Sequence[Sample | Rejection]:
        """Return the samples and rejections that `item` completes. Never raises on wire data."""
        ...

    def reset(self) -> None:
        """Forget half-received frames and unwrapping state after the link broke."""
        ...


class DriveCodec(Codec[bytes], Protocol):
    """A codec of a device that also turns wheels."""

    wheel_count: int

    def encode_start(self) -> Sequence[bytes]:
        """Return what switches the drive on, to be sent before the first command after link-up."""
        ...

    def encode_speeds(self, speed_rad_s: Sequence[float]) -> tuple[Sequence[bytes], tuple[float, ...]]:
        """Return payloads for the wheel speed setpoints, and the speeds they really mean.

        `speed_rad_s` holds `wheel_count` finite numbers; the caller checks.
        """
        ...

    def encode_stop(self) -> Sequence[bytes]:
        """Return what switches the drive off after standstill; may be empty."""
        ...

    def encode_emergency_stop(self) -> Sequence[bytes]:
        """Return what stops the wheels in whatever state the drive is; changes nothing in the codec.

        A process that does not know what was sent before sends it, again and again, also to a drive at rest
        or in the middle of a frame. The drive is left in a state from which the driver starts it again.
        """
        ...


@runtime_checkable
class SteeringCodec(DriveCodec, Protocol):
    """A codec of a drive that also steers wheels.

    Attributes:
        steering_limits_rad: Least and greatest setpoint that the device takes, by the index of each wheel
            that it steers; empty where the device has no such signal.
    """

    steering_limits_rad: Mapping[int, tuple[float, float]]

    def encode_set_points(
        self, speed_rad_s: Sequence[float], steering_rad: Sequence[float]
    ) -> tuple[Sequence[bytes], tuple[float, ...], tuple[float, ...]]:
        """Return payloads for speeds and steering angles, and the ones they really mean.

        Both hold `wheel_count` finite numbers. `encode_speeds` keeps the last steering angles.
        """
        ...


@runtime_checkable
class WrappingCodec(Protocol):
    """A codec that knows after which angle the device's own count of each wheel wraps, inf for never.

    The codec counts the turns. A device that was silent for long may have turned by more.
    """

    wheel_wraps_rad: tuple[float | None, ...]


class Driver(Generic[PayloadT]):
    """A device: link, codec and the facts about both.

    The constructor stores its arguments and does nothing else. All methods are for one thread, the loop's;
    only a drive's `stop` may be called from another.

    Args:
        name: Name of the device in the configuration.
        link: Where raw data comes from.
        codec: How it is read.
        clock: The host's clock.
        max_age_s: Samples older than this make the device DEGRADED.
        tap: Sees raw data before it is parsed.
    """

    def __init__(
        self,
        name: str,
        link: Link[PayloadT],
        codec: Codec[PayloadT],
        clock: Clock,
        *,
        max_age_s: float,
        tap: RawTap | None = None,
    ) -> None:
        self.name = name
        self._link: Link[PayloadT] = link
        self._codec: Codec[PayloadT] = codec
        self._clock = clock
        self._max_age_ns = nanoseconds(max_age_s)
        self._tap: RawTap = tap or NoTap()
        self._open = False
        self._link_up = False
        self._gave_up = False
        self._latest: dict[type[Sample], Sample] = {}
        self._newest_ns: int | None = None
        self._arrivals: dict[type[Sample], deque[int]] = {}
        self._accepted = 0
        self._rejected: Counter[str] = Counter()
        self._breaks = 0
        self._sent = 0
        self._send_failures = 0
        self._lost = 0
        self._last_link_reason = ""

    def connect(self, timeout_s: float = 2.0) -> None:
        """Open the link; does nothing when it is open.

        Raises:
            NotConnectedError: The port cannot be opened; no handle is left behind.
        """
        if self._open:
            return
        self._link.open(timeout_s)
        self._codec.reset()
        self._forget_samples()
        self._open = True
        self._link_up = True
        self._gave_up = False

    def close(self) -> None:
        """Close the link; may be called again."""
        if self._open:
            self._link.close()
        self._open = False
        self._link_up = False

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def poll(self) -> list[Sample]:
        """Return every sample that arrived since the last call, oldest first.

        Raises:
            NotConnectedError: Before `connect` or after `close`.
        """
        self._require_open("poll")
        samples: list[Sample] = []
        for item in self._newest(self._link.receive()):
            self._tap.received(self.name, item)
            if isinstance(item, LinkChange):
                samples.append(self._note_link_change(item))
            else:
                for decoded in self._codec.decode(item):
                    if isinstance(decoded, Rejection):
                        self._rejected[decoded.reason] += 1
                    else:
                        self._note_sample(decoded)
                        samples.append(decoded)
        return samples

    def _newest(self, items: Sequence[LinkItem[PayloadT]]) -> Sequence[LinkItem[PayloadT]]:
        """Return the newest bytes that one poll takes, with every break; count the rest as lost."""
        sizes = list(map(_byte_count, items))
        surplus = sum(sizes) - MOST_BYTES_PER_POLL
        if surplus <= 0:
            return items
        kept: list[LinkItem[PayloadT]] = []
        for item, size in zip(items, sizes, strict=True):
            if size and surplus > 0:
                surplus -= size
                self._lost += 1
            else:
                kept.append(item)
        return kept

    def latest(self, kind: type[SampleT], max_age_s: float) -> SampleT:
        """Return the newest sample of a kind since the link came up.

        Raises:
            NotConnectedError: Before `connect` or after `close`.
            StaleSampleError: There is none, or it is older than `max_age_s`.
        """
        self._require_open("latest")
        sample = self._latest.get(kind)
        if not isinstance(sample, kind):
            raise StaleSampleError(f"device '{self.name}' has sent no {kind.__name__} yet")
        age_s = seconds(self._clock.now_ns() - sample.t_ns)
        if age_s > max_age_s:
            what = f"newest {kind.__name__} of device '{self.name}'"
            raise StaleSampleError(f"{what} is {age_s:.3f} s old, limit {max_age_s:.3f} s")
        return sample

    def wait_next(self, kind: type[SampleT], timeout_s: float) -> SampleT:
        """Return the next sample of a kind that arrives after the call.

        Raises:
            NotConnectedError: Before `connect` or after `close`.
            LinkTimeoutError: None arrived within `timeout_s`.
        """
        self.poll()
        deadline_ns = self._clock.now_ns() + nanoseconds(timeout_s)
        while self._clock.now_ns() < deadline_ns:
            self._clock.sleep_until(self._clock.now_ns() + WAIT_STEP_NS)
            for sample in self.poll():
                if isinstance(sample, kind):
                    return sample
        raise LinkTimeoutError(f"device '{self.name}' sent no {kind.__name__} within {timeout_s:.3f} s")

    def health(self) -> Health:
        """Return the facts about this device as of now."""
        now_ns = self._clock.now_ns()
        return Health(
            device=self.name,
            state=self._state(now_ns),
            rate_hz=self._rate_hz(now_ns),
            age_s=None if self._newest_ns is None else seconds(now_ns - self._newest_ns),
            accepted=self._accepted,
            rejected=MappingProxyType(dict(self._rejected)),
            breaks=self._breaks,
            sent=self._sent,
            send_failures=self._send_failures,
            last_link_reason=self._last_link_reason,
            lost=self._lost + self._link.dropped,
        )

    def _state(self, now_ns: int) -> DeviceState:
        if not self._open:
            return DeviceState.CLOSED
        if self._gave_up:
            return DeviceState.FAILED
        if not self._link_up:
            return DeviceState.DEGRADED
        if self._newest_ns is None:
            return DeviceState.CONNECTED
        if now_ns - self._newest_ns > self._max_age_ns:
            return DeviceState.DEGRADED
        return DeviceState.STREAMING

    def _rate_hz(self, now_ns: int) -> float:
        counts = (
            sum(1 for t_ns in arrivals if now_ns - t_ns <= RATE_WINDOW_NS)
            for arrivals in self._arrivals.values()
        )
        return max(counts, default=0) / seconds(RATE_WINDOW_NS)

    def _note_sample(self, sample: Sample) -> None:
        kind = type(sample)
        self._accepted += 1
        self._newest_ns = sample.t_ns
        self._latest[kind] = sample
        arrivals = self._arrivals.get(kind)
        if arrivals is None:
            arrivals = self._arrivals[kind] = deque(maxlen=4096)
        if not arrivals or arrivals[-1] != sample.t_ns:  # one message may hold several samples of a kind
            arrivals.append(sample.t_ns)

    def _note_link_change(self, change: LinkChange) -> LinkSample:
        if change.up:
            self._forget_samples()
        elif self._link_up:
            self._breaks += 1
        self._link_up = change.up
        self._gave_up = change.gave_up
        self._last_link_reason = change.reason
        self._codec.reset()
        return LinkSample(device=self.name, t_ns=change.t_ns, up=change.up, reason=change.reason)

    def _forget_samples(self) -> None:
        """Forget what arrived before the link came up; it is not fresh."""
        self._latest.clear()
        self._newest_ns = None

    def _require_open(self, method: str) -> None:
        if not self._open:
            raise NotConnectedError(f"device '{self.name}' is closed: call connect() before {method}()")


class WheelDrive(Driver[bytes]):
    """A driver whose device also turns wheels.

    A command and a stop from another thread follow each other, they never mix. Only sending is locked; the
    tap is called afterwards, so that a recorder that hangs cannot block a stop.

    A drive whose wheels report a fault is started again, at most three times, a second after the fault and
    only while zero speeds are commanded: what starts it may clear the fault, as that of a watchdog which
    expired while a cable was out. Without effect the fault stays, and with it the stop.
    """

    def __init__(
        self,
        name: str,
        link: Link[bytes],
        codec: DriveCodec,
        clock: Clock,
        *,
        max_age_s: float,
        tap: RawTap | None = None,
    ) -> None:
        super().__init__(name, link, codec, clock, max_age_s=max_age_s, tap=tap)
        self._drive_codec = codec
        self.wheel_count = codec.wheel_count
        self.wheel_wraps_rad = codec.wheel_wraps_rad if isinstance(codec, WrappingCodec) else ()
        self._steering_codec = (
            codec if isinstance(codec, SteeringCodec) and codec.steering_limits_rad else None
        )
        self._started = False
        self._turn = threading.Lock()
        self._fault_ns: dict[int, int] = {}
        self._restarts = 0

    def close(self) -> None:
        """Close the link; may be called again. A drive that was commanded last is stopped first."""
        try:
            if self._open and self._started:
                self.stop()
        finally:
            super().close()

    def command(self, command: WheelCommand) -> SentCommand:
        """Send wheel speed setpoints; an expired or malformed command sends zero speeds instead.

        Such a command does not steer either: the last steering angles stay.

        Returns:
            The setpoints that the device really got, and whether they went out.

        Raises:
            NotConnectedError: Before `connect` or after `close`.
        """
        self._require_open("command")
        sent: list[tuple[bytes, bool]] = []
        with self._turn:
            now_ns = self._clock.now_ns()
            speeds, angles_rad = command.speed_rad_s, command.steering_rad
            is_valid = len(speeds) == self.wheel_count and all(map(math.isfinite, speeds))
            if not is_valid or now_ns >= command.expires_ns:
                speeds, angles_rad = (0.0,) * self.wheel_count, None
            is_restart = self._needs_restart(now_ns, speeds)
            if is_restart or not self._started:
                self._started = self._send(self._drive_codec.encode_start(), sent)
            if is_restart and self._started:  # a start that did not go out is tried again, and not counted
                self._restarts += 1
                self._fault_ns = dict.fromkeys(self._fault_ns, now_ns)
            payloads, really, steering_rad = self._encode(speeds, angles_rad)
            delivered = self._send(payloads, sent)
        self._note_sent(now_ns, sent)
        return SentCommand(t_ns=now_ns, speed_rad_s=really, delivered=delivered, steering_rad=steering_rad)

    def _encode(
        self, speeds: Sequence[float], steering_rad: tuple[float, ...] | None
    ) -> tuple[Sequence[bytes], tuple[float, ...], tuple[float, ...] | None]:
        """Return payloads and what they mean; steering angles that are malformed do not change."""
        codec = self._steering_codec
        if (
            codec is None
            or steering_rad is None
            or len(steering_rad) != self.wheel_count
            or not all(map(math.isfinite, steering_rad))
        ):
            return (*self._drive_codec.encode_speeds(speeds), None)
        return codec.encode_set_points(speeds, steering_rad)

    def stop(self) -> int:
        """Send zero speeds three times, then switch the drive off. Silent when the link is down.

        Returns:
            The time in ns at which it was sent: later than the call where a command went out first.
        """
        self._require_open("stop")
        sent: list[tuple[bytes, bool]] = []
        with self._turn:
            now_ns = self._clock.now_ns()
            for _ in range(3):  # encoded anew: a counter must advance
                payloads, _ = self._drive_codec.encode_speeds((0.0,) * self.wheel_count)
                self._send(payloads, sent)
            self._send(self._drive_codec.encode_stop(), sent)
            self._started = False
        self._note_sent(now_ns, sent)
        return now_ns

    def _needs_restart(self, now_ns: int, speeds: Sequence[float]) -> bool:
        """Return whether a fault is old enough, and the rover is at rest."""
        if not self._fault_ns:
            return False
        is_due = any(now_ns - t_ns >= RESTART_AFTER_NS for t_ns in self._fault_ns.values())
        return is_due and not any(speeds) and self._restarts < RESTARTS

    def _note_sample(self, sample: Sample) -> None:
        if isinstance(sample, FaultSample) and sample.wheel is not None:
            if sample.code:
                self._fault_ns.setdefault(sample.wheel, sample.t_ns)
            else:
                self._fault_ns.pop(sample.wheel, None)
        super()._note_sample(sample)

    def _send(self, payloads: Sequence[bytes], sent: list[tuple[bytes, bool]]) -> bool:
        """Send payloads, append each with its outcome to `sent`, and return whether all went out."""
        outcomes = [self._link.send(payload) for payload in payloads]
        sent.extend(zip(payloads, outcomes, strict=True))
        return all(outcomes)

    def _note_sent(self, now_ns: int, sent: Sequence[tuple[bytes, bool]]) -> None:
        for payload, went_out in sent:
            self._sent += went_out
            self._send_failures += not went_out
            self._tap.sent(self.name, now_ns, payload, went_out)

    def _note_link_change(self, change: LinkChange) -> LinkSample:
        self._started = False
        return super()._note_link_change(change)


AnyDriver = Driver[bytes] | Driver[CameraImage]


def _byte_count(item: LinkItem[bytes] | LinkItem[CameraImage]) -> int:
    payload = item.payload if isinstance(item, Received) else b""
    return len(payload) if isinstance(payload, bytes) else 0
