"""Rehearsals on all cores."""

import os
import signal
import threading
from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
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
        yield from self._pool.map(rehearse, repeat(config), seeds)


def _obey_the_parent() -> None:
    """Leave ctrl-C, which a terminal sends to every process, to the parent; end when that is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_the_parent, daemon=True).start()


def _end_with_the_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
