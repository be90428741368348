"""The pool of processes: results in order, and nobody left behind."""

import os
import signal
import subprocess
import sys
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from multiprocessing.context import SpawnProcess
from pathlib import Path

import pytest

from drivers.clock import SystemClock, nanoseconds
from rover_hil.parallel import executor as executor_module
from rover_hil.parallel.executor import WorkerLostError, open_executor
from rover_hil.recording.data_files import PackedConfig
from rover_hil.tune.parallel_missions import open_missions
from rover_hil.tune.simulated_mission import SimulatedMission, simulate_mission
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.tune.tuning import answer, make_config, write_config

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


def test_a_worker_that_was_killed_is_one_sentence() -> None:
    with (
        pytest.raises(
            WorkerLostError, match="ended by a signal, or for want of memory: give the same command"
        ),
        open_executor(processes=1) as executor,
    ):
        executor.submit(signal.raise_signal, signal.SIGKILL).result()


class FailingExecutor(Executor):
    """Answers missions at once; as in a pool whose process was killed, everything fails after some."""

    left = 0

    def __init__(self, processes: int | None = None) -> None:
        pass

    def submit(self, function: object, packed: PackedConfig, seed: int) -> Future[SimulatedMission]:  # type: ignore[override]
        future: Future[SimulatedMission] = Future()
        type(self).left -= 1
        if self.left < 0:
            future.set_exception(BrokenProcessPool("a process in the process pool was terminated abruptly"))
            return future
        with packed.unpacked() as config:
            future.set_result(answer(config, seed))
        return future


def test_a_study_whose_worker_was_killed_goes_on_after_its_last_trial(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_config(tmp_path)
    monkeypatch.setattr(executor_module, "LocalExecutor", FailingExecutor)
    journal = tmp_path / "tuning" / "a" / "study.jsonl"
    arguments = ("tune", "rover.toml", "--study", "a", "--trials", "3")
    FailingExecutor.left = 6  # the start has four missions; the first trial after it is not finished
    assert command(*arguments) == 2
    assert_one_sentence(command.error, "a process that computed was ended by a signal", "a study goes on")
    begun = journal.read_text().splitlines()
    assert len(begun) == 2
    FailingExecutor.left = 1000
    assert command(*arguments) in (0, 1)
    lines = journal.read_text().splitlines()
    assert lines[:2] == begun
    assert len(lines) == 4
