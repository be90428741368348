"""Whether `rover-hil tune logs` finds noise set on purpose, and is better on logs that it did not use.

    python -m benchmarks.tuning.from_logs [--trials 64] [--seeds 0 1] [--logs 6] [--processes 2]

Logs of the rover of the sample `noise` are simulated with seeds that nothing else uses. Each search begins at
the guessed noise, about five times too large. Prints a line of JSON for each: found over true noise, and the
cost and measured values on the held-out logs before and after.
"""

import argparse
import json
import math
import sys
import tempfile
from importlib import resources
from pathlib import Path

from rover_hil.config import Config, load_config
from rover_hil.parallel.executor import open_executor
from rover_hil.run.driving import run_virtual
from rover_hil.tune.comparison import compare_by
from rover_hil.tune.logs.judged_log import JudgedLog, read_judged_logs, split
from rover_hil.tune.logs.objective import evaluate_logs
from rover_hil.tune.logs.study import LogStudy, replays_on
from rover_hil.tune.parameters import check_log_parameters, start_values

FIRST_SEED = 71_000
DRIVE_S = 30.0
GYRO_HZ = 50.0
GYRO_RAD_S = math.radians(1.5)
TRUE = {
    "filter.heading_noise_rad": math.radians(4.0),
    "filter.gyro_noise_rad_sqrt_s": GYRO_RAD_S / math.sqrt(GYRO_HZ),
    "filter.gyro_rate_noise_rad_s": GYRO_RAD_S,
}
"""As the sample's [simulation] has it; white noise of a rate integrates to that over the root of its rate."""


def record(folder: Path, config: Config, count: int) -> list[JudgedLog]:
    """Return logs of new drives."""
    simulation = config.require_simulation()
    paths = [folder / f"{number}.mcap" for number in range(count)]
    for number, path in enumerate(paths):
        here = simulation.model_copy(update={"seed": FIRST_SEED + number})
        run_virtual(config.model_copy(update={"simulation": here}), path, DRIVE_S, None)
    return read_judged_logs(paths, config, 5.0)


def main() -> int:
    """Print the results; returns 0."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=64)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1])
    parser.add_argument("--logs", type=int, default=6)
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as temporary,
        open_executor(processes=arguments.processes) as executor,
    ):
        folder = Path(temporary)
        path = folder / "noisy.toml"
        path.write_text(
            resources.files("rover_hil.sample").joinpath("noisy.toml").read_text("utf-8"), "utf-8"
        )
        config = load_config(str(path))
        train, held_out = split(record(folder, config, arguments.logs))
        for seed in arguments.seeds:
            tune = check_log_parameters(config).model_copy(update={"seed": seed})
            by_logs = tune.logs
            assert by_logs is not None
            objective = by_logs.objective
            study = LogStudy(folder / f"{seed}.jsonl", "benchmark", config, tune, objective, train)
            study.search(replays_on(executor, train), arguments.trials, lambda: False, lambda: None)
            drive = replays_on(executor, held_out)
            compared = compare_by(
                lambda values, _: evaluate_logs(drive(values, range(len(held_out))), objective),  # noqa: B023 - called at once
                config,
                start_values(config, tune),
                study.candidates()[:1],
            )
            line = {
                "seed": seed,
                "trials": len(study.attempts()),
                "verdict": compared.verdict,
                "start_over_true": {
                    key: start_values(config, tune)[key] / true for key, true in TRUE.items()
                },
                "found_over_true": {key: round(compared.values[key] / true, 3) for key, true in TRUE.items()},
                "values": compared.values,
                "held_out_cost": [compared.start.cost, compared.tuned.cost],
                "held_out_terms": [compared.start.terms, compared.tuned.terms],
            }
            print(json.dumps(line), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
