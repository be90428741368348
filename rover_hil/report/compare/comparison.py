"""Runs side by side: figures, differences of their configurations, and all paths in one picture."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.report.curves import run_curves, viewer_data
from rover_hil.report.figures import run_plots
from rover_hil.report.read_run import read_run
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary, position_error_m, summarise
from rover_hil.report.tracks import Series
from rover_hil.report.verdict import length

COLOURS = ("#3b82f6", "#e8890c", "#16a37b", "#a855f7", "#db4f9e", "#8f9d0a")
"""To be seen on white and on black."""
MOST_RUNS = len(COLOURS)
PATH_HEIGHT_IN = 5.0
SHOWN_CHARACTERS = 60
TRUTH_STYLE = (0, (2, 2))


@dataclass(frozen=True, slots=True)
class Run:
    """A run of the comparison, under the name that it has there."""

    name: str
    colour: str
    data: RunData
    summary: Summary


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a table: what it is, and its value in each run."""

    name: str
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Runs side by side: figures, and keys of the configuration that are not the same in all."""

    runs: tuple[Run, ...]
    figures: tuple[Row, ...]
    settings: tuple[Row, ...]


def compare_runs(paths: Sequence[Path]) -> Comparison:
    """Return the comparison of the logs at `paths`, two to `MOST_RUNS` of them.

    Raises:
        LogError: A log cannot be read, or holds no complete cycle.
    """
    runs = []
    for path, name, colour in zip(paths, _names(paths), COLOURS, strict=False):
        data = read_run(path)
        runs.append(Run(name, colour, data, summarise(data)))
    return Comparison(tuple(runs), tuple(_figures(runs)), tuple(_differences(runs)))


def render_comparison(comparison: Comparison) -> str:
    """Return the page, which needs nothing else."""
    runs = comparison.runs
    drawings = (
        Drawing(
            "Path",
            "See where the paths part: estimates as lines, the truth of each run dotted in its colour.",
            lambda: _draw_path(runs),
        ),
        Drawing(
            "Distance of the estimate from the truth",
            "See which run goes wrong, and when: a step is a single event, a slope is steady slip.",
            lambda: _draw_series(runs, _error, "off the truth (mm)"),
        ),
        Drawing(
            "Yaw of the estimate",
            "See which run turns otherwise; runs of the same mission should lie on each other.",
            lambda: _draw_series(runs, _yaw, "yaw (deg)"),
        ),
        Drawing(
            "Slip of the rover as estimated",
            "See where the wheels turned for nothing; mean of the wheels.",
            lambda: _draw_series(runs, _slip, "slip (%)"),
        ),
    )
    share = 1.0 / len(runs)
    return render(
        "report/compare/compare.html",
        comparison=comparison,
        grade="plain",
        viewer=viewer_data([run_curves(run.data, run.name, run.colour, share) for run in runs]),
        pictures=draw_pictures(drawings),
    )


def _names(paths: Sequence[Path]) -> list[str]:
    """Return short names: as many parts of the paths as distinguish them."""
    for count in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.with_suffix("").parts[-count:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    return [f"{index}: {path}" for index, path in enumerate(paths, start=1)]


_FIGURES: tuple[tuple[str, Callable[[Summary], str | None]], ...] = (
    ("how it ended", lambda run: run.reason or None),
    ("duration", lambda run: f"{run.duration_s:.1f} s"),
    ("safety stops", lambda run: str(len(run.stops))),
    ("distance by the wheels", lambda run: length(run.distance_encoders_m)),
    ("true distance", lambda run: _of(run.distance_truth_m, length)),
    ("slip", lambda run: _of(run.slip_ratio, lambda slip: f"{slip:.1%}")),
    (
        "estimate off the truth, rms",
        lambda run: None if run.estimate_error is None else length(run.estimate_error.position_rms_m),
    ),
    (
        "at the end",
        lambda run: None if run.estimate_error is None else length(run.estimate_error.position_final_m),
    ),
    (
        "yaw off the truth, rms",
        lambda run: None if run.estimate_error is None else _of(run.estimate_error.yaw_rms_rad, _degrees),
    ),
    (
        "wheels off the truth, rms",
        lambda run: None if run.encoders_error is None else length(run.encoders_error.position_rms_m),
    ),
    ("estimate off the path, rms", lambda run: _of(run.cross_track_rms_m, length)),
    ("work of a cycle, median", lambda run: None if run.work is None else f"{run.work.p50_us:.0f} us"),
)


def _of(value: float | None, text: Callable[[float], str]) -> str | None:
    return None if value is None else text(value)


def _degrees(angle_rad: float) -> str:
    return f"{np.degrees(angle_rad):.2f} deg"


def _figures(runs: Sequence[Run]) -> Iterator[Row]:
    for name, text in _FIGURES:
        values = [text(run.summary) for run in runs]
        if any(value is not None for value in values):
            yield Row(name, tuple(value or "-" for value in values))


def _differences(runs: Sequence[Run]) -> Iterator[Row]:
    settings = [dict(_flat(json.loads(run.data.config_json), "")) for run in runs]
    for key in dict.fromkeys(key for table in settings for key in table):
        values = [table.get(key, "-") for table in settings]
        if len(set(values)) > 1:
            yield Row(key, tuple(_short(value) for value in values))


def _flat(value: object, name: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _flat(inner, f"{name}.{key}" if name else key)
    elif value is not None:
        yield name, value if isinstance(value, str) else json.dumps(value)


def _short(value: str) -> str:
    return value if len(value) <= SHOWN_CHARACTERS else f"{value[:SHOWN_CHARACTERS]}..."


def _draw_path(runs: Sequence[Run]) -> Figure:
    figure = Figure(figsize=(style.WIDTH_IN, PATH_HEIGHT_IN), layout="constrained")
    axes = figure.add_subplot(aspect="equal", adjustable="datalim", xlabel="x (m)", ylabel="y (m)")
    for run in runs:
        track, truth = run.data.estimate, run.data.truth
        axes.plot(track.x_m, track.y_m, color=run.colour, label=run.name)
        if truth is not None:
            axes.plot(truth.x_m, truth.y_m, color=run.colour, linestyle=TRUTH_STYLE)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def _draw_series(
    runs: Sequence[Run], series: Callable[[RunData], Series | None], label: str
) -> Figure | None:
    drawn = [(run, values) for run in runs if (values := series(run.data)) is not None]
    if not drawn:
        return None
    figure, (axes,) = run_plots.rows(1, 2.4)
    for run, values in drawn:
        run_plots.line(axes, values, run.colour, run.name)
    axes.set_ylabel(label)
    axes.set_xlim(0, max(run.data.duration_s for run in runs) or None)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return figure


def _error(run: RunData) -> Series | None:
    if run.truth is None:
        return None
    error = position_error_m(run.estimate, run.truth)
    return Series(error.t_s, 1e3 * error.value)


def _yaw(run: RunData) -> Series:
    return Series(run.estimate.t_s, np.degrees(run.estimate.yaw_rad))


def _slip(run: RunData) -> Series | None:
    if run.slip is None or not run.slip.wheels:
        return None
    wheels = [wheel.slip for wheel in run.slip.wheels]
    if len({len(wheel.t_s) for wheel in wheels}) > 1:
        return None
    return Series(wheels[0].t_s, 100 * np.mean([wheel.value for wheel in wheels], axis=0))
