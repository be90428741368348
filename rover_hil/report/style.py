"""How the pictures of a report look: one colour per source, everywhere."""

import base64
import io
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_hil.report.tracks import Array, Series

COMMANDED = "#8a94a6"
TRUTH = "#111827"
ESTIMATE = "#0b63ce"
ENCODERS = "#e07a00"
GYRO = "#9b4dca"
HEADINGS = ("#0f8a5f", "#7a8b00")
MEASURED = "#0f7f9c"
STOPPED = "#f6c6c6"
ALARM = "#c81e1e"

WIDTH_IN = 7.2
THIN_BINS = 600

STYLE = {
    "font.size": 10.5,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.labelcolor": "#374151",
    "axes.edgecolor": "#9ca3af",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e5e7eb",
    "grid.linewidth": 0.8,
    "xtick.color": "#4b5563",
    "ytick.color": "#4b5563",
    "lines.linewidth": 1.6,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "svg.hashsalt": "rover_hil",
}


def data_uri(figure: Figure) -> str:
    """Return a figure as an SVG picture inside an address; the same figure gives the same text."""
    stream = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(stream.getvalue()).decode()


def rows(count: int, row_height_in: float) -> tuple[Figure, list[Axes]]:
    """Return a figure of `count` plots below each other, over the same time."""
    figure = Figure(figsize=(WIDTH_IN, row_height_in * count + 0.5), layout="constrained")
    axes = figure.subplots(count, sharex=True, squeeze=False)[:, 0]
    axes[-1].set_xlabel("time since start (s)")
    return figure, list(axes)


def line(axes: Axes, t_s: Array, value: Array, colour: str, label: str, width: float = 1.6) -> None:
    """Draw values over time; of a long series only what can be seen."""
    seen = thin(Series(t_s, value))
    axes.plot(seen.t_s, seen.value, color=colour, label=label, linewidth=width)


def shade(axes: Sequence[Axes], stops: Sequence[tuple[float, float]]) -> None:
    """Shade the safety stops."""
    for part in axes:
        for index, (start_s, end_s) in enumerate(stops):
            label = "safety stop" if index == 0 else None
            part.axvspan(start_s, end_s, color=STOPPED, linewidth=0, zorder=0.5, label=label)


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
