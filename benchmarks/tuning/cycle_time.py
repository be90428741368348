"""Processor time of one cycle of a simulated Robotino mission in a study, beside filterpy's filter.

    python -m benchmarks.tuning.cycle_time [--runs 5]

Prints JSON: the least of the runs, and that of one bare predict and update measured after each of them. The
filter alone stays in the cache of the processor: between the cycles of a loop, as in
`benchmarks.program.step_time`, it takes about twice as long.
"""

import argparse
import json
import sys
import time

from benchmarks.program.step_time import make_peer
from rover_hil.config import load_config
from rover_hil.tune.scenarios import with_scenario
from rover_hil.tune.simulated_mission import drive

PEER_CYCLES = 2000


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    config, peer = with_scenario(load_config("robotino"), 1), make_peer()
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
    print(json.dumps({**figures, "ratio": round(min(cycle_us) / min(peer_us), 1), "bar": 5}, indent=2))
    return 0 if min(cycle_us) <= 5.0 * min(peer_us) else 1


if __name__ == "__main__":
    sys.exit(main())
