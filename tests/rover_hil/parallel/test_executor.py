"""The pool of processes: results in order, and nobody left behind."""

import os
import signal
import subprocess
import sys
from contextlib import closing
from multiprocessing.context import SpawnProcess
from pathlib import Path

import pytest

from drivers.clock import SystemClock, nanoseconds
from rover_hil.tune.parallel_missions import open_missions
from rover_hil.tune.simulated_mission import simulate_mission
from tests.rover_hil.tune.tuning import make_config

pytestmark = pytest.mark.slow

POLL_S = 0.05
LIMIT_S = 60.0
PARENT = """
import os, sys
from rover_hil.parallel.executor import open_executor
with open_executor() as executor:
    print(executor.submit(os.getpid).result(), flush=True)
    sys.stdin.read()
"""


def is_alive(process_id: int) -> bool:
    try:
        status = Path(f"/proc/{process_id}/stat").read_text()
    except FileNotFoundError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"


def test_results_come_in_order_and_are_those_of_one_process(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    with open_missions() as drive, closing(drive(config, range(1, 4))) as results:
        first, second = next(results), next(results)
    assert (first.seed, second.seed) == (1, 2)
    assert [first.terms, second.terms] == [simulate_mission(config, seed).terms for seed in (1, 2)]


def test_ctrl_c_while_workers_start_leaves_them_at_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A terminal sends ctrl-C to every process, also to those that have not run a line of Python yet."""
    start = SpawnProcess.start

    def start_and_interrupt(process: SpawnProcess) -> None:
        start(process)
        assert process.pid is not None
        os.kill(process.pid, signal.SIGINT)

    monkeypatch.setattr(SpawnProcess, "start", start_and_interrupt)
    with open_missions() as drive, closing(drive(make_config(tmp_path), [1])) as results:
        assert next(results).seed == 1


def test_workers_end_with_a_killed_parent() -> None:
    clock = SystemClock()
    with subprocess.Popen(
        [sys.executable, "-c", PARENT],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        assert is_alive(worker)
        parent.kill()
    end_ns = clock.now_ns() + nanoseconds(LIMIT_S)
    while is_alive(worker) and clock.now_ns() < end_ns:
        clock.sleep_until(clock.now_ns() + nanoseconds(POLL_S))
    assert not is_alive(worker)
