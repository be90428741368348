"""Check whether the loop can be on time. Warnings only: without real-time scheduling cycles are later."""

import os

from rover_hil.doctor.finding import Finding, SystemPaths, ok, read_text, warning
from rover_hil.run.real_time import PRIORITY

CHECK = "scheduling"
GOOD_GOVERNORS = frozenset({"performance", "schedutil"})


def may_use_realtime() -> bool:
    """Return whether this user may use SCHED_FIFO, by a try that is taken back."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    os.sched_setscheduler(0, policy, parameters)
    return True


def check_scheduling(paths: SystemPaths, *, realtime_allowed: bool) -> list[Finding]:
    """Check the right to real-time scheduling and the processors' governors."""
    findings: list[Finding] = []
    if not realtime_allowed:
        findings.append(
            warning(
                CHECK,
                "SCHED_FIFO",
                "this user may not use real-time scheduling, so `run --realtime` fails",
                "the system grants the right only to users named in its limits",
                "add 'USER - rtprio 99' to /etc/security/limits.conf and log in again, "
                "or run without --realtime",
            )
        )
    folders = sorted((paths.sys / "devices/system/cpu").glob("cpu[0-9]*"))
    governors = {read_text(folder / "cpufreq/scaling_governor") for folder in folders} - {None}
    slow = sorted(str(governor) for governor in governors - GOOD_GOVERNORS)
    if slow:
        findings.append(
            warning(
                CHECK,
                "CPU governor",
                f"the processors use the governor {', '.join(slow)}",
                "it lowers the clock between the cycles of the loop, which makes the next one late",
                "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
            )
        )
    return findings or [ok(CHECK, "host", "real-time scheduling is allowed, the CPU governors are fast")]
