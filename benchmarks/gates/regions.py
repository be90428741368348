"""Does the 95 % region of the pose contain the rover? At four distances and at the end of missions.

    python -m benchmarks.gates.regions --nature bristle --first 800 --floors 200

Each floor of `tests/nature` is driven with encoders and gyro alone, with the excitation as shipped, and with
the excitation and a calibrated gyro, once each. The error of x, y and yaw against the truth at the time of
the estimate, squared in units of the reported covariance, is compared with the chi-square distribution of
three numbers. Prints for each nature and version the share inside of each place and of all, the median over
its expected value, the median area of the region of the position, and how the missions ended. Exit code 1
where a share is below 90 %, or where the median with a calibrated gyro is outside of 0.5 to 1.5.
"""

import argparse
import math
import sys
from collections import Counter
from itertools import groupby
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.gates.floors import NATURE_NAMES, VERSIONS, configure_version, drive_config
from benchmarks.safety.missions import Driven
from controllers.safety import Mode
from rover_hil.parallel.executor import open_executor

FIRST = 800
"""Nothing was tuned on these floors."""
DISTANCES_M = (0.5, 1.0, 1.5, 2.0)
INSIDE, MEDIAN = 7.815, 2.366
"""95 % and median of a chi-square distribution of three numbers."""
POSITION_INSIDE = 5.991
LEAST_SHARE = 0.9
MEDIAN_BAR = (0.5, 1.5)
CALIBRATED = VERSIONS[2]


class Pose(NamedTuple):
    """Squared error in units of the covariance, and area of the region of the position."""

    nees: float
    area_m2: float


class Mission(NamedTuple):
    """Poses at the distances that were reached, then at the end; the last mode; whether it was stopped."""

    poses: tuple[Pose, ...]
    mode: str
    has_stopped: bool


def mission(nature: str, version: str, seed: int) -> Mission:
    """Drive one mission."""
    driven = drive_config(configure_version(version, seed), nature, seed)[1]
    modes = [moment.output.mode for moment in driven.moments]
    return Mission(_poses(driven), driven.mode.value, Mode.SAFE_STOP in modes)


def _poses(driven: Driven) -> tuple[Pose, ...]:
    times_s = np.array([moment.t_s for moment in driven.moments])
    truths = np.array([moment.truth for moment in driven.moments])
    truths[:, 2] = np.unwrap(truths[:, 2])
    path_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(truths[:, :2], axis=0).T))))
    places = [int(np.searchsorted(path_m, at_m)) for at_m in DISTANCES_M if at_m <= path_m[-1]]
    poses = []
    for place in [*places, len(times_s) - 1]:
        moment = driven.moments[place]
        estimate, at_s = moment.output.estimate, moment.t_s - moment.age_s
        truth = [np.interp(at_s, times_s, column) for column in truths.T]
        xx, xy, xt, yy, yt, tt = estimate.covariance
        covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) + 1e-12 * np.eye(3)
        yaw_rad = math.remainder(estimate.yaw_rad - truth[2], math.tau)
        error = np.array([estimate.x_m - truth[0], estimate.y_m - truth[1], yaw_rad])
        nees = float(error @ np.linalg.solve(covariance, error))
        poses.append(Pose(nees, POSITION_INSIDE * math.pi * math.sqrt(max(0.0, xx * yy - xy**2))))
    return tuple(poses)


def main() -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--nature", choices=NATURE_NAMES, action="append", help="default: all")
    parser.add_argument("--version", choices=VERSIONS[:3], action="append", help="default: all")
    parser.add_argument("--first", type=int, default=FIRST)
    parser.add_argument("--floors", type=int, default=200)
    parser.add_argument("--processes", type=int, help="default: one for each processor")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.floors)
    jobs = [
        (nature, version, seed)
        for nature in arguments.nature or NATURE_NAMES
        for version in arguments.version or VERSIONS[:3]
        for seed in seeds
    ]
    with open_executor(arguments.cluster, arguments.processes) as pool:
        results = pool.map(mission, *zip(*jobs, strict=True))
        driven = list(track(zip(jobs, results, strict=True), total=len(jobs), console=Console(stderr=True)))
    places = [f"{at_m:g} m" for at_m in DISTANCES_M]
    print(f"| nature, version | runs | {' | '.join(places)} | end | all | median | area cm^2 | ended |")
    print(f"|---|---|{'---|' * len(places)}---|---|---|---|---|")
    is_good = True
    for (nature, version), cell in groupby(driven, key=lambda each: each[0][:2]):
        missions = [each[1] for each in cell]
        every = [pose for each in missions for pose in each.poses]
        by_place = [
            [each.poses[index] for each in missions if len(each.poses) > index + 1]
            for index in range(len(places))
        ]
        by_place.append([each.poses[-1] for each in missions])
        shares = [_inside(poses) for poses in (*by_place, every)]
        median = float(np.median([pose.nees for pose in every])) / MEDIAN
        area_cm2 = 1e4 * float(np.median([pose.area_m2 for pose in every]))
        ends = Counter(each.mode for each in missions)
        ended = ", ".join(f"{count} {mode}" for mode, count in ends.items())
        stopped = sum(each.has_stopped for each in missions)
        cells = [f"{nature}, {version}", f"{len(missions)}", *(f"{100 * share:.1f} %" for share in shares)]
        cells += [f"{median:.2f}", f"{area_cm2:.0f}", f"{ended}; {stopped} stopped and went on"]
        print(f"| {' | '.join(cells)} |", flush=True)
        is_good &= not min(shares) < LEAST_SHARE
        is_good &= version != CALIBRATED or MEDIAN_BAR[0] <= median <= MEDIAN_BAR[1]
    return 0 if is_good else 1


def _inside(poses: list[Pose]) -> float:
    """Return the share inside; NaN where no mission came there."""
    return float(np.mean([pose.nees <= INSIDE for pose in poses])) if poses else math.nan


if __name__ == "__main__":
    sys.exit(main())
