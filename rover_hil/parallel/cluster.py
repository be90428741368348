"""A Dask cluster as an executor of the standard library.

Dask runs the calls of a worker that died again on another one, and gives each result once. This module adds
what it leaves to its user: every worker must compute what this machine computes, and every failure of the
cluster is an error of ours with one sentence.
"""

import importlib.metadata
import re
from collections.abc import Callable, Iterable
from concurrent.futures import CancelledError, Executor, Future
from functools import partial
from typing import ParamSpec, TypeVar

from drivers.errors import ConfigError
from rover_hil.parallel.build_id import build_id
from rover_hil.recording.made_with import BLAS_KERNEL, OWN_PACKAGES

try:
    from distributed import Client, KilledWorker, Worker, get_worker
    from distributed import Future as ClusterFuture
    from distributed.client import FutureCancelledError
except ModuleNotFoundError as missing:
    raise ConfigError("--cluster needs dask: install rover-hil[cluster]") from missing

P = ParamSpec("P")
T = TypeVar("T")

CONNECT_TIMEOUT_S = 10.0
MOST_STARTS = 5
"""How often a call is started when its result was lost with a worker."""
ADDRESS = re.compile(r"(?:(?:tcp|tls|ucx|ws|wss)://)?(?:\[[\w:.%]+\]|[\w.-]+):(?P<port>[0-9]{1,5})/?")
MOST_PORT = 65535
KEPT = "what is finished is kept; give the same command again to go on"


class WorkerRefusedError(ConfigError):
    """A worker that would not compute what this machine computes."""


class ClusterExecutor(Executor):
    """Sends calls to the workers of a Dask scheduler.

    Workers may join and leave at any time. The calls that a worker was running when it died are run again.

    Args:
        address: Of the scheduler.
        uses_blas: Whether the calls use BLAS, see `build_id`: workers with another kernel are then refused.

    Raises:
        ConfigError: The scheduler does not answer, has no worker, or has one that lacks the package, has
            another version of it or runs more than one thread.
    """

    def __init__(self, address: str, *, uses_blas: bool = True) -> None:
        self._address = address
        self._build_id = build_id(uses_blas=uses_blas)
        _check_address(address)
        try:
            self._client = Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise ConfigError(
                f"no Dask scheduler answers at {address}: check the address and that `dask scheduler` runs"
            ) from error
        try:
            self._check_workers()
        except BaseException:
            self._client.close()
            raise

    def submit(self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Start a call on a free worker."""
        outer: Future[T] = Future()
        self._start(partial(function, *args, **kwargs), outer, MOST_STARTS)
        return outer

    def _start(self, call: Callable[[], T], outer: Future[T], starts: int) -> None:
        """Start a call, at most `starts` times; `outer` gets its outcome."""
        try:
            inner = self._client.submit(_call, self._build_id, call, pure=False)
        except (OSError, RuntimeError) as error:
            raise self._lost() from error
        inner.add_done_callback(partial(self._settle, call, outer, starts))
        outer.add_done_callback(partial(_cancel, inner))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster; its scheduler forgets calls of this executor that have not ended."""
        self._client.close()

    def _check_workers(self) -> None:
        try:
            versions = self._client.run(importlib.metadata.version, "rover-hil", on_error="return")
            for worker, version in versions.items():
                if isinstance(version, Exception):
                    raise WorkerRefusedError(_without_package(worker))
            refusals = self._client.run(find_refusal, self._build_id, on_error="return")
        except (OSError, RuntimeError) as error:
            raise self._lost() from error
        for worker, refusal in refusals.items():
            if refusal and not (isinstance(refusal, str) and refusal.startswith("worker ")):
                raise WorkerRefusedError(_without_package(worker))  # it could not load `find_refusal`
            if refusal:
                raise WorkerRefusedError(refusal)
        if not refusals:
            raise ConfigError(
                f"the cluster at {self._address} has no worker: start one with "
                f"`dask worker {self._address} --nthreads 1`"
            )

    def _settle(self, call: Callable[[], T], outer: Future[T], starts: int, inner: ClusterFuture[T]) -> None:
        """Give the outcome of the call on the cluster to the future that the caller holds.

        A worker may die between the end of a call and the collection of its result. The call is then made
        again; the same call gives the same result, and the caller gets one.
        """
        if outer.cancelled():
            return
        if inner.status == "error":
            _finish(outer, _translated(inner.exception()))
            return
        try:
            result = inner.result()
        except (OSError, RuntimeError, CancelledError, FutureCancelledError):
            try:
                if starts > 1 and self._client.status == "running":
                    self._start(call, outer, starts - 1)
                else:
                    _finish(outer, self._lost())
            except ConfigError as error:  # in this thread of Dask nobody would see it
                _finish(outer, error)
        else:
            if outer.set_running_or_notify_cancel():
                outer.set_result(result)

    def _lost(self) -> ConfigError:
        return ConfigError(f"the connection to the cluster at {self._address} was lost: {KEPT}")


def _check_address(address: str) -> None:
    """Check the form of an address: what dask says of a wrong one takes 20 s and is no sentence."""
    match = ADDRESS.fullmatch(address)
    if match is None or not 0 < int(match["port"]) <= MOST_PORT:
        raise ConfigError(
            f"--cluster '{address}' is no address of a scheduler: write it with its port, like "
            "tcp://192.168.1.5:8786"
        )


def find_refusal(expected: str, dask_worker: Worker | None = None) -> str:
    """Return why the worker that runs this is refused; "" where it is not.

    Args:
        expected: `build_id` of the machine that sends the work.
        dask_worker: The worker, which `Client.run` passes by this name; None within a call.
    """
    worker = dask_worker or get_worker()
    own = build_id(uses_blas=BLAS_KERNEL in expected)
    if own != expected:
        return (
            f"worker {worker.address} is refused, as its results could differ: it has {own}, this machine "
            f"has {expected}; install the same there; for another BLAS "
            "kernel start all of them, and this command, with OPENBLAS_CORETYPE=Haswell"
        )
    if worker.state.nthreads != 1:
        return (
            f"worker {worker.address} is refused, as it runs {worker.state.nthreads} threads: start it with "
            "--nthreads 1, and with --nworkers for more cores"
        )
    return ""


def _call(expected: str, call: Callable[[], T]) -> T:
    """Run a call on a worker, unless the worker is refused: it may have joined after the first check."""
    refusal = find_refusal(expected)
    if refusal:
        raise WorkerRefusedError(refusal)
    return call()


def _finish(outer: Future[T], error: BaseException) -> None:
    if outer.set_running_or_notify_cancel():
        outer.set_exception(error)


def _cancel(inner: ClusterFuture[T], outer: Future[T]) -> None:
    if outer.cancelled():
        inner.cancel()


def _translated(error: BaseException) -> BaseException:
    """Return the error of a call as one that names what to do."""
    if isinstance(error, KilledWorker):
        return ConfigError(
            f"a call ended {error.allowed_failures + 1} workers of the cluster one after the other: look at "
            f"their logs, and whether they have enough memory; {KEPT}"
        )
    missing = _missing_modules(error)
    if any(name.partition(".")[0] in OWN_PACKAGES for name in missing):
        return WorkerRefusedError(_without_package("that has joined the cluster"))
    return error


def _missing_modules(error: BaseException | None) -> Iterable[str]:
    while error is not None:
        if isinstance(error, ModuleNotFoundError) and error.name:
            yield error.name
        error = error.__cause__ or error.__context__


def _without_package(worker: str) -> str:
    return f"worker {worker} is refused, as it has no rover-hil: install it there as on this machine"
