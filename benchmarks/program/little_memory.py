"""What a virtual run does under limits of its memory, as `ulimit -v` sets them.

    python -m benchmarks.program.little_memory

Prints the address space that a run needs, then for 20 limits from 200 MB to that: exit code, how many cycles
are in its log, and what it said.
"""

import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from drivers.files import MEGABYTE
from rover_hil.recording.reader import LogReader

PROGRAM = Path(sys.executable).with_name("rover-hil")
LEAST_MB, STEPS = 200, 20
LIMIT_S = 120.0
PEAK = """
import atexit, sys
from pathlib import Path
from rover_hil.app.program import main
atexit.register(lambda: sys.stderr.write(Path("/proc/self/status").read_text()))
sys.argv = ["rover-hil", *sys.argv[1:]]
main()
"""
ARGUMENTS = ("run", "robotino", "--virtual", "--duration", "4", "--out", "a")


def needed_mb(folder: Path) -> int:
    """Return the greatest address space of a run without a limit, MB."""
    done = subprocess.run(
        [sys.executable, "-c", PEAK, *ARGUMENTS], check=True, cwd=folder, capture_output=True, text=True
    )
    line = next(line for line in done.stderr.splitlines() if line.startswith("VmPeak"))
    return int(line.split()[1]) // 1024


def limited_to(size_mb: int) -> Callable[[], None]:
    size = size_mb * MEGABYTE
    return lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size))


def try_limit(size_mb: int, folder: Path) -> str:
    """Return what a run under a limit came to, in words."""
    try:
        done = subprocess.run(
            [PROGRAM, *ARGUMENTS],
            check=False,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            preexec_fn=limited_to(size_mb),
        )
    except subprocess.TimeoutExpired:
        return "HANGS"
    log = folder / "a" / "run.mcap"
    cycles = (
        sum(1 for message in LogReader(log).messages() if message.topic == "/cycle") if log.exists() else 0
    )
    said = [line for line in done.stderr.splitlines() if " s  " not in line]
    return f"exit {done.returncode}, {cycles} cycles, {len(said)} lines: {' '.join(said)[:150]}"


def main() -> None:
    with TemporaryDirectory() as name:
        most_mb = needed_mb(Path(name))
    print(f"a run needs {most_mb} MB")
    for step in range(STEPS):
        size_mb = LEAST_MB + (most_mb - LEAST_MB) * step // (STEPS - 1)
        with TemporaryDirectory() as name:
            print(f"{size_mb:5} MB: {try_limit(size_mb, Path(name))}", flush=True)


if __name__ == "__main__":
    main()
