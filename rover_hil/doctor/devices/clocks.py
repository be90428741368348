"""Check whether the clocks run evenly."""

from typing import NamedTuple

from drivers.clock import Clock, date_of, seconds, wall_time_ns
from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.finding import Finding, ok, warning

CHECK = "clock"
LARGEST_STEP_S = 0.01
"""Slewing moves the wall clock by 500 ppm at most, which is 1 ms in two seconds."""
EARLIEST_YEAR = 2026
"""The program did not exist before."""
LARGEST_DRIFT = 0.02
SHORTEST_SPAN_S = 0.5


class ClockPair(NamedTuple):
    """Wall clock and monotonic clock at one instant."""

    wall_ns: int
    monotonic_ns: int


def read_clocks(clock: Clock) -> ClockPair:
    """Read both clocks of the host."""
    return ClockPair(wall_time_ns(), clock.now_ns())


def check_host_clock(before: ClockPair, after: ClockPair) -> list[Finding]:
    """Compare the advance of the wall clock and of the monotonic clock between two readings."""
    step_s = seconds((after.wall_ns - before.wall_ns) - (after.monotonic_ns - before.monotonic_ns))
    findings: list[Finding] = []
    if abs(step_s) > LARGEST_STEP_S:
        findings.append(
            warning(
                CHECK,
                "host",
                f"the wall clock jumped by {step_s:+.3f} s while listening",
                "a time server has just set it; CAN time stamps are wrong for a moment, not the loop",
                "wait until `timedatectl` reports that the system clock is synchronized",
            )
        )
    if date_of(after.wall_ns).year < EARLIEST_YEAR:
        findings.append(
            warning(
                CHECK,
                "host",
                f"the date is {date_of(after.wall_ns)}",
                "the computer has no battery-backed clock and found no time server; logs get wrong dates",
                "sudo timedatectl set-ntp true; without a network: sudo date -s 'YYYY-MM-DD HH:MM'",
            )
        )
    return findings or [
        ok(CHECK, "host", f"wall clock and monotonic clock agree to {abs(step_s) * 1e6:.0f} us")
    ]


def check_device_clock(reception: Reception) -> list[Finding]:
    """Compare the device's own clock, where it has one, with the host's over a long enough time."""
    # The first sample may have been measured long before it was requested.
    pairs = [(s.t_ns, s.t_device_ns) for s in reception.samples if s.t_device_ns is not None]
    pairs = [pair for pair in pairs if pair[0] > pairs[0][0]]
    if not pairs or seconds(pairs[-1][0] - pairs[0][0]) < SHORTEST_SPAN_S:
        return []
    host_ns, device_ns = (last - first for first, last in zip(pairs[0], pairs[-1], strict=True))
    drift = device_ns / host_ns - 1.0
    if abs(drift) > LARGEST_DRIFT:
        return [
            warning(
                CHECK,
                reception.device,
                f"the device's clock runs {100 * drift:+.1f} % against the host's",
                "it does not run, was reset while listening, or its samples are delayed on the way",
                "switch the device off and on; end other programs; run the doctor again",
            )
        ]
    return [ok(CHECK, reception.device, f"the device's clock runs {100 * drift:+.2f} % against the host's")]
