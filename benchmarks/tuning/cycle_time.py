"""Processor time of one cycle of a simulated mission in a study, beside filterpy's filter.

    python -m benchmarks.tuning.cycle_time [--runs 5] [--four-wheels]

The Robotino, or the El-Dorado without its camera. Prints JSON: the least of the runs, and that of one bare
predict and update measured after each of them. The filter alone stays in the cache of the processor: between
the cycles of a loop, as in `benchmarks.program.step_time`, it takes about twice as long. Exit code 1 where
the Robotino takes more than five times as long as the filter.
"""

import argparse
import json
import sys
import time

from benchmarks.program.step_time import make_peer
from benchmarks.tuning.tasks import without_camera
from rover_hil.config import load_config
from rover_hil.tune.scenarios import with_scenario
from rover_hil.tune.simulated_mission import drive

PEER_CYCLES = 2000
BAR = 5


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--four-wheels", action="store_true")
    arguments = parser.parse_args()
    runs, is_four_wheels = arguments.runs, arguments.four_wheels
    config = without_camera(load_config("el-dorado")) if is_four_wheels else load_config("robotino")
    config, peer = with_scenario(config, 1), make_peer()
    drive(config)
    cycle_us: list[float] = []
    peer_us: list[float] = []
    for _ in range(runs):
        started = time.thread_time()
        cycles = len(drive(config).truth.t_s)
        middle = time.thread_time()
        for _ in range(PEER_CYCLES):
            peer()
        cycle_us.append(1e6 * (middle - started) / cycles)
        peer_us.append(1e6 * (time.thread_time() - middle) / PEER_CYCLES)
    figures = {"cycle_us": round(min(cycle_us), 1), "filterpy_us": round(min(peer_us), 1)}
    ratio = min(cycle_us) / min(peer_us)
    times_real_time = 1e6 / config.loop.rate_hz / min(cycle_us)
    figures |= {"ratio": round(ratio, 1), "times_real_time": round(times_real_time)}
    print(json.dumps(figures if is_four_wheels else {**figures, "bar": BAR}, indent=2))
    return 0 if is_four_wheels or ratio <= BAR else 1


if __name__ == "__main__":
    sys.exit(main())
