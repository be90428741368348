"""Which search finds good values with the fewest simulated missions.

    python -m benchmarks.tuning.searches [--missions 300] [--tasks TASK ...] [--searches SEARCH ...]
        [--processes 2] [--out FILE]

Each search begins at deliberately poor values and may use the same number of missions. Prints JSON: for each
task the cost of the values tuned by hand on scenarios that were not searched; for each search the best cost
on the training scenarios after every batch, the number of missions until then, and the cost of the final
values on those other scenarios. Equal missions rather than equal time:
the time of a search itself is given beside it.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import chain
from pathlib import Path

from benchmarks.tuning import proposers
from benchmarks.tuning.tasks import TASKS, held_out_cost, make_task, tuned_by_hand
from drivers.clock import seconds, stopwatch_ns
from rover_hil.config import Config
from rover_hil.tune.parameters import check_parameters, with_values
from rover_hil.tune.search import Proposer, propose
from rover_hil.tune.simulated_mission import SimulatedMission, simulate_mission
from rover_hil.tune.study import MissionStudy

SEARCHES: dict[str, tuple[Proposer, bool]] = {
    "TPE": (propose, False),
    "TPE, raced": (propose, True),
    "CMA-ES": (proposers.cma_es, False),
    "CMA-ES, raced": (proposers.cma_es, True),
    "Gaussian process": (proposers.gaussian_process, False),
    "Gaussian process, raced": (proposers.gaussian_process, True),
    "Gaussian process, raced, warm start": (proposers.warm_started, True),
}


def run(missions: int, job: tuple[str, str]) -> dict[str, object]:
    """Return the curve of one search on one task."""
    task, search = job
    config = make_task(task)
    settings = check_parameters(config)
    finder, is_raced = SEARCHES[search]
    driven = 0
    curve: list[tuple[int, float | None]] = []

    def drive(config: Config, seeds: Sequence[int]) -> Generator[SimulatedMission, None, None]:
        nonlocal driven
        for seed in seeds:
            driven += 1
            yield simulate_mission(config, seed)

    with tempfile.TemporaryDirectory() as folder:
        study = MissionStudy(Path(folder) / "study", "search", config, settings, finder, is_raced=is_raced)
        started_ns = stopwatch_ns()
        target = 1
        while driven < missions:
            study.search(drive, target, lambda: False, lambda: None)
            target += settings.at_once
            best = study.candidates()
            curve.append((driven, None if not best else best[0].cost))
        elapsed_s = seconds(stopwatch_ns() - started_ns)
        best = study.candidates()
        trials = len(study.attempts())
        refused = sum(1 for attempt in study.attempts() if attempt.refused)
    values = best[0].values if best else {}
    return {
        "task": task,
        "search": search,
        "trials": trials,
        "refused": refused,
        "missions": driven,
        "elapsed_s": round(elapsed_s, 1),
        "curve": curve,
        "held_out_cost": held_out_cost(with_values(config, values)) if values else None,
        "values": values,
    }


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--missions", type=int, default=300)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--tasks", nargs="+", default=list(TASKS), choices=list(TASKS))
    parser.add_argument("--searches", nargs="+", default=list(SEARCHES), choices=list(SEARCHES))
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    jobs = [(task, search) for task in arguments.tasks for search in arguments.searches]
    with ProcessPoolExecutor(arguments.processes) as pool:
        by_hand = ({"task": task, "by hand": held_out_cost(tuned_by_hand(task))} for task in arguments.tasks)
        for result in chain(by_hand, pool.map(partial(run, arguments.missions), jobs)):
            line = json.dumps(result)
            print(line, flush=True)
            if arguments.out is not None:
                with arguments.out.open("a") as file:
                    file.write(f"{line}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
