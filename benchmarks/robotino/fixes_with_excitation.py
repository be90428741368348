"""Errors of the overhead camera's fixes with the yaw excitation and without.

    python -m benchmarks.robotino.fixes_with_excitation [--missions 4] [--first 9200]

Each mission drives the rectangle of the shipped Robotino on a random site twice, with a picture each half
second. Each fix is compared with the true pose at the time of its picture. The frame of the calibration is
not that of the start, so the rigid motion that fits all fixes of a mission to its true poses is taken out.
"""

import argparse
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.missions import drive, robotino, with_fixes
from controllers.safety import Mode
from drivers.samples import PoseFixSample, Sample
from rover_hil.parallel.executor import open_executor

FIXES_PER_S = 2.0
WAYS = ("excitation off", "excitation on")
Errors = NDArray[np.float64]


def mission(seed: int, way: str) -> Errors:
    """Drive once; return the errors of the fixes of the moving rover: x, y in m, yaw in rad, (n, 3)."""
    config = robotino(seed)
    if way == WAYS[0]:
        config = config.model_copy(update={"slip": None})
    config = with_fixes(config, FIXES_PER_S)
    fixes: dict[int, PoseFixSample] = {}

    def keep(_: float, sample: Sample) -> Sample:
        if isinstance(sample, PoseFixSample):
            fixes[sample.t_ns] = sample
        return sample

    moments = drive(config, keep).moments
    running = [moment for moment in moments if moment.output.mode is Mode.RUNNING]
    t_ns = [moment.output.t_ns for moment in running]
    true = np.array([moment.truth for moment in running])
    seen = [fix for fix in fixes.values() if t_ns[0] <= fix.t_capture_ns <= t_ns[-1]]
    x_m, y_m, yaw_rad = (np.interp([fix.t_capture_ns for fix in seen], t_ns, values) for values in true.T)
    place_m, true_m = np.array([complex(fix.x_m, fix.y_m) for fix in seen]), x_m + 1j * y_m
    turn = np.vdot(true_m - true_m.mean(), place_m - place_m.mean())
    turn /= abs(turn)
    rest_m = (place_m - place_m.mean()) / turn - (true_m - true_m.mean())
    turned = np.exp(1j * (np.array([fix.yaw_rad for fix in seen]) - yaw_rad))
    rest_rad = np.angle(turned / turned.mean())
    return np.column_stack((rest_m.real, rest_m.imag, rest_rad))


def row_of(missions: Sequence[Errors]) -> str:
    """Return number and standard deviations of the errors."""
    stacked = np.concatenate(missions)
    position_mm = 1e3 * math.sqrt(float(np.mean(stacked[:, 0] ** 2 + stacked[:, 1] ** 2)))
    yaw_deg = math.degrees(float(np.sqrt(np.mean(stacked[:, 2] ** 2))))
    return f"{len(stacked)} fixes, position {position_mm:.2f} mm, yaw {yaw_deg:.2f} deg"


def main() -> None:
    """Print a line for each way."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--missions", type=int, default=4)
    parser.add_argument("--first", type=int, default=9200, help="seed of the first mission")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.missions)
    jobs = [(seed, way) for way in WAYS for seed in seeds]
    with open_executor(arguments.cluster) as pool:
        outcomes = pool.map(mission, *zip(*jobs, strict=True))
        results = list(track(outcomes, "missions", total=len(jobs), console=Console(stderr=True)))
    for place, way in enumerate(WAYS):
        print(f"{way}: {row_of(results[place * len(seeds) :][: len(seeds)])}")


if __name__ == "__main__":
    main()
