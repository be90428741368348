"""Check whether each device delivers what its role needs, often enough."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from controllers.motion.kinematics import make_kinematics
from drivers.clock import seconds
from drivers.samples import HeadingSample, LinkSample, RateSample, Sample, WheelSample
from rover_hil.config import Config
from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.devices.rejections import list_reasons
from rover_hil.doctor.finding import Finding, ok, problem, warning

CHECK = "data"
PERIODS_PER_AGE_LIMIT = 1.8
"""With an age limit of so many periods, one lost sample stops the rover briefly and jitter does not."""
LONGEST_AGE_LIMIT_S = 10.0
BURST_FACTOR = 2.0
"""Samples that follow each other so much faster than on average come from a buffer."""


class Part(NamedTuple):
    """A kind of sample that a device must send, of one wheel or of any."""

    kind: type[Sample]
    wheel: int | None
    name: str


class Stream(NamedTuple):
    """How often something arrived.

    Attributes:
        rate_hz: Mean rate; of a burst from a buffer over the whole time.
        silence_s: Longest time without an arrival.
        span_s: Time from the first arrival to the last.
        is_burst: The samples came much faster than on average: they waited in a buffer.
    """

    sample_count: int
    rate_hz: float
    silence_s: float
    span_s: float
    is_burst: bool


def parts_of(config: Config, device: str) -> list[Part]:
    """Return what the loop needs from a device; from one without a role, any sample."""
    parts: list[Part] = []
    if device == config.roles.wheels:
        wheel_count = make_kinematics(config.rover).wheel_count
        parts += [Part(WheelSample, wheel, f"position of wheel {wheel}") for wheel in range(wheel_count)]
    if device == config.roles.gyro:
        parts.append(Part(RateSample, None, "yaw rate"))
    if device in config.roles.headings:
        parts.append(Part(HeadingSample, None, "heading"))
    return parts or [Part(Sample, None, "sample")]


def stream_of(arrivals_ns: Sequence[int], start_ns: int, end_ns: int) -> Stream:
    """Return the facts about arrivals in order of time, received between `start_ns` and `end_ns`."""
    if not arrivals_ns:
        return Stream(0, 0.0, math.inf, 0.0, False)
    count, start_ns = len(arrivals_ns), min(start_ns, arrivals_ns[0])
    span_s, window_s = seconds(arrivals_ns[-1] - arrivals_ns[0]), seconds(end_ns - start_ns)
    gaps_ns = [later - earlier for earlier, later in pairwise((start_ns, *arrivals_ns, end_ns))]
    # A burst is much shorter than the time in which its samples were sent.
    is_burst = count > 1 and (count + 1) * span_s * BURST_FACTOR < (count - 1) * window_s
    rate_hz = count / window_s if is_burst else (count - 1) / span_s if span_s > 0 else 0.0
    return Stream(count, rate_hz, seconds(max(gaps_ns)), span_s, is_burst)


def check_streams(reception: Reception, parts: Sequence[Part], *, is_required: bool) -> list[Finding]:
    """Check what arrived from a device, and how often; no finding when no sample did."""
    data = [sample for sample in reception.samples if not isinstance(sample, LinkSample)]
    if not data:
        return []
    streams = {
        part: stream_of(
            [sample.t_ns for sample in data if _belongs_to(sample, part)],
            reception.start_ns,
            reception.end_ns,
        )
        for part in parts
    }
    missing = [part.name for part, stream in streams.items() if stream.sample_count == 0]
    present = {part: stream for part, stream in streams.items() if stream.sample_count}
    findings = [_no_part(reception, missing)] if missing else []
    if present:
        findings += _check_rates(reception, present, is_required=is_required)
    return findings or [ok(CHECK, reception.device, _summary(reception, present))]


def check_breaks(reception: Reception) -> list[Finding]:
    """Check whether the link broke."""
    health = reception.health
    if not health.breaks:
        return []
    return [
        problem(
            CHECK,
            reception.device,
            f"the link broke while listening: {health.last_link_reason}",
            "a loose plug or cable, too little power on the USB port, or the end of a recording",
            "push the plugs in firmly, replace the cable, read `sudo dmesg | tail`",
        )
    ]


def _belongs_to(sample: Sample, part: Part) -> bool:
    if isinstance(sample, WheelSample) and part.kind is WheelSample:
        return sample.wheel == part.wheel and sample.position_rad is not None
    return isinstance(sample, part.kind)


def _no_part(reception: Reception, names: list[str]) -> Finding:
    return problem(
        CHECK,
        reception.device,
        f"samples arrive, but no {', no '.join(names)}",
        "the device is not configured to send it, although its role in [roles] needs it",
        "enable this output with the manufacturer's program, or give the role in [roles] to another device",
    )


def _check_rates(reception: Reception, streams: dict[Part, Stream], *, is_required: bool) -> list[Finding]:
    slowest = min(streams, key=lambda part: streams[part].rate_hz)
    silent = max(streams, key=lambda part: streams[part].silence_s)
    rate_hz, silence_s = streams[slowest].rate_hz, streams[silent].silence_s
    max_age_s = reception.settings.max_age_s
    if silence_s > max_age_s and streams[silent].is_burst:
        return [_silence(reception, silent.name, streams[silent])]
    listened_s = seconds(reception.end_ns - reception.start_ns)
    # Samples of the time in which the doctor itself did not run may be lost, and are not missed.
    if rate_hz * max_age_s * listened_s < listened_s - reception.pause_s:
        report = problem if is_required else warning
        return [
            report(
                CHECK,
                reception.device,
                f"{slowest.name}: {rate_hz:.1f} Hz, required are {1 / max_age_s:.1f} Hz (1 / max_age_s)",
                "each sample becomes too old before the next one comes, so the rover would stop repeatedly",
                "raise the device's output rate" + _suggest_age_limit(reception, rate_hz),
            )
        ]
    return [_silence(reception, silent.name, streams[silent])] if silence_s > max_age_s else []


def _silence(reception: Reception, name: str, stream: Stream) -> Finding:
    max_age_s, pause_s = reception.settings.max_age_s, reception.pause_s
    what = f"{name}: silent for {stream.silence_s:.3f} s, the limit max_age_s is {max_age_s:g} s"
    if stream.is_burst:
        count, span_s = stream.sample_count, stream.span_s
        what += f"; {count} samples came in one burst of {span_s:.3f} s, so the rate is unknown"
    if pause_s > max_age_s:
        cause = f"the doctor itself got no processor time for {pause_s:.3f} s: this computer is too busy"
        fix = "end other programs, and run the doctor again"
    elif stream.is_burst:
        cause = "samples waited in a buffer: this computer, or the simulator, was too busy to pass them on"
        fix = "end other programs, and run the doctor again"
    else:
        cause = "samples were lost or late: a busy machine, a loose cable, a USB hub"
        fix = "end other programs, connect without a hub, replace the cable, and run the doctor again"
    return warning(CHECK, reception.device, what, cause, fix)


def _suggest_age_limit(reception: Reception, rate_hz: float) -> str:
    if rate_hz * LONGEST_AGE_LIMIT_S < PERIODS_PER_AGE_LIMIT:
        return ""
    max_age_s = math.ceil(100 * PERIODS_PER_AGE_LIMIT / rate_hz) / 100
    return f", or in [devices.{reception.device}] set max_age_s = {max_age_s:g}"


def _summary(reception: Reception, streams: dict[Part, Stream]) -> str:
    health = reception.health
    rate_hz = min(stream.rate_hz for stream in streams.values())
    age_ms = 1000 * (health.age_s or 0.0)
    rejected = list_reasons(reception) or "none"
    return f"{rate_hz:.1f} Hz, newest {age_ms:.0f} ms old, {health.accepted} samples, rejected: {rejected}"
