"""A Robotino with pose fixes and without slip compensation: which uncertainty of the slip does it need?

    python -m benchmarks.robotino.fixes_without_compensation [--missions 40] [--first 500] [--workers 1]

Each mission drives the rectangle on a random site, with an overhead camera, without [slip], and with
`slip_sd` of [ground] as the only setting of the estimate. Prints for each value how the missions ended,
how often fixes displaced against the estimate stopped the rover, and NEES over 3 and error of the pose, every
half second of driving.
"""

import argparse
import math
from collections import Counter
from statistics import fmean

from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.missions import drive, robotino, with_fixes
from controllers.safety import Mode
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor

VALUES = (0.0, 0.1, 0.2, 0.3, 0.4)
EVERY_CYCLES = 25


def configured(seed: int, slip_sd: float, fixes_per_s: float) -> Config:
    """Return the shipped Robotino on a random site, with fixes and without compensation."""
    table = robotino(seed).model_dump(by_alias=True)
    table["slip"], table["filter"], table["ground"] = None, {}, {"slip_sd": slip_sd}
    return with_fixes(Config.model_validate(table), fixes_per_s)


def mission(seed: int, slip_sd: float, fixes_per_s: float) -> tuple[str, int, float, float]:
    """Drive one mission; return its last mode, stops by displaced fixes, mean NEES and squared error."""
    driven = drive(configured(seed, slip_sd, fixes_per_s))
    running = [moment for moment in driven.moments if moment.output.mode is Mode.RUNNING][::EVERY_CYCLES]
    return (
        driven.mode.value,
        sum("displaced by" in moment.output.reason for moment in driven.stops()),
        fmean(moment.nees for moment in running),
        fmean(float(moment.error[:2] @ moment.error[:2]) for moment in running),
    )


def main() -> None:
    """Print a line for each rate of the fixes and each value."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--missions", type=int, default=40)
    parser.add_argument("--first", type=int, default=500, help="seed of the first mission")
    parser.add_argument("--fixes-per-s", type=float, nargs="+", default=[1.0, 0.5, 0.2])
    parser.add_argument("--workers", type=int, default=1)
    add_cluster_option(parser)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.missions)
    groups = [(rate, value) for rate in arguments.fixes_per_s for value in VALUES]
    jobs = [(seed, value, rate) for rate, value in groups for seed in seeds]
    with open_executor(arguments.cluster, arguments.workers) as pool:
        outcomes = pool.map(mission, *zip(*jobs, strict=True))
        results = list(track(outcomes, total=len(jobs), console=Console(stderr=True)))
    for index, (rate, value) in enumerate(groups):
        ends, stops, nees, error_m2 = zip(*results[index * len(seeds) :][: len(seeds)], strict=True)
        print(
            f"{rate:g} fixes/s  slip_sd {value:g}  displaced {sum(stops):3} times in "
            f"{sum(map(bool, stops)):2} missions  NEES/3 {fmean(nees) / 3:.2f}  "
            f"error {math.sqrt(fmean(error_m2)):.3f} m  {dict(Counter(ends))}"
        )


if __name__ == "__main__":
    main()
