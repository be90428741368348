"""Whether tuning finds better values than those tuned by hand, on scenarios that the search did not use.

    python -m benchmarks.tuning.against_hand [--tasks poor shipped four_wheels] [--seeds 0 1 2 3 4]
        [--trials 80] [--processes 2] [--cluster ADDRESS] [--studies FOLDER] [--out FILE]

`poor`: four values of the shipped Robotino are spoilt first. `shipped`: the search begins at the shipped
values. `four_wheels`: gains and filter noise of the shipped four-wheel rover without its camera, from the
shipped values. The number of trials is fixed, so that the values found do not depend on the load of the
machine: 80 are eight minutes of two free cores. As in `rover-hil tune`, the best values that are better than
the start on the held-out scenarios are taken. They are then driven on 24 scenarios that have decided nothing.
Prints a line of JSON for each study; a study whose journal is in the folder goes on.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.cluster_option import add_cluster_option
from benchmarks.tuning.tasks import OBJECTIVE
from drivers.clock import seconds, stopwatch_ns
from rover_hil.config import Config, load_config
from rover_hil.config.tune_settings import MOST_CASES, CaseSettings, TunableSettings, TuneSettings
from rover_hil.parallel.executor import open_executor
from rover_hil.tune.comparison import compare
from rover_hil.tune.objective import MissionRunner, evaluate
from rover_hil.tune.parallel_missions import missions_on
from rover_hil.tune.parameters import check_parameters, with_values
from rover_hil.tune.scenarios import FIRST_HELD_OUT_SEED
from rover_hil.tune.simulated_mission import SimulatedMission
from rover_hil.tune.study import MissionStudy

UNSEEN = range(FIRST_HELD_OUT_SEED + MOST_CASES, FIRST_HELD_OUT_SEED + MOST_CASES + 24)
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
FOUR_WHEELS = {
    "mission.lookahead_m": (0.05, 2.0, "m"),
    "mission.heading_gain_per_s": (0.1, 5.0, "1/s"),
    "mission.yaw_rate_limit_rad_s": (0.03, 0.3, "rad/s"),
    "filter.heading_noise_rad": (0.005, 0.5, "rad"),
    "filter.gyro_noise_rad_sqrt_s": (1e-4, 0.05, "rad/sqrt(s)"),
    "filter.gyro_bias_rad_s": (1e-4, 0.1, "rad/s"),
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
    by_hand = _without_camera(load_config("el-dorado")) if task == "four_wheels" else load_config("robotino")
    ranges = FOUR_WHEELS if task == "four_wheels" else ROBOTINO
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


def _without_camera(config: Config) -> Config:
    devices = {name: settings for name, settings in config.devices.items() if name != config.roles.camera}
    scomp = config.scomp
    assert scomp is not None
    return config.model_copy(
        update={
            "devices": devices,
            "roles": config.roles.model_copy(update={"camera": None}),
            "scomp": scomp.model_copy(update={"rig": None}),
        }
    )


def run(
    task: str, seed: int, train: int, trials: int, folder: Path, drive: MissionRunner
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
    found = with_values(start, comparison.values)
    costs = {
        name: evaluate(drive, config, UNSEEN, settings.objective).cost
        for name, config in (("start", start), ("by hand", by_hand), ("found", found))
    }
    hand, tuned = costs["by hand"], costs["found"]
    return {
        "task": task,
        "seed": seed,
        "trials": len(attempts),
        "refused": sum(1 for attempt in attempts if attempt.refused),
        "given_up": sum(1 for attempt in attempts if attempt.cost is None and not attempt.refused),
        "missions": missions,
        "minutes": round(search_s / 60.0, 2),
        "train_cost": best[0].cost if best else None,
        "verdict": comparison.verdict,
        "declined": len(comparison.declined),
        "unseen_cost": {name: None if cost is None else round(cost, 3) for name, cost in costs.items()},
        "better_by": None if hand is None or tuned is None else round(1.0 - tuned / hand, 4),
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
                found = run(task, seed, arguments.train, arguments.trials, folder, missions_on(executor))
                line = json.dumps(found)
                print(line, flush=True)
                if arguments.out is not None:
                    with arguments.out.open("a") as file:
                        file.write(f"{line}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
