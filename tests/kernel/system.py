"""Commands of the machine that the tests run in, and waiting for what they cause."""

import ctypes
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

from drivers.clock import NANOSECONDS_PER_SECOND, SystemClock, nanoseconds

INSIDE = "ROVER_HIL_KERNEL"
"""Variable of the virtual machine: the folder of the unpacked kernel."""
CLOCK = SystemClock()
DEADLINE_S = 10.0
CLOCK_REALTIME = 0


def run(command: str) -> str:
    """Run a command, split at its blanks, and return what it prints; fail with its errors."""
    done = subprocess.run(command.split(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout


def is_done(command: str) -> bool:
    """Run a command and return whether it succeeded."""
    return subprocess.run(command.split(), capture_output=True, check=False).returncode == 0


def load(*modules: str) -> None:
    """Load modules of the kernel; it loads none by itself here."""
    for module in modules:
        run(f"modprobe {module}")


def wait_until(is_done: Callable[[], bool], limit_s: float = DEADLINE_S) -> None:
    """Return when it is done; fail after the limit."""
    deadline_ns = CLOCK.now_ns() + nanoseconds(limit_s)
    while not is_done():
        assert CLOCK.now_ns() < deadline_ns, f"waited for {limit_s} s in vain"
        pause(0.002)


def pause(duration_s: float) -> None:
    """Wait for a time of the machine's clock."""
    CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(duration_s))


def write(path: str | Path, text: str) -> None:
    """Write to a file of the kernel, in one call."""
    file = os.open(path, os.O_WRONLY)
    try:
        os.write(file, text.encode())
    finally:
        os.close(file)


def step_wall_clock(step_s: float) -> None:
    """Set the wall clock by so much; the monotonic clock stays."""
    library = ctypes.CDLL(None, use_errno=True)
    now = (ctypes.c_long * 2)()
    library.clock_gettime(CLOCK_REALTIME, now)
    total_ns = now[0] * NANOSECONDS_PER_SECOND + now[1] + nanoseconds(step_s)
    then = (ctypes.c_long * 2)(*divmod(total_ns, NANOSECONDS_PER_SECOND))
    assert library.clock_settime(CLOCK_REALTIME, then) == 0, os.strerror(ctypes.get_errno())
