"""The curves of runs for pages on which one can zoom: ways seen from above, and values over the same time."""

from collections.abc import Iterator, Sequence
from math import isfinite

import numpy as np
from typing_extensions import TypedDict

from controllers.motion.settings import MissionSettings
from rover_hil.drives.arrays import Array
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import position_error_m, summarise
from rover_hil.report.thinning import thin, with_gaps
from rover_hil.report.tracks import Series, Track

CHARTS = {
    "error": ("Distance from the truth", "mm"),
    "beside": ("Left of the path", "mm"),
    "headings": ("Yaw", "deg"),
    "slip": ("Slip", "%"),
    "currents": ("Motor currents", "A"),
    "speeds": ("Wheel speeds", "rad/s"),
    "cycles": ("Work of a cycle", "ms"),
}
"""Title and unit of each chart."""
MOST_POINTS = 60_000
"""Of all curves of a page together: about a megabyte."""
FEWEST_BINS = 200
DIGITS = 5
TIME_DECIMALS, PLACE_DECIMALS = 3, 4


class Curve(TypedDict):
    """Values over time; None where nothing is known for a while."""

    name: str
    x: list[float]
    y: list[float | None]


class Way(TypedDict):
    """A way seen from above, with the time of each point."""

    name: str
    t: list[float]
    x: list[float]
    y: list[float]


class RunCurves(TypedDict):
    """What a page draws of a run: ways in m, charts by the keys of `CHARTS`, all over s since the start.

    Attributes:
        colour: Where several runs are shown, of this one.
        stops: Begin and end of each safety stop.
        mission: Corners of the path in m; empty without one.
        area: Border of the rover's area in m, a closed line; empty without one.
    """

    name: str
    colour: str
    words: str
    duration_s: float
    paths: list[Way]
    charts: dict[str, list[Curve]]
    stops: list[tuple[float, float]]
    mission: list[tuple[float, float]]
    area: list[tuple[float, float]]


class ViewerData(TypedDict):
    """What `pages/viewer.html` shows: runs, and the key, title and unit of each chart."""

    runs: Sequence[RunCurves]
    charts: list[tuple[str, str, str]]


def viewer_data(runs: Sequence[RunCurves]) -> ViewerData:
    """Return what a page needs to show runs on one time axis."""
    return {"runs": runs, "charts": [(key, title, unit) for key, (title, unit) in CHARTS.items()]}


def run_curves(run: RunData, name: str, colour: str = "", share: float = 1.0) -> RunCurves:
    """Return the curves of a run.

    Args:
        run: The run.
        name: What it is called on the page.
        colour: As CSS has it; empty where curves have colours of their own.
        share: Part of the points of a page that the run may take.
    """
    ways = {"encoders": run.encoders, "truth": run.truth, "estimate": run.estimate}
    tracks = {key: track for key, track in ways.items() if track is not None}
    charts = {key: list(drawn) for key, drawn in _charts(run, tracks)}
    count = sum(map(len, charts.values())) + 2 * len(tracks)
    bins = max(FEWEST_BINS, int(share * MOST_POINTS / count / 2))
    end = "the log was cut off" if run.end is None else run.end["reason"]
    return {
        "name": name,
        "colour": colour,
        "words": f"{end}, {run.duration_s:.1f} s",
        "duration_s": float(run.cycles.t_s[-1]),
        "paths": [_way(key, track, 2 * bins) for key, track in tracks.items()],
        "charts": {
            key: [_curve(title, series, bins) for title, series in curves]
            for key, curves in charts.items()
            if curves
        },
        "mission": _corners(run.config.mission),
        "area": [] if run.config.safety.area is None else list(run.config.safety.area.outline()),
        "stops": [(stop.start_s, stop.end_s) for stop in summarise(run).stops],
    }


def _charts(
    run: RunData, tracks: dict[str, Track]
) -> Iterator[tuple[str, Iterator[tuple[str, Series]] | Sequence[tuple[str, Series]]]]:
    if run.truth is not None:
        truth = run.truth
        yield (
            "error",
            [(key, _scaled(position_error_m(tracks[key], truth), 1e3)) for key in ("encoders", "estimate")],
        )
    if "cross_track_m" in run.computed:
        yield "beside", [("estimate", _scaled(run.computed["cross_track_m"], 1e3))]
    yaws = {key: Series(track.t_s, track.yaw_rad) for key, track in tracks.items() if track.has_yaw}
    gyro = {} if run.gyro is None else {"gyro": run.gyro}
    headings = {**run.headings, **gyro, **yaws}
    yield "headings", [(key, _scaled(series, float(np.degrees(1.0)))) for key, series in headings.items()]
    yield "slip", [(key, _scaled(series, 100.0)) for key, series in _slips(run)]
    yield "currents", [(wheel.name, wheel.current) for wheel in run.wheels if wheel.current is not None]
    yield "speeds", _speeds(run)
    yield "cycles", [("work", Series(run.cycles.t_s, run.cycles.work_us / 1e3))]


def _slips(run: RunData) -> Iterator[tuple[str, Series]]:
    """Yield slip as estimated, where it is valid, and in truth."""
    if run.drift is not None:
        yield "rover", _where_valid(run.drift.slip, run.drift.reasons)
        if run.drift.true_slip is not None:
            yield "truth", run.drift.true_slip
    elif run.slip is not None:
        for wheel, estimated in zip(run.wheels, run.slip.wheels, strict=True):
            yield wheel.name, _where_valid(estimated.slip, estimated.reasons)
            if wheel.slip is not None:
                yield f"{wheel.name}, truth", wheel.slip


def _where_valid(slip: Series, reasons: Sequence[str]) -> Series:
    if len(reasons) != len(slip.t_s):
        return Series(slip.t_s[:0], slip.value[:0])  # which of them are valid is not known
    return Series(slip.t_s, np.where([not reason for reason in reasons], slip.value, np.nan))


def _speeds(run: RunData) -> Iterator[tuple[str, Series]]:
    for wheel in run.wheels:
        if wheel.speed is not None:
            yield wheel.name, wheel.speed
        if wheel.set_point is not None:
            yield f"{wheel.name}, setpoint", wheel.set_point


def _scaled(series: Series, factor: float) -> Series:
    return Series(series.t_s, factor * series.value)


def _way(name: str, track: Track, points: int) -> Way:
    every = max(1, len(track.t_s) // points)
    kept = np.append(np.arange(0, len(track.t_s), every), len(track.t_s) - 1)
    return {
        "name": name,
        "t": _rounded(track.t_s[kept], TIME_DECIMALS),
        "x": _rounded(track.x_m[kept], PLACE_DECIMALS),
        "y": _rounded(track.y_m[kept], PLACE_DECIMALS),
    }


def _curve(name: str, series: Series, bins: int) -> Curve:
    shown = with_gaps(thin(series, bins))
    values = [float(f"{value:.{DIGITS}g}") if isfinite(value) else None for value in shown.value.tolist()]
    return {"name": name, "x": _rounded(shown.t_s, TIME_DECIMALS), "y": values}


def _rounded(values: Array, decimals: int) -> list[float]:
    rounded: list[float] = np.round(values, decimals).tolist()
    return rounded


def _corners(mission: MissionSettings | None) -> list[tuple[float, float]]:
    return list(mission.corners()) if mission is not None and mission.has_path else []
