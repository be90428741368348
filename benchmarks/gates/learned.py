"""Paths before and after learning the reading of the yaw excitation on the same floor.

    python -m benchmarks.gates.learned --nature bristle --first 700 --floors 4

Each floor is driven three times with the excitation, a calibrated gyro and fixes every two seconds. What
these labelled is learned as by `rover-hil commission`. Then the fixes are taken away: the same mission, with
the same noise, with the formula's reading and with the learned one. Prints each floor, and per nature the
medians of both paths and their ratio. Exit code 1 where a mission did not finish, or a floor gave too few
labels.
"""

import argparse
import sys
from dataclasses import dataclass
from statistics import median

from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.gates.floors import (
    FIRST_FULL_FLOOR,
    FIXES_PER_S,
    NATURE_NAMES,
    VERSIONS,
    configure_version,
    drive_config,
)
from benchmarks.safety.missions import Driven, with_fixes
from controllers.slip.effort.labelled_windows import LabelledReading
from rover_hil.parallel.executor import open_executor
from rover_hil.ready.commission.learning import LEAST_LABELS, learn_bracket

DRIVES = 3
SEEDS = 10
"""Noise of the drives that teach is that of floor times this, and on."""
CALIBRATED = VERSIONS[2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Learned:
    """What came of a floor: paths in mm, None where there were too few labels; and whether all finished."""

    labels: int
    shares: tuple[float, float] = (1.0, 0.5)
    before_mm: float | None = None
    after_mm: float | None = None
    has_finished: bool = True


def learn_floor(nature: str, seed: int) -> Learned:
    """Learn on a floor, and drive it with and without what was learned."""
    labels: list[LabelledReading] = []
    for number in range(DRIVES):
        config = with_fixes(configure_version(CALIBRATED, SEEDS * seed + number), FIXES_PER_S)
        labels += _labels(drive_config(config, nature, seed)[1])
    if len(labels) < LEAST_LABELS:
        return Learned(labels=len(labels))
    learned = learn_bracket(labels, nature, "2026-11-27")
    config = configure_version(CALIBRATED, seed)
    assert config.slip is not None
    slip = config.slip.model_copy(update={"learned_bracket": learned})
    before, after = (
        drive_config(each, nature, seed)[0] for each in (config, config.model_copy(update={"slip": slip}))
    )
    return Learned(
        labels=len(labels),
        shares=(learned.weights[0], learned.weights[1]),
        before_mm=1e3 * before.path_m,
        after_mm=1e3 * after.path_m,
        has_finished=before.has_finished and after.has_finished,
    )


def _labels(driven: Driven) -> list[LabelledReading]:
    reports = [moment.output.slip for moment in driven.moments]
    return [report.label for report in reports if report is not None and report.label is not None]


def main() -> int:
    """Print the floors and the medians; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--nature", choices=NATURE_NAMES, action="append", help="default: all")
    parser.add_argument("--first", type=int, default=FIRST_FULL_FLOOR)
    parser.add_argument("--floors", type=int, default=4)
    parser.add_argument("--processes", type=int, help="default: one for each processor")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    natures = arguments.nature or list(NATURE_NAMES)
    seeds = range(arguments.first, arguments.first + arguments.floors)
    jobs = [(nature, seed) for nature in natures for seed in seeds]
    console, by_law = Console(), dict[str, list[Learned]]()
    with open_executor(arguments.cluster, arguments.processes) as pool:
        results = pool.map(learn_floor, *zip(*jobs, strict=True))
        for (nature, seed), floor in track(
            zip(jobs, results, strict=True), total=len(jobs), console=Console(stderr=True)
        ):
            by_law.setdefault(nature, []).append(floor)
            paths = "too few"
            if floor.before_mm is not None and floor.after_mm is not None:
                paths = (
                    f"shares {floor.shares[0]:.2f} and {floor.shares[1]:.2f}, "
                    f"path {floor.before_mm:.1f} to {floor.after_mm:.1f} mm"
                )
            console.print(f"{nature} {seed}: {floor.labels} labels, {paths}", soft_wrap=True)
    for nature, floors in by_law.items():
        before = [floor.before_mm for floor in floors if floor.before_mm is not None]
        after = [floor.after_mm for floor in floors if floor.after_mm is not None]
        if before:
            console.print(
                f"{nature}: median path {median(before):.1f} to {median(after):.1f} mm on {len(before)} "
                f"floors, ratio {median(after) / median(before):.2f}",
                soft_wrap=True,
            )
    is_good = all(
        floor.has_finished and floor.before_mm is not None for each in by_law.values() for floor in each
    )
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
