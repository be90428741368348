"""Identify the motors of all given logs."""

from collections.abc import Callable, Sequence
from pathlib import Path

from drivers.errors import LogError
from rover_hil.identify.motor_log import read_log
from rover_hil.identify.motor_record import MotorRecord
from rover_hil.identify.motor_report import MotorReport, report_motor
from rover_hil.identify.motor_table import read_table

SUFFIXES = (".csv", ".csv.gz", ".mcap")


def find_logs(paths: Sequence[Path]) -> list[Path]:
    """Return the log files among `paths` and in the folders among them, sorted.

    Raises:
        LogError: A path does not exist, or there is no log in it.
    """
    found: list[Path] = []
    for path in paths:
        inside = sorted(path.rglob("*")) if path.is_dir() else [path]
        logs = [file for file in inside if file.is_file() and file.name.endswith(SUFFIXES)]
        if not logs:
            msg = f"{path} is no log and holds none: give .mcap, .csv or .csv.gz files or their folder"
            raise LogError(msg)
        found += [log for log in logs if log not in found]
    return found


def read_records(path: Path) -> list[MotorRecord]:
    """Return what one log tells about its motors.

    Raises:
        LogError: The log cannot be read or holds something wrong.
    """
    return read_log(path) if path.suffix == ".mcap" else read_table(path)


def identify(records: Sequence[MotorRecord], advance: Callable[[], None] = lambda: None) -> list[MotorReport]:
    """Return a report on every motor; `advance` is called after each.

    Raises:
        LogError: The logs of a motor come from different devices.
    """
    reports = []
    for motor in sorted({record.motor for record in records}):
        reports.append(report_motor([record for record in records if record.motor == motor]))
        advance()
    return reports
