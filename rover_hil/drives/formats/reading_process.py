"""Read a file of others in a child process, with limits of memory and processor time.

The child reads, and writes what the parent names; the parent shows the progress, removes what is incomplete
and reports. So a file can neither take the machine nor end the program, whatever a library does with it
(docs/decisions/0026-files-are-read-in-a-child-process.md).
"""

import ctypes
import errno
import math
import os
import resource
import signal
import stat
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NoReturn, TypeAlias, TypeVar

from drivers.clock import seconds, stopwatch_ns
from drivers.errors import ConfigError, LogError, RoverHilError
from rover_hil.console.memory import LIBRARY_BYTES, is_free, is_limited, sentence_of
from rover_hil.drives.formats.limits import GIGABYTE, Limits
from rover_hil.run.end_signals import held_signals

POLL_S = 1.0
REPORT_S = 0.1
"""Least time between two reports of progress."""
MOST_IDLE_S = 45.0
"""A child that takes no processor time for so long hangs; on a busy machine one that computes gets some."""
DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of Linux."""
MEMORY_SIGNALS = (signal.SIGABRT, signal.SIGKILL)
"""Libraries abort, and the system kills, where there is no memory."""

Progress = TypeVar("Progress")
Result = TypeVar("Result")
Report: TypeAlias = Callable[[Progress], None]
_Kind: TypeAlias = Literal["progress", "result", "error"]


def read_in_child(
    path: Path,
    limits: Limits,
    work: Callable[[Report[Progress]], Result],
    progress: AbstractContextManager[Report[Progress]],
) -> Result:
    """Return what `work` returns, which runs in a child process.

    Args:
        path: The file that it reads, for messages.
        limits: Of the child.
        work: Reads the file, calls its argument with its progress, and returns what can be pickled. What it
            prints is lost.
        progress: Gives the function that shows the progress, in this process.

    Raises:
        LogError: The child reached a limit, or ended without a result.
        RoverHilError: What `work` raised, with the same text.
    """
    with _private_folder() as folder:
        return _read_in_child(path, limits, work, progress, folder)


@contextmanager
def _private_folder() -> Iterator[str]:
    """Give a folder for the temporary files of the child, which is removed in the end.

    Raises:
        ConfigError: It cannot be made.
    """
    try:
        folder = TemporaryDirectory(prefix="rover_hil_", ignore_cleanup_errors=True)
    except OSError as error:
        raise ConfigError(
            f"cannot make a temporary folder: {error.strerror}: name a folder with space in TMPDIR"
        ) from error
    with folder as name:
        yield name


def _read_in_child(
    path: Path,
    limits: Limits,
    work: Callable[[Report[Progress]], Result],
    progress: AbstractContextManager[Report[Progress]],
    folder: str,
) -> Result:
    results, sending = Pipe(duplex=False)
    child = 0
    try:
        with held_signals():
            parent = os.getpid()
            child = os.fork()
            if child == 0:
                _run_child(path, limits, work, sending, parent, folder)
        sending.close()
        with progress as show:
            answer = _answer(results, path, child, show)
        if answer is not None:
            return answer[0]  # type: ignore[return-value]
        _, status, usage = os.wait4(child, 0)
        child = 0
        raise LogError(f"{path}: {_end_of(status, usage, limits)}")
    finally:
        results.close()
        sending.close()
        if child:
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def _answer(results: Connection, path: Path, child: int, show: Report[Progress]) -> tuple[object] | None:
    """Return the result of the child; None where it ended without one.

    Raises:
        LogError: It hangs.
        RoverHilError: It reported an error.
    """
    idle_s, worked = 0.0, 0
    while True:
        if not results.poll(POLL_S):
            before, worked = worked, _processor_ticks(child)
            idle_s = idle_s + POLL_S if worked == before else 0.0
            if idle_s > MOST_IDLE_S:
                raise LogError(
                    f"{path}: the process that reads it did nothing for {idle_s:.0f} s: give a file on a "
                    "disk that answers"
                )
            continue
        try:
            kind, value = results.recv()
        except (EOFError, OSError):
            return None
        if kind == "progress":
            show(value)
        elif kind == "error":
            raise RoverHilError(value)
        else:
            return (value,)


def _processor_ticks(child: int) -> int:
    """Return the processor time of a process in ticks of the system; 0 where it has ended."""
    try:
        fields = Path(f"/proc/{child}/stat").read_text("ascii", "replace").rpartition(")")[2].split()
    except OSError:
        return 0
    return int(fields[11]) + int(fields[12])


def _end_of(status: int, usage: resource.struct_rusage, limits: Limits) -> str:
    """Return the sentence on a child that ended without a result."""
    code = os.waitstatus_to_exitcode(status)
    if code == -signal.SIGXCPU:
        return (
            f"reading was ended after {usage.ru_utime + usage.ru_stime:.0f} s of processor time, the limit "
            "for a file of this size: give another file, or raise the limit with --most-minutes"
        )
    if code == -signal.SIGXFSZ:
        return (
            f"reading was ended at {limits.file_bytes / GIGABYTE:.2f} GB of a file that it writes, the limit "
            "for a file of this size: give another file, or raise the limit with --most-memory-gb"
        )
    if code >= 0:
        return "the process that read it ended without a result: give another file"
    name = signal.Signals(-code).name
    if -code in MEMORY_SIGNALS:
        return (
            f"the process that read it was ended by {name}, as where memory is missing; it may take "
            f"{_gigabytes(limits)}: give another file, or raise the limit with --most-memory-gb"
        )
    return f"the process that read it was ended by {name}: the file is damaged, give another one"


def _gigabytes(limits: Limits) -> str:
    return f"{limits.memory_bytes / GIGABYTE:.2f} GB of memory"


def _run_child(
    path: Path,
    limits: Limits,
    work: Callable[[Report[Progress]], object],
    sending: Connection,
    parent: int,
    folder: str,
) -> NoReturn:
    try:
        _isolate(parent)
        tempfile.tempdir = os.environ["TMPDIR"] = folder
        _limit_memory(limits)
        _limit_files(limits)
        report = _Reporter(sending, limits)
        answer: tuple[_Kind, object] = "result", work(report)
    except BaseException as error:  # noqa: BLE001 - the parent reports it
        _lift_memory_limit()
        answer = "error", _sentence(error, path, limits)
    with suppress(BaseException):
        sending.send(answer)
    os._exit(0)


def _isolate(parent: int) -> None:
    """Leave the end of the program to the parent, whose end is that of this process, and print nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(0)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in range(3):
        # A file at the standard input may be what is imported, as /dev/stdin.
        if number or not stat.S_ISREG(os.fstat(number).st_mode):
            os.dup2(nowhere, number)
    # Another thread of the parent may have held the locks of the old ones.
    sys.stdout = sys.stderr = os.fdopen(nowhere, "w")


def _limit_memory(limits: Limits) -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = _data_bytes() + limits.memory_bytes
    resource.setrlimit(
        resource.RLIMIT_DATA, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard)
    )
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _limit_files(limits: Limits) -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    most = limits.file_bytes if hard == resource.RLIM_INFINITY else min(limits.file_bytes, hard)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    # Python ignores it, and a library could take the error of a write for another one.
    signal.signal(signal.SIGXFSZ, signal.SIG_DFL)


def _lift_memory_limit() -> None:
    """Let the report of an error take memory."""
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (hard, hard))


def _data_bytes() -> int:
    """Return the memory of this process that its limit counts."""
    for line in Path("/proc/self/status").read_text("ascii").splitlines():
        if line.startswith("VmData:"):
            return int(line.split()[1]) * 1024
    return 0


class _Reporter:
    """Sends the progress; each report allows more processor time.

    Args:
        sending: To the parent.
        limits: Of this process.
    """

    def __init__(self, sending: Connection, limits: Limits) -> None:
        self._sending = sending
        self._limits = limits
        self._last_ns = stopwatch_ns()
        self._allow()

    def __call__(self, progress: object) -> None:
        now_ns = stopwatch_ns()
        if seconds(now_ns - self._last_ns) < REPORT_S:
            return
        self._last_ns = now_ns
        self._allow()
        self._sending.send(("progress", progress))

    def _allow(self) -> None:
        usage = resource.getrusage(resource.RUSAGE_SELF)
        until_s = usage.ru_utime + usage.ru_stime + self._limits.silent_s
        _, hard = resource.getrlimit(resource.RLIMIT_CPU)
        allowed = math.ceil(min(until_s, self._limits.total_s))
        resource.setrlimit(
            resource.RLIMIT_CPU, (allowed if hard == resource.RLIM_INFINITY else min(allowed, hard), hard)
        )


def _sentence(error: BaseException, path: Path, limits: Limits) -> str:
    """Return the sentence on an error in the child."""
    for cause in _causes(error):
        if isinstance(cause, MemoryError) or (isinstance(cause, OSError) and cause.errno == errno.ENOMEM):
            if is_limited() and not is_free(LIBRARY_BYTES):
                return sentence_of(cause)
            return (
                f"{path}: reading needs more than {_gigabytes(limits)}, the limit for a file of this size: "
                "give another file, or raise the limit with --most-memory-gb"
            )
    if isinstance(error, RoverHilError):
        return str(error)
    where = traceback.extract_tb(error.__traceback__)[-1]
    words = " ".join(str(error).split())[:200]
    return (
        f"{path}: it cannot be imported, {type(error).__name__} in {Path(where.filename).name} line "
        f"{where.lineno}: {words}: give another file; where it is sound, this is a fault of the program"
    )


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
