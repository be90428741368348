"""Picture of how the whole rover slipped: estimates from trace and tilt, and the truth."""

import math

from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.report.figures import run_plots
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary
from rover_hil.report.thinning import visible_spans
from rover_hil.report.tracks import Series

ROW_HEIGHT_IN = 1.8


def draw_drift(run: RunData, summary: Summary) -> Figure | None:
    """Draw slip and slip angle: the truth, the estimate, and where it was not sure."""
    drift = run.drift
    if drift is None:
        return None
    figure, plots = run_plots.rows(2, ROW_HEIGHT_IN)
    slip, angle = plots
    slip.set_title("slip (%)")
    angle.set_title("slip angle (deg)")
    if drift.true_slip is not None and drift.true_angle is not None:
        run_plots.line(slip, _scaled(drift.true_slip, 100.0), style.TRUTH, "truth")
        run_plots.line(angle, _scaled(drift.true_angle, math.degrees(1.0)), style.TRUTH, "_nolegend_")
    run_plots.line(slip, _scaled(drift.slip, 100.0), style.ESTIMATE, "estimate")
    run_plots.line(angle, _scaled(drift.angle, math.degrees(1.0)), style.ESTIMATE, "_nolegend_")
    labels = ["not sure" if reason else "" for reason in drift.reasons]
    for index, (start_s, end_s) in enumerate(visible_spans(drift.slip.t_s, labels)):
        for axes in plots:
            label = "not sure" if index == 0 else None
            axes.axvspan(start_s, end_s, color=style.NOT_VALID, linewidth=0, zorder=0.4, label=label)
    run_plots.finish(figure, plots, run, summary)
    return figure


def _scaled(series: Series, factor: float) -> Series:
    return Series(series.t_s, factor * series.value)
