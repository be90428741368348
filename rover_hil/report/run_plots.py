"""Plots over the time of a run."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_hil.pages.style import STOPPED, WIDTH_IN
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary
from rover_hil.report.tracks import Series

THIN_BINS = 400
GAP_FACTOR = 10.0


def rows(count: int, row_height_in: float, label: str = "") -> tuple[Figure, list[Axes]]:
    """Return a figure of `count` plots below each other, over the same time and on the same scale."""
    figure = Figure(figsize=(WIDTH_IN, row_height_in * count + 0.6), layout="constrained")
    plots = list(figure.subplots(count, sharex=True, sharey=count > 1 and bool(label), squeeze=False)[:, 0])
    plots[-1].set_xlabel("time since start (s)")
    if label:
        figure.supylabel(label, fontsize="medium", color="#374151")
    return figure, plots


def line(axes: Axes, series: Series, colour: str, label: str, width: float = 1.6) -> None:
    """Draw values over time; of a long series only what can be seen."""
    seen = with_gaps(thin(series))
    axes.plot(seen.t_s, seen.value, color=colour, label=label, linewidth=width)


def span(axes: Axes, run: RunData) -> None:
    """Show the whole run; a log of a single cycle has no length to show."""
    axes.set_xlim(0, float(run.cycles.t_s[-1]) or None)


def finish(figure: Figure, plots: Sequence[Axes], run: RunData, summary: Summary) -> None:
    """Shade the safety stops, span the whole run, and label both above."""
    for axes in plots:
        for index, stop in enumerate(summary.stops):
            label = "safety stop" if index == 0 else None
            axes.axvspan(stop.start_s, stop.end_s, color=STOPPED, linewidth=0, zorder=0.5, label=label)
        span(axes, run)
    handles, labels = plots[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=3)


def with_gaps(series: Series) -> Series:
    """Return the series with NaN where nothing was received for long, so that no line is drawn there."""
    steps_s = np.diff(series.t_s)
    if not steps_s.any():
        return series
    # Poses repeat their time in every cycle without new wheel positions.
    gaps = np.flatnonzero(steps_s > GAP_FACTOR * np.median(steps_s[steps_s > 0.0])) + 1
    return Series(np.insert(series.t_s, gaps, series.t_s[gaps]), np.insert(series.value, gaps, np.nan))


def thin(series: Series) -> Series:
    """Return the lowest and the highest value of each of `THIN_BINS` bins, so that no peak gets lost."""
    size = len(series.t_s) // THIN_BINS
    if size <= 2:
        return series
    count = len(series.t_s) // size
    blocks = series.value[: count * size].reshape(count, size)
    lowest = np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1)
    highest = np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1)
    first = np.arange(count) * size
    rest = np.arange(count * size, len(series.t_s))
    kept = np.unique(np.concatenate((first + lowest, first + highest, rest)))
    return Series(series.t_s[kept], series.value[kept])
