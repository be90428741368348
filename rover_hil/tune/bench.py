"""Rehearsals on all cores."""

import os
import signal
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from itertools import repeat
from multiprocessing import get_context, parent_process
from types import TracebackType
from typing import Self

from rover_hil.config import Config
from rover_hil.tune.rehearsal import Rehearsal, rehearse


class Bench:
    """A pool of processes, one per core that this process may use."""

    def __init__(self) -> None:
        self._pool = ProcessPoolExecutor(
            len(os.sched_getaffinity(0)), mp_context=get_context("spawn"), initializer=_obey_the_parent
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pool.shutdown(cancel_futures=True)

    def drive(self, config: Config, seeds: Sequence[int]) -> Generator[Rehearsal, None, None]:
        """Drive the mission on the sites of `seeds`; closing the iterator leaves out those not begun."""
        with _ctrl_c_held_back():
            results = self._pool.map(rehearse, repeat(config), seeds)
        yield from results


@contextmanager
def _ctrl_c_held_back() -> Iterator[None]:
    """Block SIGINT, which workers that start meanwhile inherit: a terminal sends ctrl-C to every process.

    The parent receives it afterwards; a worker never does, as its own handler would come too late.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _obey_the_parent() -> None:
    """End when the parent is killed."""
    threading.Thread(target=_end_with_the_parent, daemon=True).start()


def _end_with_the_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
