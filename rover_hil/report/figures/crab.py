"""Picture of how a rover that crabs turned its wheels, and how well it kept its line."""

import math

from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.report.figures import run_plots
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary
from rover_hil.report.tracks import Series, spans

ROW_HEIGHT_IN = 1.8
BEST_SOURCE = "trace"


def draw_crab(run: RunData, summary: Summary) -> Figure | None:
    """Draw steering and slip angle of the wheels, and the distance from the line."""
    crab = run.crab
    if crab is None:
        return None
    figure, plots = run_plots.rows(2, ROW_HEIGHT_IN)
    angles, distance = plots
    angles.set_title("angles of the wheels (deg)")
    distance.set_title("to the left of the line (mm)")
    run_plots.line(angles, _scaled(crab.set_point, math.degrees(1.0)), style.COMMANDED, "commanded")
    run_plots.line(angles, _scaled(crab.steering, math.degrees(1.0)), style.MEASURED, "measured")
    run_plots.line(angles, _scaled(crab.drift, math.degrees(1.0)), style.ESTIMATE, "slip angle, estimate")
    if crab.true_left_of_line is not None:
        run_plots.line(distance, _scaled(crab.true_left_of_line, 1e3), style.TRUTH, "truth")
    cross_track = run.computed.get("cross_track_m")
    if cross_track is not None:
        run_plots.line(distance, _scaled(cross_track, 1e3), style.ESTIMATE, "_nolegend_")
    labels = ["" if source == BEST_SOURCE else source for source in crab.sources]
    others = [(start_s, end_s) for start_s, end_s, label in spans(crab.drift.t_s, labels) if label]
    for index, (start_s, end_s) in enumerate(others):
        label = "slip angle without a trace" if index == 0 else None
        angles.axvspan(start_s, end_s, color=style.NOT_VALID, linewidth=0, zorder=0.4, label=label)
    run_plots.finish(figure, plots, run, summary)
    handles, names = distance.get_legend_handles_labels()
    if handles:
        distance.legend(handles, names, loc="best")
    return figure


def _scaled(series: Series, factor: float) -> Series:
    return Series(series.t_s, factor * series.value)
