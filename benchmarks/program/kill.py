"""Kill a real-time run with SIGKILL at random moments; does its log open, and how much is missing?

    python -m benchmarks.program.kill [--times 10] [--seed 1]

Two processes: `rover-hil simulate robotino` and `rover-hil run robotino`, over pseudo-terminals.
"""

import argparse
import json
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TypedDict

import numpy as np

from drivers.clock import SystemClock, nanoseconds
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.replay import replay

PROGRAM = str(Path(sys.executable).with_name("rover-hil"))
BAR_MS = 1000


class Killed(TypedDict):
    """What the log of a killed run holds."""

    killed_after_s: float
    missing_ms: float
    cycles: int
    replay_differences: int


def kill_once(folder: Path, name: str, delay_s: float) -> Killed:
    """Run, kill after `delay_s` of logging, and return what the log holds."""
    clock = SystemClock()
    process = subprocess.Popen(
        [PROGRAM, "run", "robotino", "--out", name],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    path = folder / name / "run.mcap"
    while not path.exists() or path.stat().st_size == 0:
        clock.sleep_until(clock.now_ns() + nanoseconds(0.01))
    clock.sleep_until(clock.now_ns() + nanoseconds(delay_s))
    process.send_signal(signal.SIGKILL)
    killed_ns = clock.now_ns()
    process.wait()
    log = LogReader(path)
    last_ns = max((message.t_ns for message in log.messages()), default=log.start_ns)
    with restore_config(log) as config:
        result = replay(log, config, lambda: None)
    return {
        "killed_after_s": round(delay_s, 2),
        "missing_ms": round((killed_ns - last_ns) / 1e6, 1),
        "cycles": result.cycles,
        "replay_differences": len(result.differences),
    }


def main() -> int:
    """Print the figures as JSON; exit code 1 when more than the last second is missing anywhere."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    delays_s = np.random.default_rng(arguments.seed).uniform(0.2, 6.0, arguments.times)
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        simulator = subprocess.Popen(
            [PROGRAM, "simulate", "robotino"],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            rows = [
                kill_once(folder, f"run-{index}", float(delay_s)) for index, delay_s in enumerate(delays_s)
            ]
        finally:
            simulator.send_signal(signal.SIGINT)
            simulator.wait()
    worst_ms = max(row["missing_ms"] for row in rows)
    differences = sum(row["replay_differences"] for row in rows)
    print(
        json.dumps(
            {"seed": arguments.seed, "worst_missing_ms": worst_ms, "bar_ms": BAR_MS, "rows": rows}, indent=2
        )
    )
    return 0 if worst_ms <= BAR_MS and differences == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
