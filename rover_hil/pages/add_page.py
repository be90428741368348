"""The page that shows a result: it is drawn when the result is written, and may fail."""

from collections.abc import Callable
from pathlib import Path

from drivers.errors import RoverHilError
from rover_hil.console.memory import sentence_of
from rover_hil.pages.atomic_write import write_file
from rover_hil.terminal import Terminal


def add_page(path: Path, make: Callable[[], str]) -> None:
    """Write the page of a result that is already written; an earlier page goes.

    A page that cannot be drawn is reported in one sentence: the result is complete without it.

    Args:
        path: The page.
        make: Returns its text.

    Raises:
        ConfigError: The page cannot be written.
        RoverHilError: What it shows cannot be read.
        MemoryError: There is too little memory.
    """
    path.unlink(missing_ok=True)
    try:
        text = make()
    except (RoverHilError, MemoryError):
        raise
    except Exception as error:
        if sentence_of(error):
            raise
        words = (
            f"no page {path}: it cannot be drawn ({type(error).__name__}: {error}); the result is complete"
        )
        Terminal(stderr=True).print(words, soft_wrap=True)
        return
    write_file(path, text)
