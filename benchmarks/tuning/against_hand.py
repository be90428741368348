"""Whether tuning finds better values than those tuned by hand, on scenarios that the search did not use.

    python -m benchmarks.tuning.against_hand [--tasks poor shipped four_wheels] [--seeds 0 1 2 3 4]
        [--trials 80] [--train 12] [--unseen 160] [--processes 2] [--cluster ADDRESS]
        [--studies FOLDER] [--out FILE]

`poor`: four values of the shipped Robotino are spoilt first. `shipped`: the search begins at the shipped
values. `four_wheels`: gains and filter noise of the shipped four-wheel rover without its camera, from the
shipped values. The number of trials is fixed, so that the values found do not depend on the load of the
machine: 80 are eight minutes of two free cores. As in `rover-hil tune`, the best trials are ranked in more
scenarios, and the first that is better than the start on the held-out ones is taken. It is then driven on
scenarios that have decided nothing. `better_by` is the gain over the values tuned by hand there, with the
standard deviation that another draw of scenarios gives it; `first_24` are the costs on the first 24 of them.
Scenarios in which either is rejected count for neither, and are listed.
Prints a line of JSON for each study; a study whose journal is in the folder goes on.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.cluster_option import add_cluster_option
from benchmarks.tuning.tasks import FOUR_WHEELS, OBJECTIVE, without_camera
from drivers.clock import seconds, stopwatch_ns
from rover_hil.config import Config, load_config
from rover_hil.config.tune_settings import MOST_CASES, CaseSettings, TunableSettings, TuneSettings
from rover_hil.parallel.executor import open_executor
from rover_hil.tune.comparison import compare
from rover_hil.tune.objective import MissionRunner, case_cost
from rover_hil.tune.parallel_missions import missions_on
from rover_hil.tune.parameters import check_parameters, with_values
from rover_hil.tune.scenarios import FIRST_HELD_OUT_SEED
from rover_hil.tune.simulated_mission import SimulatedMission
from rover_hil.tune.study import MissionStudy

FIRST_UNSEEN_SEED = FIRST_HELD_OUT_SEED + MOST_CASES
DRAWS = 1000
POOR = {
    "mission.lookahead_m": 1.0,
    "mission.heading_gain_per_s": 0.1,
    "mission.approach_gain_per_s": 5.0,
    "filter.gyro_bias_rad_s": 1e-6,
}
ROBOTINO = {
    "mission.lookahead_m": (0.03, 1.5, "m"),
    "mission.heading_gain_per_s": (0.05, 10.0, "1/s"),
    "mission.approach_gain_per_s": (0.3, 10.0, "1/s"),
    "filter.gyro_bias_rad_s": (1e-6, 0.1, "rad/s"),
}
"""Lowest and greatest value, and the unit."""


@dataclass(slots=True)
class CountedRuns:
    """Missions that are counted."""

    drive: MissionRunner
    count: int = 0
    started_ns: int = field(default_factory=stopwatch_ns)

    def __call__(self, config: Config, seeds: Sequence[int]) -> Generator[SimulatedMission, None, None]:
        """Start missions."""
        return self._counted(self.drive(config, seeds))

    def _counted(
        self, missions: Generator[SimulatedMission, None, None]
    ) -> Generator[SimulatedMission, None, None]:
        try:
            for mission in missions:
                self.count += 1
                yield mission
        finally:
            missions.close()

    @property
    def elapsed_s(self) -> float:
        """Time since this was made."""
        return seconds(stopwatch_ns() - self.started_ns)


def make_start(task: str, seed: int, train: int) -> tuple[Config, Config]:
    """Return the configuration of the start of a task, and the one tuned by hand."""
    by_hand = without_camera(load_config("el-dorado")) if task == "four_wheels" else load_config("robotino")
    ranges = (
        {key: (low, high, unit) for key, (low, _, high, unit) in FOUR_WHEELS.items()}
        if task == "four_wheels"
        else ROBOTINO
    )
    shipped = by_hand.tune
    assert shipped is not None
    tune = TuneSettings(
        parameters={
            key: TunableSettings(low=low, high=high, scale="log", unit=unit)
            for key, (low, high, unit) in ranges.items()
        },
        objective=shipped.objective if task == "four_wheels" else OBJECTIVE,
        cases=CaseSettings(train=train, held_out=24),
        seed=seed,
    )
    by_hand = by_hand.model_copy(update={"tune": tune})
    return (with_values(by_hand, POOR) if task == "poor" else by_hand), by_hand


def drive_unseen(config: Config, drive: MissionRunner, count: int) -> list[float | None]:
    """Return the costs on so many scenarios that decided nothing; None where the mission was rejected."""
    assert config.tune is not None
    objective = config.tune.objective
    missions = drive(config, range(FIRST_UNSEEN_SEED, FIRST_UNSEEN_SEED + count))
    return [None if mission.refused else case_cost(mission, objective) for mission in missions]


def compare_unseen(
    by_search: Sequence[float | None], by_hand: Sequence[float | None], quantile: float, seed: int
) -> dict[str, object]:
    """Return the quantiles of both over their common scenarios, and how much less those found cost."""
    pairs = zip(by_hand, by_search, strict=True)
    costs = np.array([pair for pair in pairs if None not in pair], dtype=float).T
    rng = np.random.default_rng(seed)
    draws = rng.integers(costs.shape[1], size=(DRAWS, costs.shape[1]))
    hand, tuned = np.quantile(costs, quantile, axis=1)
    drawn_hand, drawn_tuned = np.quantile(costs[:, draws], quantile, axis=2)
    return {
        "scenarios": costs.shape[1],
        "cost": {"by hand": round(float(hand), 3), "found": round(float(tuned), 3)},
        "mean": dict(zip(("by hand", "found"), np.round(costs.mean(axis=1), 3).tolist(), strict=True)),
        "better_by": round(float(1.0 - tuned / hand), 4),
        "better_by_sd": round(float(np.std(1.0 - drawn_tuned / drawn_hand)), 4),
        "rejected": {"by hand": by_hand.count(None), "found": by_search.count(None)},
    }


def run(
    task: str, seed: int, train: int, trials: int, unseen: int, folder: Path, drive: MissionRunner
) -> dict[str, object]:
    """Return what one study found."""
    start, by_hand = make_start(task, seed, train)
    settings = check_parameters(start)
    counted = CountedRuns(drive)
    study = MissionStudy(folder / f"{task}-{seed}.jsonl", "benchmark", start, settings)
    study.search(counted, trials, lambda: False, lambda: None)
    search_s, missions = counted.elapsed_s, counted.count
    attempts, best = study.attempts(), study.candidates()
    comparison = compare(start, settings, best, drive)
    tuned = with_values(start, comparison.values)
    found_costs, hand_costs = (drive_unseen(each, drive, unseen) for each in (tuned, by_hand))
    quantile = settings.objective.quantile
    return {
        "task": task,
        "seed": seed,
        "trials": len(attempts),
        "refused": sum(1 for attempt in attempts if attempt.refused),
        "given_up": sum(1 for attempt in attempts if attempt.cost is None and not attempt.refused),
        "missions": missions,
        "minutes": round(search_s / 60.0, 2),
        "start_train_cost": attempts[0].cost,
        "train_cost": best[0].cost if best else None,
        "verdict": comparison.verdict,
        "declined": len(comparison.declined),
        "unseen": compare_unseen(found_costs, hand_costs, quantile, seed),
        "first_24": compare_unseen(found_costs[:24], hand_costs[:24], quantile, seed),
        "values": comparison.values,
    }


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    tasks = ("poor", "shipped", "four_wheels")
    parser.add_argument("--tasks", nargs="+", default=tasks, choices=tasks)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2, 3, 4])
    parser.add_argument("--train", type=int, default=12)
    parser.add_argument("--trials", type=int, default=80)
    parser.add_argument("--unseen", type=int, default=160)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--studies", type=Path)
    parser.add_argument("--out", type=Path)
    add_cluster_option(parser)
    arguments = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as temporary,
        open_executor(arguments.cluster, arguments.processes) as executor,
    ):
        folder = arguments.studies or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for task in arguments.tasks:
            for seed in arguments.seeds:
                drive = missions_on(executor)
                sizes = arguments.train, arguments.trials, arguments.unseen
                result = run(task, seed, *sizes, folder, drive)
                line = json.dumps(result)
                print(line, flush=True)
                if arguments.out is not None:
                    with arguments.out.open("a") as file:
                        file.write(f"{line}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
