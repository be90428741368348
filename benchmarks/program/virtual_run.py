"""How much faster than real time a virtual run is: the Robotino rectangle at 50 Hz, log included.

    python -m benchmarks.program.virtual_run [--runs 5]

Beside it, in the same process: the `step` alone on the very samples of that run, from the log. The processor
time of all threads and of the loop alone is the least of the runs, beside that of filterpy's bare filter.
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.program.step_time import make_peer
from drivers.clock import seconds, stopwatch_ns
from rover_hil.config import load_config
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.driving import run_virtual
from rover_hil.run.replay import replay

PEER_CYCLES = 2000


def main() -> int:
    """Print the figures as JSON; exit code 1 below 50 times real time."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    config = load_config("robotino")
    factors: list[float] = []
    replay_factors: list[float] = []
    simulated_s = 0.0
    log_bytes = 0
    all_us: list[float] = []
    loop_us: list[float] = []
    peer_us: list[float] = []
    peer = make_peer()
    with tempfile.TemporaryDirectory() as folder:
        for index in range(runs):
            path = Path(folder) / f"{index}.mcap"
            started_ns = stopwatch_ns()
            all_s, loop_s = time.process_time(), time.thread_time()
            result = run_virtual(config, path, config.loop.time_limit_s, None)
            all_us.append(1e6 * (time.process_time() - all_s) / result.cycles)
            loop_us.append(1e6 * (time.thread_time() - loop_s) / result.cycles)
            factors.append(result.duration_s / seconds(stopwatch_ns() - started_ns))
            peer_s = time.thread_time()
            for _ in range(PEER_CYCLES):
                peer()
            peer_us.append(1e6 * (time.thread_time() - peer_s) / PEER_CYCLES)
            simulated_s = result.duration_s
            log_bytes = path.stat().st_size
            log = LogReader(path)
            started_ns = stopwatch_ns()
            with restore_config(log) as logged_config:
                replay(log, logged_config, lambda: None)
            replay_factors.append(result.duration_s / seconds(stopwatch_ns() - started_ns))
    median = statistics.median(factors)
    figures = {
        "rate_hz": config.loop.rate_hz,
        "simulated_s": round(simulated_s, 2),
        "times_real_time": {"median": round(median, 1), "min": round(min(factors), 1)},
        "log_gb_per_hour": round(log_bytes / simulated_s * 3600 / 1e9, 2),
        "us_per_cycle": round(1e6 / (median * config.loop.rate_hz)),
        "processor_us_per_cycle": {"all_threads": round(min(all_us)), "loop": round(min(loop_us))},
        "filterpy_us": round(min(peer_us), 1),
        "ratio": round(min(all_us) / min(peer_us), 1),
        "peer_replay_times_real_time": round(statistics.median(replay_factors), 1),
        "bar_times_real_time": 50,
    }
    print(json.dumps(figures, indent=2))
    return 0 if median >= 50 else 1


if __name__ == "__main__":
    sys.exit(main())
