"""Progress of a long computation: a spinner or bar on a terminal, else lines on the standard error."""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import TextIO

from rich.progress import Progress, ProgressColumn, SpinnerColumn, TimeElapsedColumn

from drivers.clock import SystemClock, seconds
from rover_hil.terminal import Terminal, progress_columns, words_column

LINE_S = 2.0
"""Least time between lines."""
MOST_COUNTED = 1000
"""Progress over more than this, such as bytes, or over seconds, is shown in percent."""


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
        columns = (SpinnerColumn(), words_column(), TimeElapsedColumn())
        with Progress(*columns, console=Terminal(file=stream), transient=True) as progress:
            task = progress.add_task(first, total=None)
            yield lambda words: progress.update(task, description=words)
        return
    current = [first]
    with closing(_Lines(lambda: current[0], stream, line_s)):
        yield lambda words: current.__setitem__(0, words)


@contextmanager
def show_progress(
    *columns: ProgressColumn, stream: TextIO | None = None, line_s: float = LINE_S
) -> Iterator[Progress]:
    """Show how far counted tasks are; gives the progress to add them to.

    Args:
        columns: Of the bar on a terminal; by default `progress_columns`.
        stream: Where to write; by default the standard error.
        line_s: Time between lines where the stream is no terminal.
    """
    stream = stream or sys.stderr
    console = Terminal(file=stream)
    if console.is_terminal:
        with Progress(*(columns or progress_columns()), console=console, transient=True) as progress:
            yield progress
        return
    progress = Progress(console=console, disable=True)
    with closing(_Lines(lambda: _progress_words(progress), stream, line_s)):
        yield progress


def _progress_words(progress: Progress) -> str:
    """Return the first task that is not finished, and how far it is; "" for none."""
    for task in progress.tasks:
        if task.finished:
            continue
        if task.total is None:
            return task.description
        if task.total > MOST_COUNTED or not isinstance(task.total, int):
            left_s = task.time_remaining
            left = "" if left_s is None or not task.completed else f", {left_s:.0f} s left"
            return f"{task.description}, {task.percentage:.0f} %{left}"
        return f"{task.description}, {task.completed:g} of {task.total:g}"
    return ""


class _Lines:
    """Writes the current step from a thread of its own, so that long steps show too.

    Args:
        words: Returns the current step.
        stream: Where to write.
        line_s: Time between lines.
    """

    def __init__(self, words: Callable[[], str], stream: TextIO, line_s: float) -> None:
        self._words = words
        self._stream = stream
        self._line_s = line_s
        self._clock = SystemClock()
        self._start_ns = self._clock.now_ns()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._write, name="progress", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the lines."""
        self._ended.set()
        self._thread.join()

    def _write(self) -> None:
        written = ""
        while not self._ended.wait(self._line_s):
            words = self._words()
            if words and words != written:
                written = words
                elapsed_s = seconds(self._clock.now_ns() - self._start_ns)
                self._stream.write(f"{elapsed_s:7.1f} s  {written}\n")
                self._stream.flush()
