"""Exit codes of every command."""

import sys
from typing import NoReturn

EXIT_OK = 0
EXIT_NO = 1
"""The command ran, and the answer is no."""
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
"""Ended by ctrl-C."""
EXIT_TERMINATED = 143
"""Ended by SIGTERM."""


def exit_terminated() -> NoReturn:
    """End the program after SIGTERM, with one sentence."""
    print("rover-hil: ended by SIGTERM", file=sys.stderr)  # noqa: T201 - not a result
    sys.exit(EXIT_TERMINATED)


def exit_interrupted() -> NoReturn:
    """End the program after ctrl-C, with one sentence."""
    print("rover-hil: interrupted by ctrl-C", file=sys.stderr)  # noqa: T201 - not a result
    sys.exit(EXIT_INTERRUPTED)
