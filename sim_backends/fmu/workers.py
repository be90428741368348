"""Processes that load a unit and simulate runs with it.

The native code of a unit runs in processes of its own: when it crashes, the program does not, and what it
prints does not mix with results.
"""

import os
import shutil
import signal
import threading
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process

from drivers.errors import ConfigError
from sim_backends.fmu.instance import Instance, Job, Layout, Result, load
from sim_backends.fmu.unit import Place, Unit

CHUNKS = 4
"""Portions of work per process."""

_loaded: list[Instance] = []
"""The unit of this process."""


class Workers:
    """One process for each core, each with the unit; they end with the program."""

    def __init__(self, unit: Unit, layout: Layout) -> None:
        self.unit = unit
        self._layout = layout
        self._count = len(os.sched_getaffinity(0))
        self._pool: ProcessPoolExecutor | None = None

    def simulate(self, jobs: Sequence[Job]) -> list[Result]:
        """Simulate runs on all cores.

        Raises:
            ConfigError: The unit cannot be loaded, or its code crashes.
        """
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self._count,
                mp_context=get_context("spawn"),
                initializer=_begin,
                initargs=(self.unit.place, self._layout),
            )
        size = max(1, len(jobs) // (CHUNKS * self._count))
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            results = self._pool.map(_simulate, jobs, chunksize=size)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        try:
            return list(results)
        except BrokenProcessPool as error:
            self.close()
            raise ConfigError(
                f"the native code of {self.unit.path.name} crashed: use parameters that it accepts, or ask "
                "its supplier"
            ) from error

    def close(self) -> None:
        """End the processes and remove the unpacked unit."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None
        self.unit.close()


def _begin(place: Place, layout: Layout) -> None:
    # A unit may print; standard output belongs to the results.
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    threading.Thread(target=_end_with_the_parent, args=(place.folder,), daemon=True).start()
    _loaded[:] = [load(place, layout)]


def _end_with_the_parent(folder: str) -> None:
    """End when the parent is killed, which then cannot remove the unpacked unit itself."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(1)


def _simulate(job: Job) -> Result:
    return _loaded[0].simulate(job)
