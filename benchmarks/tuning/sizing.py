"""What a cluster of a given size can do: cost of a mission, cost of sending one, and what follows on paper.

    python -m benchmarks.tuning.sizing [--missions 3] [--calls 300]

Starts a scheduler and two workers on this machine. All costs are processor times, which a busy machine
changes less than elapsed times. Prints JSON. The limit of the scheduler is one over its processor time per
call; the command that proposes and collects has a limit of its own.
"""

import argparse
import json
import math
import os
import pickle
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from benchmarks.tuning.tasks import make_task
from drivers.clock import SystemClock, nanoseconds
from rover_hil.config import load_config
from rover_hil.drives.drive import read_drive
from rover_hil.parallel.cluster import ClusterExecutor
from rover_hil.recording.data_files import PackedConfig
from rover_hil.run.driving import run_virtual
from rover_hil.tune.simulated_mission import simulate_mission

HOST = "127.0.0.1"
START_LIMIT_S = 120.0
TICKS_PER_S = os.sysconf("SC_CLK_TCK")
ROVERS, HOURS_A_DAY, VERDICT_S = 100, 8, 32.2
"""A fleet; the verdict is that of the geared axis of `benchmarks.gap_machines.speed`."""
CORES = (1, 10, 100, 1000)
TRIALS, SCENARIOS, AT_ONCE = 1000, 200, 8
"""A study of ten parameters: a hundred trials for each."""


def processor_s(process_id: int) -> float:
    """Return the processor time of a process so far."""
    fields = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def mission_s(missions: int) -> float:
    """Return the processor time of one simulated mission of the shipped Robotino with its shipped gains."""
    config = make_task("gains")
    by_hand = load_config("robotino").model_copy(update={"tune": config.tune})
    simulate_mission(by_hand, 1)
    started = time.process_time()
    for seed in range(2, 2 + missions):
        simulate_mission(by_hand, seed)
    return (time.process_time() - started) / missions


def read_s_per_hour() -> float:
    """Return the processor time of reading the log of one hour of the shipped Robotino."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        result = run_virtual(load_config("robotino"), path, 120.0, None)
        started = time.process_time()
        read_drive(path)
        return (time.process_time() - started) * 3600.0 / result.duration_s


def give_back(_packed: PackedConfig, seed: int) -> int:
    """Return the seed: a call that costs only its way."""
    return seed


def call_costs(calls: int) -> dict[str, float]:
    """Return processor times in ms per call of the scheduler and of this process."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        address = f"tcp://{HOST}:{probe.getsockname()[1]}"
    dask = [sys.executable, "-m", "dask"]
    packed = PackedConfig.of(load_config("robotino"))
    with ExitStack() as stack:
        port = address.rpartition(":")[2]
        commands = [["scheduler", "--host", HOST, "--port", port, "--no-dashboard"]]
        commands += [["worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]] * 2
        processes = []
        for command in commands:
            process = stack.enter_context(
                subprocess.Popen([*dask, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            )
            stack.callback(process.kill)
            processes.append(process)
        executor = _connected(address)
        stack.callback(executor.shutdown)
        list(executor.map(give_back, [packed] * 20, range(20)))
        before = [processor_s(process.pid) for process in processes] + [time.process_time()]
        assert list(executor.map(give_back, [packed] * calls, range(calls))) == list(range(calls))
        after = [processor_s(process.pid) for process in processes] + [time.process_time()]
    spent_ms = [1000.0 * (end - start) / calls for start, end in zip(before, after, strict=True)]
    return {
        "scheduler_ms": spent_ms[0],
        "worker_ms": spent_ms[1] + spent_ms[2],
        "command_ms": spent_ms[3],
        "bytes": len(pickle.dumps(packed)),
    }


def _connected(address: str) -> ClusterExecutor:
    from distributed import Client

    clock = SystemClock()
    end_ns = clock.now_ns() + nanoseconds(START_LIMIT_S)
    while True:
        try:
            with Client(address, timeout=5.0, set_as_default=False) as client:
                client.wait_for_workers(2, timeout=START_LIMIT_S)
            return ClusterExecutor(address)
        except OSError:
            if clock.now_ns() > end_ns:
                raise


def study_hours(cores: int, mission_s: float, limit_per_s: float) -> float:
    """Return the duration of the study: batches one after the other, each in rounds, none above the limit."""
    batches = math.ceil(TRIALS / AT_ONCE)
    missions = AT_ONCE * SCENARIOS
    return batches * max(math.ceil(missions / cores) * mission_s, missions / limit_per_s) / 3600.0


def night_core_hours(read_s: float) -> float:
    """Return the processor time of a gap verdict for each rover of the fleet, all of its logs read."""
    return ROVERS * (HOURS_A_DAY * read_s + VERDICT_S) / 3600.0


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--missions", type=int, default=3)
    parser.add_argument("--calls", type=int, default=300)
    arguments = parser.parse_args()
    mission = mission_s(arguments.missions)
    costs = call_costs(arguments.calls)
    read_s = read_s_per_hour()
    limits = {name: 1000.0 / costs[f"{name}_ms"] for name in ("scheduler", "command")}
    limit = min(limits.values())
    figures = {
        "processor_s_of_a_mission": round(mission, 3),
        "missions_per_s_and_core": round(1.0 / mission, 2),
        "per_call": {name: round(value, 2) for name, value in costs.items()},
        "overhead_share": round((costs["worker_ms"] / 1000.0) / mission, 4),
        "calls_per_s_at_most": {name: round(value) for name, value in limits.items()},
        "workers_at_the_limit": round(limit * mission),
        "study": {
            "trials": TRIALS,
            "scenarios": SCENARIOS,
            "at_once": AT_ONCE,
            "hours_by_cores": {str(n): round(study_hours(n, mission, limit), 2) for n in CORES},
        },
        "read_log_s_per_hour": round(read_s, 1),
        "night_core_hours": round(night_core_hours(read_s), 1),
    }
    print(json.dumps(figures, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
