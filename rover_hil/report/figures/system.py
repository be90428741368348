"""Pictures of how the system fared: time-line, innovations, timing."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from controllers.motion.limits import Limit
from controllers.safety import Mode
from rover_hil.pages import style
from rover_hil.report.figures import run_plots
from rover_hil.report.run_data import InnovationData, RunData
from rover_hil.report.summary import Summary
from rover_hil.report.thinning import visible_spans, with_gaps
from rover_hil.report.tracks import Series, spans
from rover_hil.report.verdict import time_text

MODE_COLOURS = {
    Mode.OBSERVING: "#c7d2e0",
    Mode.SETTLING: "#e5e7eb",
    Mode.RUNNING: "#9fd8b4",
    Mode.PAUSED: "#fbe8c8",
    Mode.FINISHED: "#a9c9f5",
    Mode.SAFE_STOP: "#ef8a8a",
    Mode.EMERGENCY_STOP: "#c81e1e",
}
BAND_SIGMAS = 2.0
BIN_COUNT = 60
SHORTEST_S = 1e-6
ANGLE = ("deg", math.degrees(1.0))
RESIDUAL_UNITS = {
    "standstill": ("deg/s", math.degrees(1.0)),
    **dict.fromkeys(("x", "y", "forward", "left"), ("mm", 1e3)),
}
"""Unit of the residual of a quantity that is no angle, and how many of it are one of SI."""


def draw_timeline(run: RunData, summary: Summary) -> Figure:
    """Draw what the controller did over time, and what went wrong with links and watchdog."""
    cycles = run.cycles
    names = ["mode", "setpoints limited", *(f"link to {device}" for device in run.config.devices)]
    names += ["watchdog"] if run.watchdog_s else []
    figure, (axes,) = run_plots.rows(1, 0.32 * len(names) + 0.6)
    labelled: set[str] = set()
    for start_s, end_s, mode in spans(cycles.t_s, cycles.mode):
        label = None if mode in labelled else mode.replace("_", " ")
        labelled.add(mode)
        _draw_bar(axes, 0, start_s, end_s, MODE_COLOURS[Mode(mode)], label)
    limited = ["limited" if limit != Limit.NONE else "" for limit in cycles.limit]
    for start_s, end_s in visible_spans(cycles.t_s, limited):
        _draw_bar(axes, 1, start_s, end_s, style.COMMANDED)
    for row, device in enumerate(run.config.devices, start=2):
        _draw_link(axes, row, device, run)
    for t_s in run.watchdog_s:
        axes.plot(t_s, len(names) - 1, "v", color=style.ALARM)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    run_plots.span(axes, run)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


def draw_innovations(run: RunData, summary: Summary) -> Figure | None:
    """Draw what each measurement said against the estimate, within the band that the filter expects."""
    if not run.innovations:
        return None
    figure, plots = run_plots.rows(len(run.innovations), 1.8)
    for axes, (measured, data) in zip(plots, run.innovations.items(), strict=True):
        unit, factor = RESIDUAL_UNITS.get(measured.quantity, ANGLE)
        axes.set_title(str(measured))
        _draw_innovation(axes, data, factor)
        axes.set_ylabel(f"residual ({unit})")
    run_plots.finish(figure, plots, run, summary)
    return figure


def draw_timing(run: RunData, summary: Summary) -> Figure | None:
    """Draw how late cycles began and how long they took, against the period."""
    if summary.lateness is None or summary.work is None:
        return None
    period_s = 1.0 / run.config.loop.rate_hz
    longest_s = max(period_s, 1e-6 * summary.lateness.max_us, 1e-6 * summary.work.max_us)
    times_us = np.concatenate((run.cycles.late_us, run.cycles.work_us))
    shortest_s = max(SHORTEST_S, 0.5e-6 * float(times_us[times_us > 0.0].min()))
    bins = np.geomspace(shortest_s, 2.0 * longest_s, BIN_COUNT).tolist()
    figure = Figure(figsize=(style.WIDTH_IN, 2.9), layout="constrained")
    axes = figure.add_subplot(xscale="log", yscale="log", xlabel="time", ylabel="cycles")
    axes.xaxis.set_major_formatter(EngFormatter("s"))
    axes.yaxis.set_major_formatter("{x:.0f}")
    for time_us, spread, colour, name in (
        (run.cycles.late_us, summary.lateness, style.COMMANDED, "late"),
        (run.cycles.work_us, summary.work, style.MEASURED, "work"),
    ):
        label = f"{name}: half below {time_text(spread.p50_us)}, 99 % below {time_text(spread.p99_us)}"
        if spread.max_us == 0.0:
            label = f"{name}: never, as in all simulated time"
        shown_s = np.maximum(1e-6 * time_us[time_us > 0.0], shortest_s)
        axes.hist(shown_s, bins, color=colour, alpha=0.75, label=label)
    axes.axvline(period_s, color=style.ALARM, linestyle="--", label=f"period {time_text(1e6 * period_s)}")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=1)
    return figure


def _draw_bar(
    axes: Axes, row: int, start_s: float, end_s: float, colour: str, label: str | None = None
) -> None:
    axes.barh(row, end_s - start_s, 0.7, start_s, color=colour, label=label)


def _draw_link(axes: Axes, row: int, device: str, run: RunData) -> None:
    changes = [event for event in run.link_events if event.device == device]
    times_s = [0.0, *(event.t_s for event in changes), float(run.cycles.t_s[-1])]
    states = [True, *(event.up for event in changes)]
    for start_s, end_s, up in zip(times_s[:-1], times_s[1:], states, strict=True):
        _draw_bar(axes, row, start_s, end_s, "#d9efe1" if up else style.ALARM)


def _draw_innovation(axes: Axes, data: InnovationData, factor: float) -> None:
    residual, band = factor * data.residual, BAND_SIGMAS * factor * data.deviation
    accepted = data.is_accepted > 0
    # The first bands may be as wide as ignorance is; they must not flatten the rest.
    limit = 1.3 * max(float(np.quantile(np.abs(residual), 0.98)), float(np.median(band)))
    filled = with_gaps(Series(data.t_s, band))
    axes.fill_between(filled.t_s, -filled.value, filled.value, color=style.ESTIMATE, alpha=0.15, linewidth=0)
    axes.plot(data.t_s[accepted], residual[accepted], ".", color=style.ESTIMATE, markersize=4)
    if not accepted.all():
        clipped = np.clip(residual[~accepted], -0.95 * limit, 0.95 * limit)
        axes.plot(data.t_s[~accepted], clipped, "x", color=style.ALARM, label="refused")
    axes.set_ylim(-limit, limit)
