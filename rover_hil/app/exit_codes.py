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
"""Ended by SIGTERM, or by the loss of the terminal."""


def exit_terminated(reason: str) -> NoReturn:
    """End the program from outside, with one sentence."""
    print(f"rover-hil: {reason}", file=sys.stderr)  # noqa: T201 - not a result
    sys.exit(EXIT_TERMINATED)


def exit_unfinished(sentence: str) -> NoReturn:
    """End the program because what it drives stopped, with one sentence."""
    print(f"rover-hil: {sentence}", file=sys.stderr)  # noqa: T201 - not a result
    sys.exit(EXIT_NO)


def exit_interrupted() -> NoReturn:
    """End the program after ctrl-C, with one sentence."""
    print("rover-hil: interrupted by ctrl-C", file=sys.stderr)  # noqa: T201 - not a result
    sys.exit(EXIT_INTERRUPTED)
