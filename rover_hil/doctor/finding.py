"""Findings of the doctor, and the folders of the system that it reads."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path


class Level(StrEnum):
    """Severity of a finding: with a warning the rover can drive, with a problem it cannot or must not."""

    OK = "ok"
    WARNING = "warning"
    PROBLEM = "problem"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was checked.

    Attributes:
        check: What was checked, e.g. "serial port".
        subject: Name of the device, or part of the system.
        level: Severity.
        what: What was found.
        cause: Why it is so; empty for an OK.
        fix: A command or an edit that the user can do at once; empty for an OK.
    """

    check: str
    subject: str
    level: Level
    what: str
    cause: str = ""
    fix: str = ""


@dataclass(frozen=True, slots=True)
class SystemPaths:
    """Folders in which the system shows its devices and processes."""

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
