"""Pictures of what the wheels did: motor currents, speeds."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.report.figures import run_plots
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary
from rover_hil.report.tracks import MEAN_WINDOW_S, Series, running_mean

ROW_HEIGHT_IN = 1.15


def draw_currents(run: RunData, summary: Summary) -> Figure | None:
    """Draw the motor current of each wheel."""
    currents = {wheel.name: wheel.current for wheel in run.wheels if wheel.current is not None}
    return _draw_with_means(currents, style.MEASURED, "current (A)", run, summary)


def draw_speeds(run: RunData, summary: Summary) -> Figure | None:
    """Draw setpoint and measured speed of each wheel."""
    wheels = [wheel for wheel in run.wheels if wheel.speed is not None]
    if not wheels:
        return None
    figure, plots = run_plots.rows(len(wheels), ROW_HEIGHT_IN, "speed (rad/s)")
    for axes, wheel in zip(plots, wheels, strict=True):
        axes.set_title(wheel.name)
        if wheel.set_point is not None:
            run_plots.line(axes, wheel.set_point, style.pale(style.COMMANDED), "setpoint", 4.0)
        if wheel.speed is not None:
            run_plots.line(axes, wheel.speed, style.MEASURED, "measured")
    run_plots.finish(figure, plots, run, summary)
    return figure


def _draw_with_means(
    values: Mapping[str, Series], colour: str, label: str, run: RunData, summary: Summary
) -> Figure | None:
    if not values:
        return None
    figure, plots = run_plots.rows(len(values), ROW_HEIGHT_IN, label)
    for axes, (name, series) in zip(plots, values.items(), strict=True):
        axes.set_title(name)
        run_plots.line(axes, series, style.pale(colour), "unsmoothed", 0.8)
        run_plots.line(axes, running_mean(series), colour, f"mean over {MEAN_WINDOW_S:g} s")
    run_plots.finish(figure, plots, run, summary)
    return figure
