"""Is the covariance of the Robotino's pose right? NEES over missions on random ground, compensated and not.

    python -m benchmarks.robotino.consistency [--missions 20] [--first 30000] [--workers 1]

Each mission drives the rectangle on a random site, once with the shipped slip compensation and once without.
The pose is compared with the plant's truth at the time of the estimate, every half second of driving. Prints
for position (two numbers) and yaw (one): share inside the 95 % ellipse, required 90 to 98 %; mean NEES over
the dimension, required 0.5 to 1.5; root mean square of the error and of the reported standard deviation; the
same at the end of the missions. Exit code 1 where a figure is outside.
"""

import argparse
import math
import sys
from collections import Counter, defaultdict

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.missions import Moment, drive, robotino
from controllers.safety import Mode
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor

Array = NDArray[np.float64]

EVERY_S = 0.5
INSIDE_BAR = (0.90, 0.98)
NEES_BAR = (0.5, 1.5)
BOUND = {2: 5.991, 1: 3.841}
"""95 % of a chi-square distribution."""
WAYS = ("compensated", "not compensated")


def configured(seed: int, way: str) -> Config:
    """Return the shipped Robotino on a random site, with or without slip compensation."""
    config = robotino(seed)
    return config if way == "compensated" else config.model_copy(update={"slip": None})


def figures(moment: Moment, truth: Array) -> tuple[float, ...]:
    """Return NEES, squared error and variance of the position, then of the yaw, against x, y, yaw."""
    estimate = moment.output.estimate
    xx, xy, _, yy, _, tt = estimate.covariance
    position = np.array([estimate.x_m, estimate.y_m]) - truth[:2]
    yaw_rad = math.remainder(estimate.yaw_rad - truth[2], math.tau)
    nees = float(position @ np.linalg.solve(np.array([[xx, xy], [xy, yy]]) + 1e-12 * np.eye(2), position))
    return (nees, float(position @ position), xx + yy, yaw_rad**2 / (tt + 1e-12), yaw_rad**2, tt)


def mission(seed: int, way: str) -> tuple[str, list[tuple[float, ...]]]:
    """Drive one mission; return its last mode, and the figures of each half second."""
    driven = drive(configured(seed, way))
    times_s = [moment.t_s for moment in driven.moments]
    truths = np.array([moment.truth for moment in driven.moments])
    rows: list[tuple[float, ...]] = []
    next_s = 0.0
    for moment in driven.moments:
        if moment.output.mode is Mode.RUNNING and moment.t_s >= next_s:
            then_s = moment.t_s - moment.age_s
            rows.append(
                figures(moment, np.array([np.interp(then_s, times_s, values) for values in truths.T]))
            )
            next_s = moment.t_s + EVERY_S
    return driven.mode.value, rows


def main() -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--missions", type=int, default=20)
    parser.add_argument("--first", type=int, default=30_000, help="seed of the first mission")
    parser.add_argument("--workers", type=int, default=1)
    add_cluster_option(parser)
    arguments = parser.parse_args()
    jobs = [
        (seed, way) for seed in range(arguments.first, arguments.first + arguments.missions) for way in WAYS
    ]
    rows: defaultdict[str, list[tuple[float, ...]]] = defaultdict(list)
    last: defaultdict[str, list[tuple[float, ...]]] = defaultdict(list)
    ends = Counter[str]()
    with open_executor(arguments.cluster, arguments.workers) as pool:
        results = pool.map(mission, *zip(*jobs, strict=True))
        for (_, way), (end, figures_) in track(
            zip(jobs, results, strict=True), total=len(jobs), console=Console(stderr=True)
        ):
            rows[way] += figures_
            last[way].append(figures_[-1])
            ends[f"{way}: {end}"] += 1
    is_right = True
    for way in WAYS:
        for part, table in (("all", np.array(rows[way])), ("end", np.array(last[way]))):
            for name, column, size in (("position", 0, 2), ("yaw", 3, 1)):
                nees, error2, variance = table[:, column : column + 3].T
                inside, mean = float((nees <= BOUND[size]).mean()), float(nees.mean()) / size
                if part == "all":
                    is_right &= INSIDE_BAR[0] <= inside <= INSIDE_BAR[1]
                    is_right &= NEES_BAR[0] <= mean <= NEES_BAR[1]
                print(
                    f"{way:<16}{part:<4}{name:<9} inside {inside:6.1%}  NEES/dimension {mean:5.2f}  "
                    f"error {np.sqrt(error2.mean()):.4f}  reported {np.sqrt(variance.mean()):.4f}"
                )
    print(dict(ends))
    return 0 if is_right else 1


if __name__ == "__main__":
    sys.exit(main())
