"""What the doctor says, and where it looks."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path


class Level(StrEnum):
    """How bad a finding is: with a warning the rover can drive, with a problem it cannot or must not."""

    OK = "ok"
    WARNING = "warning"
    PROBLEM = "problem"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        check: What was looked at, e.g. "serial port".
        subject: Of what: the name of a device, or a part of the system.
        level: How bad it is.
        what: What was seen.
        cause: Why it is so; empty where all is well.
        fix: A command or an edit that the user can do at once; empty where all is well.
    """

    check: str
    subject: str
    level: Level
    what: str
    cause: str = ""
    fix: str = ""


@dataclass(frozen=True, slots=True)
class SystemPaths:
    """Where the system shows its devices and processes."""

    dev: Path = Path("/dev")
    sys: Path = Path("/sys")
    proc: Path = Path("/proc")


CAN_WIRING = (
    "measure 60 ohm between CAN_H and CAN_L with power off; switch the drives on; compare all bit rates"
)


def ok(check: str, subject: str, what: str) -> Finding:
    """Return a finding that needs nothing."""
    return Finding(check, subject, Level.OK, what)


def warning(check: str, subject: str, what: str, cause: str, fix: str) -> Finding:
    """Return a finding with which the rover can drive."""
    return Finding(check, subject, Level.WARNING, what, cause, fix)


def problem(check: str, subject: str, what: str, cause: str, fix: str) -> Finding:
    """Return a finding that must be fixed first."""
    return Finding(check, subject, Level.PROBLEM, what, cause, fix)


def read_text(path: Path) -> str | None:
    """Return the text of a file of the system without the line end, or None where it cannot be read."""
    try:
        return path.read_text("utf-8").strip()
    except (OSError, UnicodeDecodeError):
        return None
