"""Drive for half an hour in real time as two processes: does memory stay flat, does the healthy rover stop?

    python -m benchmarks.safety.soak [--minutes 30] [--keep FOLDER]

Two processes: `rover-hil simulate` and `rover-hil run`, over pseudo-terminals and slcan. The mission
repeats a square.
Prints JSON: memory of both processes at the start and the end, its growth in the second half, the stops.
Exit code 1 when the program grows by more than 5 MB in the second half, stops the rover, or fails.
"""

import argparse
import json
import math
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.safety.faults.processes import CONFIGS
from drivers.clock import SystemClock, nanoseconds, seconds

PROGRAM = str(Path(sys.executable).with_name("rover-hil"))
EVERY_S = 5.0
WARM_UP_S = 60.0
GROWTH_BAR_MB = 5.0
SQUARE = [[0.9, 0.0], [0.9, 0.9], [0.0, 0.9], [0.0, 0.0]]
LAPS = 400
FORM = re.compile(r'^(?:type = "rectangle"|(?:length|width)_m = .*)\n', re.MULTILINE)
"""The form of the shipped mission; speed and gains are kept."""


def memory_mb(process: subprocess.Popen[bytes]) -> float:
    """Return the resident memory of a process, in MB; 0 when it has ended."""
    text = Path(f"/proc/{process.pid}/status").read_text()
    resident = re.search(r"VmRSS:\s+(\d+) kB", text)
    return int(resident[1]) / 1000.0 if resident else 0.0


def endless_config() -> str:
    """Return the shipped Robotino with a mission that repeats a square."""
    text = FORM.sub("", (CONFIGS / "robotino.toml").read_text())
    text = text.replace("[mission]\n", f'[mission]\ntype = "waypoints"\npoints = {SQUARE * LAPS}\n')
    return re.sub(r"^time_limit_s = .*$", "time_limit_s = 86400", text, flags=re.MULTILINE)


def main() -> int:
    """Print the figures as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--keep", type=Path, help="new folder for the configuration, the log and the report")
    arguments = parser.parse_args()
    clock = SystemClock()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(exist_ok=not arguments.keep)
        (folder / "rover.toml").write_text(endless_config())
        simulator = subprocess.Popen(
            [PROGRAM, "simulate", "rover.toml"], cwd=folder, stdout=subprocess.DEVNULL
        )
        duration_s = 60.0 * arguments.minutes
        program = subprocess.Popen(
            [PROGRAM, "run", "rover.toml", "--duration", f"{duration_s:g}", "--out", "out"],
            cwd=folder,
            stdout=subprocess.DEVNULL,
        )
        rows = []
        try:
            start_ns = clock.now_ns()
            while program.poll() is None:
                rows.append((seconds(clock.now_ns() - start_ns), memory_mb(program), memory_mb(simulator)))
                clock.sleep_until(clock.now_ns() + nanoseconds(EVERY_S))
        finally:
            for process in (program, simulator):
                if process.poll() is None:
                    process.send_signal(signal.SIGINT)
                    process.wait()
        stops = json.loads((folder / "out" / "summary.json").read_text())["stops"]
        log_mb = (folder / "out" / "run.mcap").stat().st_size / 1e6
    # Afterwards the program reads its whole log for the report.
    table = np.array([row for row in rows if WARM_UP_S < row[0] < duration_s]).reshape(-1, 3)
    half = table[table[:, 0] > duration_s / 2]
    growth_mb = (half[-1, 1:] - half[0, 1:]).tolist() if len(half) else [math.inf]
    print(
        json.dumps(
            {
                "minutes": arguments.minutes,
                "driven_s": rows[-1][0],
                "program_mb": table[[0, -1], 1].tolist() if len(table) else [],
                "simulator_mb": table[[0, -1], 2].tolist() if len(table) else [],
                "growth_in_second_half_mb": growth_mb,
                "stops": stops,
                "log_mb": round(log_mb, 1),
                "exit_code": program.returncode,
            },
            indent=2,
        )
    )
    is_complete = rows[-1][0] >= duration_s - EVERY_S
    return 0 if is_complete and growth_mb[0] <= GROWTH_BAR_MB and not stops else 1


if __name__ == "__main__":
    sys.exit(main())
