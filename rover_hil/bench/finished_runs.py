"""Finished runs: which there are, and what the page draws of one."""

import signal
import threading
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeAlias, cast

from drivers.errors import LogError
from rover_hil.recording.text import strict_json
from rover_hil.report.curves import RunCurves, run_curves
from rover_hil.report.read_run import read_run
from rover_hil.report.write import REPORT_NAME

SHARE = 0.5
MOST_RUNS = 200


def list_runs(folder: Path, log_name: str) -> list[str]:
    """Return the names of the runs in a folder, the newest first."""
    logs = sorted(folder.glob(f"*/{log_name}"), key=lambda path: path.stat().st_mtime, reverse=True)
    return [path.parent.name for path in logs[:MOST_RUNS]]


def find_report(folder: Path, name: str) -> Path | None:
    """Return the report of a run; None where there is none, or the name is not that of a folder here."""
    if name not in {path.name for path in folder.iterdir() if path.is_dir()}:
        return None
    path = folder / name / REPORT_NAME
    return path if path.is_file() else None


def read_finished(folder: Path, name: str, log_name: str) -> RunCurves:
    """Read a run for the page.

    Raises:
        LogError: There is no such run, or its log cannot be read.
    """
    if name not in list_runs(folder, log_name):
        raise LogError(f"there is no run '{name}' in {folder}")
    return run_curves(read_run(folder / name / log_name), name, share=SHARE)


Found: TypeAlias = tuple[bytes, list[tuple[str, str]], list[str]]
"""Runs that could be read as JSON, name and words of each, and a sentence for each that could not."""


class RunReader:
    """Reads runs in a process of its own, so that the program of the page does nothing else meanwhile."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pipe: Connection[object, object] | None = None

    def read(self, folder: Path, names: Sequence[str], log_name: str) -> Found:
        """Return what was found; waits for it.

        Raises:
            LogError: The process has ended.
        """
        with self._lock:
            if self._pipe is None:
                self._pipe = self._start()
            try:
                self._pipe.send((folder, names, log_name))
                return cast("Found", self._pipe.recv())
            except (EOFError, OSError) as error:
                self._pipe = None
                raise LogError("the process that reads runs has ended: open them again") from error

    def _start(self) -> "Connection[object, object]":
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        context.Process(target=_serve, args=(theirs,), name="finished runs", daemon=True).start()
        theirs.close()  # else neither side would notice that the other is gone
        return ours


def _serve(pipe: "Connection[object, tuple[Path, Sequence[str], str]]") -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # ctrl-C is for the program, which then closes the pipe
    with suppress(EOFError, OSError):
        while True:
            pipe.send(_read_all(*pipe.recv()))


def _read_all(folder: Path, names: Sequence[str], log_name: str) -> Found:
    runs, errors = [], []
    for name in names:
        try:
            runs.append(read_finished(folder, name, log_name))
        except LogError as error:
            errors.append(str(error))
    return strict_json(runs), [(run["name"], f"{run['name']}: {run['words']}") for run in runs], errors
