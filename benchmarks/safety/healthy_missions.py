"""False alarms: healthy missions of both shipped rovers on slippery ground, which nothing may stop.

    python -m benchmarks.safety.healthy_missions [--missions 300] [--el-dorado 20] [--first 20000]

The Robotino drives its rectangle on random sites of loose and soft patches, the El-Dorado a line of 1.5 m on
slopes of sand of up to 12 deg in any direction. Prints every stop with its reason and the number of missions
with one; exit code 1 where there is any.
"""

import argparse
import sys
from collections import Counter

from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.missions import ROVERS, drive
from rover_hil.parallel.executor import open_executor


def reasons(rover: str, seed: int) -> tuple[str, list[str]]:
    """Drive one mission; return its end, and the reason of every stop with its time."""
    driven = drive(ROVERS[rover](seed))
    return driven.mode.value, [f"{stop.t_s:.2f} s: {stop.output.reason}" for stop in driven.stops()]


def main() -> int:
    """Print the stops; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--missions", type=int, default=300)
    parser.add_argument("--el-dorado", type=int, default=20, help="how many of them the El-Dorado drives")
    parser.add_argument("--first", type=int, default=20_000, help="seed of the first mission")
    parser.add_argument("--processes", type=int, help="default: one for each processor")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.missions)
    count = arguments.missions - arguments.el_dorado
    rovers = ["robotino"] * count + ["el-dorado"] * arguments.el_dorado
    console, stopped, ends = Console(), 0, Counter[str]()
    with open_executor(arguments.cluster, arguments.processes) as pool:
        found = pool.map(reasons, rovers, seeds)
        missions = zip(rovers, seeds, found, strict=True)
        for rover, seed, (end, stops) in track(missions, total=len(rovers), console=Console(stderr=True)):
            ends[f"{rover}: {end}"] += 1
            stopped += bool(stops)
            for stop in stops:
                console.print(f"{rover} {seed}: {stop}", soft_wrap=True)
    console.print(f"{stopped} of {len(rovers)} healthy missions were stopped; ends: {dict(ends)}")
    return 1 if stopped else 0


if __name__ == "__main__":
    sys.exit(main())
