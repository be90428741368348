"""What the import commands say of a drive."""

from pathlib import Path

from drivers.clock import seconds
from rover_hil.importing.drive import START_NS, Contents
from rover_hil.terminal import Terminal


def print_contents(contents: Contents, out: Path, *, what: str) -> None:
    """Print what was used, one line each.

    Args:
        contents: What was used.
        out: The log.
        what: The drive consists of, in the plural.
    """
    console = Terminal(soft_wrap=True)
    for section, count in contents.used.items():
        console.print(f"{section}: {count} {what}")
    for section, count in contents.left_out.items():
        console.print(f"{section}: {count} {what} without usable numbers left out")
    if contents.outside:
        console.print(
            f"{contents.outside} {what} left out: recorded before the clock was set, at time 0 or far "
            "from the others"
        )
    for note in contents.notes:
        console.print(note)
    console.print(f"{seconds(contents.end_ns - START_NS):.1f} s: {out}")
