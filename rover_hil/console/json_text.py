"""Results for scripts: JSON on the standard output."""

import sys

from rover_hil.recording.text import strict_json


def print_json(record: object) -> None:
    """Print a result as JSON; numbers that are not finite as null."""
    print_json_text(strict_json(record, indent=2).decode())


def print_json_text(text: str) -> None:
    """Print JSON as it is: not as on a terminal, where characters may be replaced."""
    sys.stdout.write(f"{text}\n")
