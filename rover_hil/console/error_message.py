"""The message of an error as a terminal shows it, whatever a file of a stranger put into it."""

from collections.abc import Sequence

from drivers.errors import ConfigError
from drivers.files import LONGEST_NAME_BYTES, LONGEST_PATH

MOST_LINES = 10
LONGEST_LINE = 500


def readable(message: str) -> str:
    """Return a message without control characters, its lines and their number shortened."""
    lines = message.splitlines()
    shown = [readable_line(line) for line in lines[:MOST_LINES]]
    if len(lines) > MOST_LINES:
        shown.append(f"... and {len(lines) - MOST_LINES} lines more")
    return "\n".join(shown)


def readable_line(line: str) -> str:
    """Return a line without control characters, shortened."""
    return _shortened("".join(c if c.isprintable() else "?" for c in line))


def check_name_lengths(arguments: Sequence[str]) -> None:
    """Check that each argument could be the name of a file.

    Raises:
        ConfigError: One is longer than any file system allows.
    """
    for argument in arguments:
        longest = max(len(part.encode("utf-8", "surrogateescape")) for part in argument.split("/"))
        if longest > LONGEST_NAME_BYTES or len(argument) > LONGEST_PATH:
            raise ConfigError(f"'{argument[:40]}...' is too long for the name of a file: correct it")


def _shortened(line: str) -> str:
    if len(line) <= LONGEST_LINE:
        return line
    half = LONGEST_LINE // 2
    return f"{line[:half]} ... {line[-half:]}"
