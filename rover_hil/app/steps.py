"""Progress of a long computation: a spinner on a terminal, else lines on the standard error."""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from drivers.clock import SystemClock, seconds

LINE_S = 2.0
"""Least time between lines."""


@contextmanager
def show_steps(
    first: str, stream: TextIO | None = None, line_s: float = LINE_S
) -> Iterator[Callable[[str], None]]:
    """Show what is being done, with the elapsed time; gives the function to call with each step.

    Args:
        first: The first step.
        stream: Where to write; by default the standard error.
        line_s: Time between lines where the stream is no terminal. A step that takes less has no line.
    """
    stream = stream or sys.stderr
    if stream.isatty():
        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
        with Progress(*columns, console=Console(file=stream), transient=True) as progress:
            task = progress.add_task(first, total=None)
            yield lambda words: progress.update(task, description=words)
        return
    lines = _Lines(first, stream, line_s)
    try:
        yield lines.advance
    finally:
        lines.close()


class _Lines:
    """Writes the current step from a thread of its own, so that long steps show too.

    Args:
        first: The first step.
        stream: Where to write.
        line_s: Time between lines.
    """

    def __init__(self, first: str, stream: TextIO, line_s: float) -> None:
        self._words = first
        self._stream = stream
        self._line_s = line_s
        self._clock = SystemClock()
        self._start_ns = self._clock.now_ns()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._write, name="progress", daemon=True)
        self._thread.start()

    def advance(self, words: str) -> None:
        """Begin the next step."""
        self._words = words

    def close(self) -> None:
        """End the lines."""
        self._ended.set()
        self._thread.join()

    def _write(self) -> None:
        written = ""
        while not self._ended.wait(self._line_s):
            if self._words != written:
                written = self._words
                elapsed_s = seconds(self._clock.now_ns() - self._start_ns)
                self._stream.write(f"{elapsed_s:7.1f} s  {written}\n")
                self._stream.flush()
