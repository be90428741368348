"""Stuck rovers: after which travel of the wheels are they stopped?

    python -m benchmarks.safety.entrapped_missions [--missions 12] [--first 40000] [--fixes-per-s 0.5]

The Robotino of `tests/nature` drives its rectangle on random ground, every other one slippery, with fixes by
an overhead camera, with the yaw excitation and without; or without fixes, with a camera that measures the
motion over the ground, or with the yaw excitation alone, which does not notice a wall. After 0.2 to 0.8 m it
is lifted, digs in, meets a wall, or one of the two wheels that drive it there sticks. Prints the greatest
travel of the wheels from there to the first stop, and how many were stopped by which reason. Exit code 1
where one travels further than its bar.
"""

import argparse
import sys
from collections import Counter
from itertools import pairwise, product

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.healthy_missions import equipped
from benchmarks.safety.missions import (
    drive,
    ground_camera,
    robotino,
    slippery_floor,
    with_drooping_drives,
    with_fixes,
)
from controllers.safety import Mode
from rover_hil.parallel.executor import open_executor
from tests.nature.omni_contact import Floor
from tests.nature.omni_trapped import TRAPS, TrappedOmni

ALONE = "excitation alone"
BARS_M = {"excitation": 0.8, "encoders": 0.8, "camera": 0.3, ALONE: 1.5}
LIMIT_S = 240.0
"""Wheels of droopy drives turn slowly where the rover has dug in."""
DRIVING = (0, 2)
"""Wheels that drive the first side of the rectangle; the third one only steers there."""


def stopped_after(trap: str, sensors: str, seed: int, fixes_per_s: float) -> tuple[float, str]:
    """Return the wheels' travel from the trap to the first stop, and its reason; "" where there is none."""
    rng = np.random.default_rng(seed)
    at_m, wheel = float(rng.uniform(0.2, 0.8)), DRIVING[seed // 2 % 2]
    floor = slippery_floor(seed) if seed % 2 else Floor.random(rng, rng.uniform(0.001, 0.015))
    config = with_drooping_drives(equipped(robotino(seed), "excitation" if sensors == ALONE else sensors))
    has_camera = sensors == "camera"
    driven = drive(
        config if has_camera or sensors == ALONE else with_fixes(config, fixes_per_s),
        limit_s=LIMIT_S,
        make_camera=ground_camera(seed) if has_camera else None,
        make_plant=lambda start_ns: TrappedOmni(floor, start_ns, trap=trap, at_m=at_m, wheel=wheel),
    )
    travel_m = 0.0
    is_trapped = False
    for before, after in pairwise(driven.moments):
        is_trapped = is_trapped or np.hypot(*before.truth[:2]) >= at_m
        if not is_trapped:
            continue
        if after.output.mode in (Mode.SAFE_STOP, Mode.EMERGENCY_STOP):
            return travel_m, after.output.reason
        a, b = before.output.odometry, after.output.odometry
        travel_m += float(np.hypot(b.x_m - a.x_m, b.y_m - a.y_m))
    return travel_m, ""


def main() -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--missions", type=int, default=12, help="of each trap, with each set of sensors")
    parser.add_argument("--first", type=int, default=40_000)
    parser.add_argument("--fixes-per-s", type=float, default=0.5)
    parser.add_argument("--sensors", choices=tuple(BARS_M), action="append", help="default: all")
    parser.add_argument("--processes", type=int, help="default: one for each processor")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.missions)
    jobs = [
        (*case, seed, arguments.fixes_per_s)
        for case in product(TRAPS, arguments.sensors or BARS_M)
        if case != ("wall", ALONE)
        for seed in seeds
    ]
    by_case: dict[tuple[str, str], list[tuple[float, str]]] = {}
    console = Console()
    with open_executor(arguments.cluster, arguments.processes) as pool:
        results = pool.map(stopped_after, *zip(*jobs, strict=True))
        for job, result in track(
            zip(jobs, results, strict=True), total=len(jobs), console=Console(stderr=True)
        ):
            by_case.setdefault(job[:2], []).append(result)
            if not result[1] or result[0] > BARS_M[job[1]]:
                console.print(f"{job}: {result[0]:.2f} m, {result[1] or 'not stopped'}", soft_wrap=True)
    for (trap, sensors), results_of_case in by_case.items():
        reasons = Counter(
            reason.split(",")[0].split(" by ")[0] or "not stopped" for _, reason in results_of_case
        )
        greatest_m = max(travel_m for travel_m, _ in results_of_case)
        console.print(f"{trap}, {sensors}: at most {greatest_m:.2f} m; {dict(reasons)}", soft_wrap=True)
    is_reached = all(
        reason and travel_m <= BARS_M[sensors]
        for (_, sensors), results_of_case in by_case.items()
        for travel_m, reason in results_of_case
    )
    return 0 if is_reached else 1


if __name__ == "__main__":
    sys.exit(main())
