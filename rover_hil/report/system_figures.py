"""Pictures of how the system fared: time-line, innovations, timing."""

import numpy as np
from matplotlib.figure import Figure

from controllers.limits import Limit
from controllers.safety import Mode
from rover_hil.report import style
from rover_hil.report.run_data import InnovationData, RunData
from rover_hil.report.summary import Summary
from rover_hil.report.tracks import spans
from rover_hil.report.verdict import time_text

MODE_COLOURS = {
    Mode.OBSERVING: "#c7d2e0",
    Mode.SETTLING: "#e5e7eb",
    Mode.RUNNING: "#9fd8b4",
    Mode.FINISHED: "#a9c9f5",
    Mode.SAFE_STOP: "#ef8a8a",
    Mode.EMERGENCY_STOP: "#c81e1e",
}
BIN_COUNT = 60
SHORTEST_US = 1.0


def draw_timeline(run: RunData, summary: Summary) -> Figure:
    """Draw what the controller did over time, and what went wrong with links and watchdog."""
    cycles = run.cycles
    devices = tuple(run.config.devices)
    names = ("mode", "limited", *devices, *(("watchdog",) if run.watchdog_s else ()))
    figure, (axes,) = style.rows(1, 0.34 * len(names) + 0.7)
    seen: set[str] = set()
    for start_s, end_s, mode in spans(cycles.t_s, cycles.mode):
        label = mode.replace("_", " ") if mode not in seen else None
        seen.add(mode)
        axes.barh(0, end_s - start_s, 0.8, start_s, color=MODE_COLOURS[Mode(mode)], label=label)
    for start_s, end_s, limit in spans(cycles.t_s, cycles.limit):
        if limit != Limit.NONE:
            axes.barh(1, end_s - start_s, 0.5, start_s, color=style.COMMANDED)
    for row, device in enumerate(devices, start=2):
        _draw_link(axes, row, device, run)
    for t_s in run.watchdog_s:
        axes.plot(t_s, len(names) - 1, "v", color=style.ALARM)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.set_xlim(0, max(run.duration_s, float(cycles.t_s[-1])))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=6)
    return figure
