"""Exit codes of every command."""

import sys
from typing import NoReturn

from rover_hil.console.output import tell

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
    tell(f"rover-hil: {reason}")
    sys.exit(EXIT_TERMINATED)


def exit_unfinished(sentence: str) -> NoReturn:
    """End the program because what it drives stopped, with one sentence."""
    tell(f"rover-hil: {sentence}")
    sys.exit(EXIT_NO)


def exit_interrupted() -> NoReturn:
    """End the program after ctrl-C, with one sentence."""
    tell("rover-hil: interrupted by ctrl-C")
    sys.exit(EXIT_INTERRUPTED)
