"""Enter pressed while a rover drives."""

import os
import select
import sys

MOST_BYTES = 1024


def enter_was_pressed() -> bool:
    """Return whether Enter was pressed on the terminal since the last call; False without a terminal.

    Answers that come from a file are left for the questions after the drive.
    """
    if not sys.stdin.isatty():
        return False
    descriptor = sys.stdin.fileno()
    if not select.select([descriptor], [], [], 0.0)[0]:
        return False
    return b"\n" in os.read(descriptor, MOST_BYTES)
