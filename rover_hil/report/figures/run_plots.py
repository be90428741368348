"""Plots over the time of a run."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_hil.pages.style import STOPPED, WIDTH_IN
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary
from rover_hil.report.thinning import thin, with_gaps
from rover_hil.report.tracks import Series


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
