"""Results for scripts: JSON on the standard output."""

from rich.console import Console

from rover_hil.recording.text import strict_json


def print_json(record: object) -> None:
    """Print a result as JSON; numbers that are not finite as null."""
    Console().out(strict_json(record, indent=2).decode())
