"""Progress without a terminal."""

import io
import threading

from rover_hil.console.steps import show_progress

LIMIT_S = 60.0


class Stream(io.StringIO):
    """Sets an event when something is written."""

    def __init__(self) -> None:
        super().__init__()
        self.was_written = threading.Event()

    def write(self, text: str) -> int:
        count = super().write(text)
        self.was_written.set()
        return count


def test_a_counted_task_is_shown_without_a_terminal() -> None:
    stream = Stream()
    with show_progress(stream=stream, line_s=0.001) as progress:
        task = progress.add_task("fitting", total=3)
        assert stream.was_written.wait(LIMIT_S)
        stream.was_written.clear()
        progress.advance(task)
        assert stream.was_written.wait(LIMIT_S)
        progress.update(task, completed=3)
        stream.was_written.clear()
        writing = progress.add_task("writing", total=2_000_000, completed=500_000)
        assert stream.was_written.wait(LIMIT_S)
        stream.was_written.clear()
        progress.update(progress.add_task("listening", total=2.0), completed=1.48)
        progress.update(writing, completed=2_000_000)
        assert stream.was_written.wait(LIMIT_S)
    lines = [line.split(" s  ")[1] for line in stream.getvalue().splitlines()]
    assert lines == ["fitting, 0 of 3", "fitting, 1 of 3", "writing, 25 %", "listening, 74 %"]


def test_what_is_soon_done_leaves_no_line() -> None:
    stream = io.StringIO()
    with show_progress(stream=stream, line_s=60.0) as progress:
        progress.advance(progress.add_task("fitting", total=1))
    assert stream.getvalue() == ""
