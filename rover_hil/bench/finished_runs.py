"""Finished runs: which there are, and what the page draws of one."""

from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from drivers.errors import LogError
from rover_hil.datasets.arrays import Array
from rover_hil.report.read_run import read_run
from rover_hil.report.tracks import Series, Track
from rover_hil.report.write import REPORT_NAME

MOST_POINTS = 1500
MOST_RUNS = 200


class Curve(TypedDict):
    """One curve: its points."""

    name: str
    x: list[float]
    y: list[float]


class FinishedRun(TypedDict):
    """What the page draws of a finished run: paths in m, everything else over time in s."""

    name: str
    words: str
    paths: list[Curve]
    slip: list[Curve]
    currents: list[Curve]
    headings: list[Curve]
    cycles: list[Curve]


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


def read_finished(folder: Path, name: str, log_name: str) -> FinishedRun:
    """Read a run for the page.

    Raises:
        LogError: There is no such run, or its log cannot be read.
    """
    if name not in list_runs(folder, log_name):
        raise LogError(f"there is no run '{name}' in {folder}")
    run = read_run(folder / name / log_name)
    tracks = {"estimate": run.estimate, "encoders": run.encoders, "truth": run.truth}
    end = "the log was cut off" if run.end is None else run.end["reason"]
    wheels = run.wheels
    slips = (
        [] if run.slip is None else [(f"wheel {n}", wheel.slip) for n, wheel in enumerate(run.slip.wheels)]
    )
    if run.drift is not None:
        slips = [("rover", run.drift.slip)]
    yaws = {"estimate": run.estimate, "encoders": run.encoders}
    return {
        "name": name,
        "words": f"{end}, {run.duration_s:.1f} s",
        "paths": [_curve(key, track.x_m, track.y_m) for key, track in tracks.items() if track is not None],
        "slip": [_of(key, series, 100.0) for key, series in slips],
        "currents": [_of(f"wheel {n}", wheel.current) for n, wheel in enumerate(wheels) if wheel.current],
        "headings": [
            *(_degrees(key, track) for key, track in yaws.items()),
            *(_of(key, series, float(np.degrees(1.0))) for key, series in run.headings.items()),
        ],
        "cycles": [_curve("cycle", run.cycles.t_s, run.cycles.work_us / 1e3)],
    }


def _degrees(name: str, track: Track) -> Curve:
    return _curve(name, track.t_s, np.degrees(track.yaw_rad))


def _of(name: str, series: Series, factor: float = 1.0) -> Curve:
    return _curve(name, series.t_s, factor * series.value)


def _curve(name: str, x: Array, y: Array) -> Curve:
    is_known = np.isfinite(x) & np.isfinite(y)
    x, y = x[is_known], y[is_known]
    step = max(1, len(x) // MOST_POINTS)
    return {"name": name, "x": np.round(x[::step], 4).tolist(), "y": np.round(y[::step], 4).tolist()}
