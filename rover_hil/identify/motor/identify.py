"""Identify the motors of all given logs."""

from collections.abc import Callable, Sequence
from pathlib import Path

from drivers.errors import LogError
from rover_hil.drives.robotino_csv import is_averages
from rover_hil.identify.motor.log import read_log
from rover_hil.identify.motor.record import MotorSignals
from rover_hil.identify.motor.report import MotorReport, report_motor
from rover_hil.identify.motor.robotino import SteadyMeans, read_means, read_table, report_means
from rover_hil.parallel.calls import HERE, Calls

SUFFIXES = (".csv", ".csv.gz", ".mcap")

Record = MotorSignals | SteadyMeans
"""One motor in one log: reading by reading, or as averages."""


def find_logs(paths: Sequence[Path]) -> list[Path]:
    """Return the log files among `paths` and in the folders among them, sorted.

    Raises:
        LogError: A path does not exist, or there is no log in it.
    """
    known: list[Path] = []
    for path in paths:
        inside = sorted(path.rglob("*")) if path.is_dir() else [path]
        logs = [file for file in inside if file.is_file() and file.name.endswith(SUFFIXES)]
        if not logs:
            raise LogError(
                f"{path} is not a log and holds none: give .mcap, .csv or .csv.gz files or their folder"
            )
        known += [log for log in logs if log not in known]
    return known


def read_records(path: Path) -> list[Record]:
    """Return the motors in one log or file of averages.

    Raises:
        LogError: The log cannot be read or holds something wrong.
    """
    if path.suffix == ".mcap":
        return [*read_log(path)]
    return [*read_means(path)] if is_averages(path) else [*read_table(path)]


def identify(
    records: Sequence[Record], advance: Callable[[], None] = lambda: None, calls: Calls = HERE
) -> list[MotorReport]:
    """Return a report on every motor; `advance` is called after each.

    Raises:
        LogError: The logs of a motor come from different devices, or hold too little.
    """
    motors: list[Sequence[Record]] = []
    for motor in sorted({record.motor for record in records}):
        whole = [item for item in records if isinstance(item, MotorSignals) and item.motor == motor]
        averaged = [item for item in records if isinstance(item, SteadyMeans) and item.motor == motor]
        if whole and averaged:
            raise LogError(
                f"{averaged[0].log} holds averages and {whole[0].log} does not: identify them one by one"
            )
        motors.append(whole or averaged)
    reports: list[MotorReport] = []
    for report in calls.map(_report, motors):
        reports.append(report)
        advance()
    return reports


def _report(records: Sequence[Record]) -> MotorReport:
    """Return the report on one motor."""
    whole = [item for item in records if isinstance(item, MotorSignals)]
    return (
        report_motor(whole)
        if whole
        else report_means([item for item in records if isinstance(item, SteadyMeans)])
    )
