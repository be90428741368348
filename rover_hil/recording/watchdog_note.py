"""The file beside a log in which the watchdog says why it ended the run; the log itself is cut off."""

from contextlib import suppress
from pathlib import Path

MOST_CHARACTERS = 500


def note_path(log_path: Path) -> Path:
    """Return the file that holds why the watchdog ended the run of a log, where it did."""
    return log_path.with_suffix(".watchdog.txt")


def read_note(log_path: Path) -> str:
    """Return why the watchdog ended the run of a log, on one line; empty where there is no such file."""
    text = b""
    with suppress(OSError), note_path(log_path).open("rb") as file:
        text = file.read(MOST_CHARACTERS)
    line = text.decode(errors="replace").strip()
    return "".join(character if character.isprintable() else " " for character in line)
