"""Pictures of slip: the estimate and the truth, and the effort that the estimate is made from."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.report.figures import run_plots
from rover_hil.report.figures.wheels import ROW_HEIGHT_IN
from rover_hil.report.run_data import EstimatedSlip, RunData, SlipData, WheelData
from rover_hil.report.summary import Summary
from rover_hil.report.thinning import visible_spans
from rover_hil.report.tracks import Series, running_mean, slip_over_time, spans

TURNING_SHARE = 0.05
STRIP_HEIGHT_IN = 0.45
STRIP_COLOURS = ("#dbeafe", "#d1fae5", "#ede9fe", "#fce7f3", "#fef9c3", "#e0f2fe")
LEAST_LABEL_SHARE = 0.08


def draw_slip(run: RunData, summary: Summary) -> Figure | None:
    """Draw the slip of each wheel: the truth, the estimate, and where it was not valid.

    Where only the true pose is known, the true slip is that of the whole rover. Below is the surface that was
    recognised.
    """
    true = {wheel.name: slip for wheel in run.wheels if (slip := _slip_while_turning(wheel)) is not None}
    if not true and run.truth is not None:
        true = {"whole rover": slip_over_time(run.encoders, run.truth)}
    estimated = {} if run.slip is None else dict(zip(_names(run), run.slip.wheels, strict=True))
    names = list(dict.fromkeys((*estimated, *true)))
    if not names:
        return None
    with_strip = run.slip is not None and any(run.slip.surfaces)
    figure, plots, strip = _rows(len(names), with_strip=with_strip)
    for axes, name in zip(plots, names, strict=True):
        axes.set_title(name)
        if name in true:
            _draw_true(axes, true[name])
        if name in estimated:
            _draw_estimate(axes, estimated[name])
    if strip is not None and run.slip is not None:
        _draw_surfaces(strip, run.slip)
    _share_labels(plots)
    run_plots.finish(figure, [*plots, *([] if strip is None else [strip])], run, summary)
    return figure


def draw_effort(run: RunData, summary: Summary) -> Figure | None:
    """Draw torque at each wheel, and M of the paper at the same place."""
    if run.slip is None or run.config.slip is None:
        return None
    gear_ratio = run.config.slip.maps.motor.gear_ratio
    figure, plots = run_plots.rows(len(run.slip.wheels), ROW_HEIGHT_IN, "torque at the wheel (N m)")
    for axes, name, estimated in zip(plots, _names(run), run.slip.wheels, strict=True):
        axes.set_title(name)
        m_nm = Series(estimated.paper_torque_nm.t_s, gear_ratio * estimated.paper_torque_nm.value)
        run_plots.line(axes, m_nm, style.COMMANDED, "M x gear ratio", 1.0)
        run_plots.line(axes, estimated.wheel_torque_nm, style.MEASURED, "tau_w")
    run_plots.finish(figure, plots, run, summary)
    return figure


def _names(run: RunData) -> list[str]:
    return [wheel.name for wheel in run.wheels]


def _rows(count: int, *, with_strip: bool) -> tuple[Figure, list[Axes], Axes | None]:
    """Return a figure of `count` plots on one scale, and a strip below them."""
    heights = [ROW_HEIGHT_IN] * count + [STRIP_HEIGHT_IN] * with_strip
    figure = Figure(figsize=(style.WIDTH_IN, sum(heights) + 0.6), layout="constrained")
    grid = figure.subplots(len(heights), sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    grid[-1].set_xlabel("time since start (s)")
    figure.supylabel("slip (%)", fontsize="medium", color="#374151")
    plots = list(grid[:count])
    for axes in plots[1:]:
        axes.sharey(plots[0])
    return figure, plots, grid[-1] if with_strip else None


def _draw_true(axes: Axes, slip: Series) -> None:
    shown = Series(slip.t_s, 100.0 * slip.value)
    run_plots.line(axes, shown, style.pale(style.TRUTH), "truth, unsmoothed", 0.8)
    run_plots.line(axes, running_mean(shown), style.TRUTH, "truth, smoothed")


def _draw_estimate(axes: Axes, estimated: EstimatedSlip) -> None:
    run_plots.line(axes, Series(estimated.slip.t_s, 100.0 * estimated.slip.value), style.ESTIMATE, "estimate")
    labels = ["not valid" if reason else "" for reason in estimated.reasons]
    for start_s, end_s in visible_spans(estimated.slip.t_s, labels):
        axes.axvspan(start_s, end_s, color=style.NOT_VALID, linewidth=0, zorder=0.4, label="not valid")


def _draw_surfaces(axes: Axes, slip: SlipData) -> None:
    """Draw which surface was recognised when."""
    axes.set(yticks=[], ylim=(0.0, 1.0))
    axes.set_title("surface by drive force")
    names = [name for name in dict.fromkeys(slip.surfaces) if name]
    length_s = float(slip.t_s[-1] - slip.t_s[0])
    for start_s, end_s, name in spans(slip.t_s, slip.surfaces):
        if not name:
            continue
        colour = STRIP_COLOURS[names.index(name) % len(STRIP_COLOURS)]
        axes.axvspan(start_s, end_s, color=colour, linewidth=0)
        if end_s - start_s > LEAST_LABEL_SHARE * length_s:
            text = name.removesuffix("_surface")
            axes.text(0.5 * (start_s + end_s), 0.5, text, ha="center", va="center", fontsize=9, clip_on=True)


def _share_labels(plots: list[Axes]) -> None:
    """Keep each label once, on the first plot: the legend is made from that one."""
    seen: set[str] = set()
    for axes in plots:
        for artist in (*axes.lines, *axes.patches):
            label = str(artist.get_label())
            if label in seen:
                artist.set_label("_nolegend_")
            seen.add(label)


def _slip_while_turning(wheel: WheelData) -> Series | None:
    """Return the slip with NaN where the wheel hardly turns: a ratio of two small speeds is meaningless."""
    slip, speed = wheel.slip, wheel.true_speed
    if slip is None or speed is None:
        return None
    speed_rad_s = np.abs(np.interp(slip.t_s, speed.t_s, speed.value))
    turns = speed_rad_s > TURNING_SHARE * speed_rad_s.max()
    return Series(slip.t_s, np.where(turns, slip.value, np.nan))
