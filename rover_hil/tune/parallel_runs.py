"""Simulated missions on all cores."""

import os
import signal
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from itertools import repeat
from multiprocessing import get_context, parent_process
from typing import Self

from rover_hil.config import Config
from rover_hil.tune.simulated_mission import SimulatedMission, simulate_mission


class ParallelRuns:
    """A pool of processes, one per available core."""

    def __init__(self) -> None:
        self._pool = ProcessPoolExecutor(
            len(os.sched_getaffinity(0)), mp_context=get_context("spawn"), initializer=_end_with_the_parent
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def drive(self, config: Config, seeds: Sequence[int]) -> Generator[SimulatedMission, None, None]:
        """Drive the mission on the scenarios of `seeds`; closing the iterator cancels those not started."""
        with _interrupts_blocked():
            results = self._pool.map(simulate_mission, repeat(config), seeds)
        yield from results


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block SIGINT, which workers that start meanwhile inherit: a terminal sends ctrl-C to every process.

    The parent receives it afterwards; a worker never does, as its own handler would come too late.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_the_parent() -> None:
    """End when the parent is killed."""
    threading.Thread(target=_wait_for_the_parent, daemon=True).start()


def _wait_for_the_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
