"""Finished runs: which there are, and what the page draws of one."""

from pathlib import Path

from drivers.errors import LogError
from rover_hil.report.curves import RunCurves, run_curves
from rover_hil.report.read_run import read_run
from rover_hil.report.write import REPORT_NAME

SHARE = 0.5
MOST_RUNS = 200


def list_runs(folder: Path, log_name: str) -> list[str]:
    """Return the names of the runs in a folder, the newest first."""
    logs = sorted(folder.glob(f"*/{log_name}"), key=lambda path: path.stat().st_mtime, reverse=True)
    return [path.parent.name for path in logs[:MOST_RUNS]]


def find_report(folder: Path, name: str) -> Path | None:
    """Return the report of a run; None where there is none, or the name is not that of a folder here."""
    if name not in {path.name for path in folder.iterdir() if path.is_dir()}:
        return None
    path = folder / name / REPORT_NAME
    return path if path.is_file() else None


def read_finished(folder: Path, name: str, log_name: str) -> RunCurves:
    """Read a run for the page.

    Raises:
        LogError: There is no such run, or its log cannot be read.
    """
    if name not in list_runs(folder, log_name):
        raise LogError(f"there is no run '{name}' in {folder}")
    return run_curves(read_run(folder / name / log_name), name, share=SHARE)
