"""Send SIGTERM, SIGINT and SIGHUP to a real-time run at moments from its start to the end of its drive.

    python -m benchmarks.safety.signals [--times 200] [--seed 1]

Two processes: `rover-hil simulate` and `rover-hil run`, over pseudo-terminals. Half of the moments are spread
over the start, whose time a first run measures, the other half over the drive, from the moment on at which
the log appears: one moment in each of as many equal parts. Each run gets one signal, by turns.
Prints JSON: how the runs ended, and for how long the wheels were commanded after the signal.
Exit code 1 when a signal was lost: another exit code than documented, or wheels commanded for longer than
0.5 s after it; also when no run was moving at its signal, as then nothing is shown.
"""

import argparse
import json
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from drivers.clock import SystemClock, nanoseconds, seconds, wall_time_ns
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import COMMAND, END

PROGRAM = str(Path(sys.executable).with_name("rover-hil"))
NUMBERS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
DRIVE_S = 9.0
"""The rover rests for some seconds first, until its gyro is known."""
BAR_S = 0.5
"""Longest time of commands after a signal; a cycle takes 0.02 s, on a loaded machine much longer."""
MOVING_S = 0.2
"""A rover whose wheels were commanded within this time before the signal, or after it, was moving."""
PATIENCE_S = 120.0
EXIT_CODES = {
    "started": {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 143},
    "stopped by user": {signal.SIGINT: 0},
    "terminated": {signal.SIGTERM: 1, signal.SIGHUP: 1},
    "time over": {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 143},
}
"""By the end in the log: no run, one that the signal ended, and one that had ended before the signal."""


@dataclass(frozen=True, slots=True)
class Drive:
    """What the log says.

    Attributes:
        end: How the run ended; "started" where there is no run.
        moved_ns: Wall time of the last setpoint that is not zero; 0 for none.
    """

    end: str
    moved_ns: int


def read_drive(path: Path) -> Drive:
    """Return how a run ended, and when its wheels were commanded last."""
    if not path.exists():
        return Drive("started", 0)
    end, moved_ns = "no end", 0
    log = LogReader(path)
    for message in log.messages():
        record: Any = message.json() if message.topic in (COMMAND, END) else None
        if message.topic == COMMAND and any(record["speed_rad_s"]):
            moved_ns = log.wall_offset_ns + message.t_ns
        if message.topic == END:
            end = record["end"]
    return Drive(end, moved_ns)


def start(folder: Path, name: str) -> subprocess.Popen[bytes]:
    """Start a run of a few seconds."""
    return subprocess.Popen(
        [PROGRAM, "run", "robotino", "--duration", f"{DRIVE_S:g}", "--out", name],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def wait_for_log(process: subprocess.Popen[bytes], path: Path) -> None:
    """Wait until the log of a run appears, with which its drive begins."""
    clock = SystemClock()
    while process.poll() is None and not path.exists():
        clock.sleep_until(clock.now_ns() + nanoseconds(0.005))


class Signalled(TypedDict):
    """What came of a signal."""

    signal: str
    in_drive: bool
    after_s: float
    end: str
    exit_code: int
    was_moving: bool
    moved_s: float
    is_lost: bool


def signal_once(
    folder: Path, name: str, number: signal.Signals, delay_s: float, *, in_drive: bool
) -> Signalled:
    """Run, send the signal `delay_s` after the start or the begin of the drive; return what came of it."""
    clock = SystemClock()
    start_ns = clock.now_ns()
    process = start(folder, name)
    if in_drive:
        wait_for_log(process, folder / name / "run.mcap")
        start_ns = clock.now_ns()
    clock.sleep_until(start_ns + nanoseconds(delay_s))
    process.send_signal(number)
    sent_ns = wall_time_ns()
    code = process.wait(PATIENCE_S)
    drive = read_drive(folder / name / "run.mcap")
    after_s = seconds(drive.moved_ns - sent_ns)
    moved_s = max(0.0, after_s)
    # Before the program has taken the signals over, the system ends it.
    is_early = drive.end == "started" and code == -number
    is_right = is_early or EXIT_CODES.get(drive.end, {}).get(number) == code
    return {
        "signal": number.name,
        "in_drive": in_drive,
        "after_s": round(delay_s, 3),
        "end": "not taken over" if is_early else drive.end,
        "exit_code": code,
        "was_moving": after_s > -MOVING_S,
        "moved_s": round(moved_s, 3),
        "is_lost": not is_right or moved_s > BAR_S,
    }


def main() -> int:
    """Print the figures as JSON; exit code 1 when a signal was lost."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--times", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    # A job in the background inherits signals that are ignored, and so would the runs.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        simulator = subprocess.Popen(
            [PROGRAM, "simulate", "robotino"],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        clock = SystemClock()
        while not (folder / "ports" / "imu").exists():
            clock.sleep_until(clock.now_ns() + nanoseconds(0.05))
        try:
            start_ns = clock.now_ns()
            whole = start(folder, "whole")
            wait_for_log(whole, folder / "whole" / "run.mcap")
            start_s = seconds(clock.now_ns() - start_ns)
            whole.wait(PATIENCE_S)
            half = arguments.times // 2
            random = np.random.default_rng(arguments.seed).uniform(size=(2, half))
            shares = (np.arange(half) + random) / half
            rows = [
                signal_once(
                    folder,
                    f"run-{index}-{in_drive}",
                    NUMBERS[index % len(NUMBERS)],
                    float((DRIVE_S if in_drive else start_s) * shares[int(in_drive), index]),
                    in_drive=in_drive,
                )
                for index in range(half)
                for in_drive in (False, True)
            ]
        finally:
            simulator.send_signal(signal.SIGINT)
            simulator.wait()
    lost = [row for row in rows if row["is_lost"]]
    figures = {
        "runs": len(rows),
        "start_s": round(start_s, 2),
        "lost": len(lost),
        "ends": Counter(f"{row['end']}, {row['signal']}: {row['exit_code']}" for row in rows),
        "signalled_while_moving": sum(row["was_moving"] for row in rows),
        "longest_motion_after_s": max(row["moved_s"] for row in rows),
        "bar_s": BAR_S,
        "lost_rows": lost,
    }
    print(json.dumps(figures, indent=2))
    return 1 if lost or not figures["signalled_while_moving"] else 0


if __name__ == "__main__":
    sys.exit(main())
