"""The process of a run that dies: what is known of its end reaches the page."""

import os
import queue
import signal
from pathlib import Path

import pytest

from drivers.clock import PacedClock
from rover_hil.bench.loop_process import DIED, LoopProcess
from rover_hil.bench.views import Notice, RunOrder
from rover_hil.recording.watchdog_note import note_path
from rover_hil.run.executive import Operator, RunResult
from tests.rover_hil.bench.rovers import quick

CAUSE = "watchdog: the loop gave no heartbeat; the drive was stopped"


def die(order: RunOrder, operator: Operator, clock: PacedClock | None) -> RunResult:
    """End as the watchdog ends a loop that hangs."""
    del operator, clock
    note_path(order.log_path).write_text(f"{CAUSE}\n")
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def report(order: RunOrder) -> None:
    del order


@pytest.mark.slow
@pytest.mark.parametrize(("is_virtual", "told"), [(False, CAUSE), (True, DIED)])
def test_why_a_run_died_reaches_the_page(tmp_path: Path, *, is_virtual: bool, told: str) -> None:
    notices: queue.SimpleQueue[Notice] = queue.SimpleQueue()
    process = LoopProcess(die, report, notices.put)
    try:
        order = RunOrder(
            source="rover.toml",
            config=quick(),
            log_path=tmp_path / "run.mcap",
            limit_s=1.0,
            is_virtual=is_virtual,
        )
        assert process.send(order)
        assert notices.get(timeout=60.0) == {"kind": "failed", "error": told}
    finally:
        process.close()
