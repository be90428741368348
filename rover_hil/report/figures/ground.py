"""Picture of the slip that a camera measured over the ground."""

from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.report.figures import run_plots
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary
from rover_hil.report.thinning import visible_spans
from rover_hil.report.tracks import Series, slip_over_time

HEIGHT_IN = 2.2
DEVIATIONS = 2.0


def draw_ground_slip(run: RunData, summary: Summary) -> Figure | None:
    """Draw the measured slip with two standard deviations, the truth, and where it was not measured."""
    ground = run.ground
    if ground is None:
        return None
    figure, (axes,) = run_plots.rows(1, HEIGHT_IN)
    axes.set_title("slip over the ground (%)")
    if run.truth is not None:
        true = slip_over_time(run.encoders, run.truth)
        run_plots.line(axes, Series(true.t_s, 100.0 * true.value), style.TRUTH, "truth")
    percent, spread = 100.0 * ground.slip.value, 100.0 * DEVIATIONS * ground.slip_sd
    run_plots.line(axes, Series(ground.slip.t_s, percent), style.ESTIMATE, "measured")
    axes.fill_between(
        ground.slip.t_s,
        percent - spread,
        percent + spread,
        color=style.pale(style.ESTIMATE),
        linewidth=0,
        zorder=0.6,
        label="two standard deviations",
    )
    labels = ["not measured" if reason else "" for reason in ground.reasons]
    for index, (start_s, end_s) in enumerate(visible_spans(ground.slip.t_s, labels)):
        label = "not measured" if index == 0 else None
        axes.axvspan(start_s, end_s, color=style.NOT_VALID, linewidth=0, zorder=0.4, label=label)
    run_plots.finish(figure, [axes], run, summary)
    return figure
