"""The executor that long commands send their independent work to."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from typing import ParamSpec, TypeVar

from drivers.errors import RoverHilError

P = ParamSpec("P")
T = TypeVar("T")


class WorkerLostError(RoverHilError):
    """A process of this machine that computed for this one has ended."""


@contextmanager
def open_executor(
    cluster: str | None = None, processes: int | None = None, *, uses_blas: bool = True
) -> Iterator[Executor]:
    """Give an executor; work that has not begun at the end is cancelled.

    Functions and arguments are pickled: a function is one of a module, and files travel as bytes.

    Args:
        cluster: Address of a Dask scheduler, such as `tcp://192.168.1.5:8786`; None for processes of this
            machine.
        processes: Number of processes of this machine; one per available core where it is None.
        uses_blas: Whether the last bits of the calls depend on the kernel of BLAS, see `build_id`.

    Raises:
        ConfigError: The cluster cannot be used, see `ClusterExecutor`.
        WorkerLostError: A process of this machine was ended from outside.
    """
    executor: Executor
    if cluster is None:
        executor = LocalExecutor(processes)
    else:
        # Imported here because dask is an optional package, and takes half a second.
        from rover_hil.parallel.cluster import ClusterExecutor

        executor = ClusterExecutor(cluster, uses_blas=uses_blas)
    try:
        yield executor
    except BrokenProcessPool as error:
        raise WorkerLostError(
            "a process that computed was ended by a signal, or for want of memory: give the same "
            "command again; a study goes on after its last finished trial"
        ) from error
    finally:
        executor.shutdown(cancel_futures=True)


class LocalExecutor(ProcessPoolExecutor):
    """Processes of this machine, which end with this one."""

    def __init__(self, processes: int | None = None) -> None:
        super().__init__(
            processes or len(os.sched_getaffinity(0)),
            mp_context=get_context("spawn"),
            initializer=_end_with_the_parent,
        )

    def submit(self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Start a call on a free process."""
        with _interrupts_blocked():
            return super().submit(function, *args, **kwargs)


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
