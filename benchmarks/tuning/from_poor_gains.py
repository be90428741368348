"""Whether tuning finds gains as good as hand-tuned ones from deliberately poor ones, and how fast.

    python -m benchmarks.tuning.from_poor_gains [--trials 400] [--minutes 8]

The shipped Robotino with gains and filter noise spoilt is tuned on all cores this process may use. Then
three sets of values are driven on the same held-out scenarios: the poor start, the shipped ones (hand-tuned),
and those found. Prints JSON; exit code 1 when the found ones cost more than the shipped ones or the start,
or it took longer than ten minutes.
"""

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

from drivers.clock import seconds, stopwatch_ns
from drivers.errors import ConfigError
from rover_hil.app.tune import tune
from rover_hil.config import Config, load_config, read_config_text
from rover_hil.tune.objective import evaluate
from rover_hil.tune.parallel_missions import open_missions
from rover_hil.tune.parameters import check_parameters, start_values, with_values
from rover_hil.tune.results import CONFIG_NAME, RESULT_NAME
from rover_hil.tune.scenarios import held_out_seeds
from rover_hil.tune.tuned_config import tuned_text

BAR_MINUTES = 10.0
POOR = {
    "mission.lookahead_m": 1.0,
    "mission.heading_gain_per_s": 0.1,
    "mission.approach_gain_per_s": 5.0,
    "filter.gyro_bias_rad_s": 1e-6,
}
TUNE = """
[tune.parameters]
"mission.lookahead_m" = { low = 0.03, high = 1.5, scale = "log", unit = "m" }
"mission.heading_gain_per_s" = { low = 0.05, high = 10, scale = "log", unit = "1/s" }
"mission.approach_gain_per_s" = { low = 0.3, high = 10, scale = "log", unit = "1/s" }
"filter.gyro_bias_rad_s" = { low = 1e-6, high = 0.1, scale = "log", unit = "rad/s" }

[tune.objective]
path_rms_m = 0.045
closure_m = 0.1
heading_deg = 3
effort_rad_s2 = 5
duration_s = 30
"""


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=400)
    parser.add_argument("--minutes", type=float, default=0.8 * BAR_MINUTES)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "poor.toml"
        path.write_text(tuned_text(f"{read_config_text('robotino').rstrip()}\n{TUNE}", POOR, None), "utf-8")
        started_ns = stopwatch_ns()
        tune(
            str(path),
            study="benchmark",
            trials=arguments.trials,
            minutes=arguments.minutes,
            out=Path(folder),
            as_json=False,
        )
        minutes = seconds(stopwatch_ns() - started_ns) / 60.0
        poor, found = load_config(str(path)), load_config(str(Path(folder) / CONFIG_NAME))
        result = json.loads((Path(folder) / RESULT_NAME).read_text("utf-8"))
    by_hand = with_values(poor, start_values(load_config("robotino"), check_parameters(poor)))
    costs = {
        name: held_out_cost(config)
        for name, config in (("poor start", poor), ("by hand", by_hand), ("found", found))
    }
    passed = costs["found"] <= min(costs.values()) and minutes <= BAR_MINUTES
    figures = {
        "cores": len(os.sched_getaffinity(0)),
        "minutes": round(minutes, 2),
        "trials": result["trials"],
        "refused": result["refused"],
        "given_up": result["given_up"],
        "held_out_sites": result["held_out_seeds"],
        "held_out_cost": {name: round(cost, 3) for name, cost in costs.items()},
        "values": {key: change["after"] for key, change in result["values"].items()},
        "bar": {"minutes": BAR_MINUTES, "found": "at most the others"},
        "passed": passed,
    }
    print(json.dumps(figures, indent=2))
    return 0 if passed else 1


def held_out_cost(config: Config) -> float:
    settings = check_parameters(config)
    with open_missions() as drive:
        evaluation = evaluate(drive, config, held_out_seeds(settings.cases), settings.objective)
    if evaluation.cost is None:
        raise ConfigError(f"refused: {evaluation.refused}")
    return evaluation.cost


if __name__ == "__main__":
    sys.exit(main())
