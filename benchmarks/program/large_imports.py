"""Do large sound files open within the limits that `import` sets?

    python -m benchmarks.program.large_imports [--gigabytes 1] [--hours 1] [--only table|can|bag]

A table of some hours with 50 rows/s, a log of a busy CAN bus and a bag with pictures of some GB are made and
imported by the command, with its own limits. Prints JSON: size, elapsed time, processor time and greatest
memory of all processes of each import; exit code 1 where one fails.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores

from benchmarks.program.can_logs import ROVER as CAN_ROVER
from drivers.can_wheels.mapping_file import SHIPPED_FOLDER
from drivers.clock import NANOSECONDS_PER_SECOND, stopwatch_ns
from tests.rover_hil.test_import_rosbag import WHEELS, Messages
from tests.rover_hil.test_import_table import RADIANS, ROVER, TIME

PROGRAM = (sys.executable, "-c", "from rover_hil.app.program import main; main()")
GIGABYTE = 1e9
MAPPING = SHIPPED_FOLDER / "odrive_0_6.toml"
FRAMES_AT_ONCE = 100_000
BUS_FRAMES_PER_S, WHEEL_FRAMES_PER_S = 8000, 400
PICTURES_PER_S, PICTURE_BYTES, JOINTS_PER_S = 10, 100_000, 50
START_NS = 1_700_000_000 * NANOSECONDS_PER_SECOND


def write_table(folder: Path, hours: float, _: float) -> tuple[Path, list[str]]:
    """Write a table of a differential rover that drives circles; return it and the words that import it."""
    t_s = np.arange(0.0, 3600.0 * hours, 0.02)
    path, columns = folder / "drive.csv", folder / "columns.toml"
    np.savetxt(path, np.c_[t_s, 6.5 * t_s, 9.5 * t_s], "%.6f", ",", header="t,l,r", comments="")
    columns.write_text(ROVER + TIME + RADIANS, "utf-8")
    return path, ["table", str(path), "--columns", str(columns)]


def write_can(folder: Path, _: float, gigabytes: float) -> tuple[Path, list[str]]:
    """Write a candump log in which one frame of twenty is of a wheel."""
    path, rover = folder / "bus.log", folder / "rover.toml"
    rover.write_text(CAN_ROVER, "utf-8")
    step = BUS_FRAMES_PER_S // WHEEL_FRAMES_PER_S
    with path.open("w", encoding="ascii") as file:
        for first in count(step=FRAMES_AT_ONCE):
            if file.tell() > gigabytes * GIGABYTE:
                break
            lines = []
            for number in range(first, first + FRAMES_AT_ONCE):
                t_s = number / BUS_FRAMES_PER_S
                if number % step == 0:
                    identifier = number // step % 4 * 32 + 9
                    data = np.array((t_s, 1.0), "<f4").tobytes().hex()
                else:
                    identifier, data = 0x400 + number % 64, f"{number:016x}"
                lines.append(f"({1.7e9 + t_s:.6f}) can0 {identifier:03X}#{data.upper()}\n")
            file.writelines(lines)
    return path, ["can", str(path), "--config", str(rover), "--map", str(MAPPING)]


def write_bag(folder: Path, _: float, gigabytes: float) -> tuple[Path, list[str]]:
    """Write a bag of a Robotino with pictures, which make up nearly all of it."""
    path, columns = folder / "bag", folder / "topics.toml"
    columns.write_text(WHEELS + '[camera]\ntopic = "/camera/compressed"\n', "utf-8")
    messages, random = Messages(Stores.ROS2_HUMBLE), np.random.default_rng(1)
    make = messages.types["sensor_msgs/msg/CompressedImage"]
    head = messages.picture(START_NS, 0.0).data
    with BagWriter(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics: dict[str, Any] = {}

        def write(topic: str, t_ns: int, message: Any) -> None:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, message.__msgtype__, typestore=messages.store)
            writer.write(topics[topic], t_ns, messages.bytes(message))

        for cycle in range(round(gigabytes * GIGABYTE / PICTURE_BYTES * JOINTS_PER_S / PICTURES_PER_S)):
            t_s = cycle / JOINTS_PER_S
            t_ns = START_NS + round(t_s * NANOSECONDS_PER_SECOND)
            write("/joints", t_ns, messages.wheels(t_ns, t_s))
            if cycle % (JOINTS_PER_S // PICTURES_PER_S) == 0:
                rest = random.integers(0, 256, PICTURE_BYTES - len(head), np.uint8)
                data = np.concatenate((head, rest))
                write("/camera/compressed", t_ns, make(messages.header(t_ns), "jpeg", data))
    return path, ["rosbag", str(path), "--topics", str(columns)]


KINDS: dict[str, Callable[[Path, float, float], tuple[Path, list[str]]]] = {
    "table": write_table,
    "can": write_can,
    "bag": write_bag,
}


def imported(kind: str, hours: float, gigabytes: float) -> dict[str, object]:
    """Make a file and import it; return how that went."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, words = KINDS[kind](folder, hours, gigabytes)
        files = [path] if path.is_file() else [*path.rglob("*")]
        size_mb = sum(file.stat().st_size for file in files) / 1e6
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        start_ns = stopwatch_ns()
        done = subprocess.run(
            [*PROGRAM, "import", *words, "--out", "drive.mcap"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        elapsed_s = (stopwatch_ns() - start_ns) / NANOSECONDS_PER_SECOND
        now = resource.getrusage(resource.RUSAGE_CHILDREN)
        return {
            "kind": kind,
            "size_mb": round(size_mb, 1),
            "exit_code": done.returncode,
            "elapsed_s": round(elapsed_s, 1),
            "processor_s": round(now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime, 1),
            "greatest_mb": round(now.ru_maxrss / 1024),
            "last_line": (done.stdout + done.stderr).strip().splitlines()[-1:],
        }


def main() -> int:
    """Print the outcomes; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--gigabytes", type=float, default=1.0)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--only", choices=KINDS)
    options = parser.parse_args()
    outcomes = []
    for kind in [options.only] if options.only else KINDS:
        outcomes.append(imported(kind, options.hours, options.gigabytes))
        print(json.dumps(outcomes[-1]), flush=True)
    return 1 if any(outcome["exit_code"] for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
