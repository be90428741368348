"""Does each device deliver what its role needs, often enough?"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from controllers.motion.kinematics import make_kinematics
from drivers.clock import seconds
from drivers.samples import HeadingSample, LinkSample, RateSample, Sample, WheelSample
from rover_hil.config import Config
from rover_hil.doctor.finding import Finding, ok, problem, warning
from rover_hil.doctor.listening import Heard
from rover_hil.doctor.rejections import list_reasons

CHECK = "data"
PERIODS_PER_AGE_LIMIT = 1.8
"""With an age limit of so many periods, one lost sample stops the rover briefly and jitter does not."""
LONGEST_AGE_LIMIT_S = 10.0


class Part(NamedTuple):
    """One thing a device must keep telling: a kind of sample, of one wheel or of any."""

    kind: type[Sample]
    wheel: int | None
    name: str


class Stream(NamedTuple):
    """How often something came; `silence_s` is the longest time without it."""

    sample_count: int
    rate_hz: float
    silence_s: float


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


def stream_of(arrivals_ns: Sequence[int], end_ns: int) -> Stream:
    """Return the facts about arrivals in order of time, listened to until `end_ns`."""
    if not arrivals_ns:
        return Stream(0, 0.0, math.inf)
    span_s = seconds(arrivals_ns[-1] - arrivals_ns[0])
    rate_hz = (len(arrivals_ns) - 1) / span_s if span_s > 0 else 0.0
    gaps_ns = [later - earlier for earlier, later in pairwise((*arrivals_ns, end_ns))]
    return Stream(len(arrivals_ns), rate_hz, seconds(max(gaps_ns)))


def check_streams(heard: Heard, parts: Sequence[Part], *, is_required: bool) -> list[Finding]:
    """Look at what arrived from a device and how often; says nothing when no sample did."""
    told = [sample for sample in heard.samples if not isinstance(sample, LinkSample)]
    if not told:
        return []
    streams = {
        part: stream_of([sample.t_ns for sample in told if _belongs_to(sample, part)], heard.end_ns)
        for part in parts
    }
    missing = [part.name for part, stream in streams.items() if stream.sample_count == 0]
    present = {part: stream for part, stream in streams.items() if stream.sample_count}
    findings = [_no_part(heard, missing)] if missing else []
    if present:
        findings += _check_rates(heard, present, is_required=is_required)
    return findings or [ok(CHECK, heard.device, _summary(heard, present))]


def check_breaks(heard: Heard) -> list[Finding]:
    """Look whether the link held."""
    health = heard.health
    if not health.breaks:
        return []
    return [
        problem(
            CHECK,
            heard.device,
            f"the link broke while listening: {health.last_link_reason}",
            "a loose plug or cable, too little power on the USB port, or the end of a recording",
            "press the plugs home, replace the cable, look at `sudo dmesg | tail`",
        )
    ]


def _belongs_to(sample: Sample, part: Part) -> bool:
    if isinstance(sample, WheelSample) and part.kind is WheelSample:
        return sample.wheel == part.wheel and sample.position_rad is not None
    return isinstance(sample, part.kind)


def _no_part(heard: Heard, names: list[str]) -> Finding:
    return problem(
        CHECK,
        heard.device,
        f"samples arrive, but no {', no '.join(names)}",
        "the device is not set to send that, although its role in [roles] needs it",
        "switch this output on with the maker's program, or give the role in [roles] to another device",
    )


def _check_rates(heard: Heard, streams: dict[Part, Stream], *, is_required: bool) -> list[Finding]:
    slowest = min(streams, key=lambda part: streams[part].rate_hz)
    silent = max(streams, key=lambda part: streams[part].silence_s)
    rate_hz, silence_s = streams[slowest].rate_hz, streams[silent].silence_s
    max_age_s = heard.settings.max_age_s
    if rate_hz * max_age_s < 1:
        judge = problem if is_required else warning
        return [
            judge(
                CHECK,
                heard.device,
                f"{slowest.name}: {rate_hz:.1f} Hz, needed are {1 / max_age_s:.1f} Hz (1 / max_age_s)",
                "each sample grows too old before the next one comes, so the rover would keep stopping",
                "raise the device's output rate" + _suggest_age_limit(heard, rate_hz),
            )
        ]
    if silence_s > max_age_s:
        return [
            warning(
                CHECK,
                heard.device,
                f"{silent.name}: silent for {silence_s:.3f} s, the limit max_age_s is {max_age_s:g} s",
                "samples were lost or late: a busy machine, a loose cable, a USB hub",
                "end other programs, connect without a hub, replace the cable, and run the doctor again",
            )
        ]
    return []


def _suggest_age_limit(heard: Heard, rate_hz: float) -> str:
    if rate_hz * LONGEST_AGE_LIMIT_S < PERIODS_PER_AGE_LIMIT:
        return ""
    max_age_s = math.ceil(100 * PERIODS_PER_AGE_LIMIT / rate_hz) / 100
    return f", or in [devices.{heard.device}] set max_age_s = {max_age_s:g}"


def _summary(heard: Heard, streams: dict[Part, Stream]) -> str:
    health = heard.health
    rate_hz = min(stream.rate_hz for stream in streams.values())
    age_ms = 1000 * (health.age_s or 0.0)
    rejected = list_reasons(heard) or "none"
    return f"{rate_hz:.1f} Hz, newest {age_ms:.0f} ms old, {health.accepted} samples, rejected: {rejected}"
