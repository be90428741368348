"""Pictures of where the rover was: path, distance from the truth, headings."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from controllers.safety.position_region import CHI_SQUARE
from rover_hil.pages import style
from rover_hil.report.figures import run_plots
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary, TrackError, position_error_m
from rover_hil.report.thinning import THIN_BINS
from rover_hil.report.tracks import Series, Track
from rover_hil.report.verdict import length

ELLIPSES = 10
PATH_HEIGHT_IN = (3.4, 6.6)
# So that lines that coincide can all be seen.
WIDE, MIDDLE, NARROW = 3.0, 2.0, 1.3


def draw_path(run: RunData, summary: Summary) -> Figure:
    """Draw the ways seen from above, as commanded, estimated, measured by the wheels, and in truth."""
    figure = Figure(figsize=(style.WIDTH_IN, _path_height_in(run)), layout="constrained")
    axes = figure.add_subplot(aspect="equal", adjustable="datalim", xlabel="x (m)", ylabel="y (m)")
    axes.plot(0, 0, "o", color="white", markeredgecolor=style.TRUTH, markersize=9, zorder=5, label="start")
    if run.config.mission is not None:
        corners = np.array(run.config.mission.corners())
        axes.plot(*corners.T, color=style.COMMANDED, linestyle=(0, (5, 3)), label="commanded")
    area = run.config.safety.area
    if area is not None:
        # A large area must not make the path small.
        border = np.array(area.outline()).T
        axes.plot(*border, color=style.ALARM, linestyle="--", label="area", scalex=False, scaley=False)
    _draw_way(axes, run.encoders, style.ENCODERS, _with_error("encoders", summary.encoders_error), WIDE)
    if run.truth is not None:
        _draw_way(axes, run.truth, style.TRUTH, "truth", MIDDLE)
    _draw_way(axes, run.estimate, style.ESTIMATE, _with_error("estimate", summary.estimate_error), NARROW)
    way_m = run.estimate.distance_m()
    longest_m = [
        _draw_ellipse(axes, run, int(index))
        for index in np.searchsorted(way_m, np.linspace(0.0, way_m[-1], ELLIPSES)[1:])
    ]
    size_m = max(float(np.ptp(limits)) for limits in (axes.dataLim.intervalx, axes.dataLim.intervaly))
    if longest_m[-1] > size_m:
        text = f"at the end the 95 % region reaches {length(longest_m[-1])}, farther than this picture"
        axes.set_title(text, fontsize="small", loc="left")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def draw_error(run: RunData, summary: Summary) -> Figure | None:
    """Draw how far estimate and encoders are off the truth."""
    if run.truth is None:
        return None
    figure, (axes,) = run_plots.rows(1, 2.4)
    for track, colour, label, width in (
        (run.encoders, style.ENCODERS, "encoders", WIDE),
        (run.estimate, style.ESTIMATE, "estimate", NARROW),
    ):
        error = position_error_m(track, run.truth)
        run_plots.line(axes, Series(error.t_s, 1e3 * error.value), colour, label, width)
    axes.set_ylabel("off the truth (mm)")
    axes.set_ylim(bottom=0)
    run_plots.finish(figure, [axes], run, summary)
    return figure


def draw_headings(run: RunData, summary: Summary) -> Figure:
    """Draw every account of the yaw, in the local frame."""
    figure, (axes,) = run_plots.rows(1, 2.8)
    for (name, heading), colour in zip(run.headings.items(), style.HEADINGS, strict=False):
        _draw_yaw(axes, heading, style.pale(colour), name, NARROW)
    _draw_yaw(axes, Series(run.encoders.t_s, run.encoders.yaw_rad), style.ENCODERS, "encoders", WIDE)
    if run.gyro is not None:
        _draw_yaw(axes, run.gyro, style.GYRO, "gyro, integrated", NARROW)
    if run.truth is not None and run.truth.has_yaw:
        _draw_yaw(axes, Series(run.truth.t_s, run.truth.yaw_rad), style.TRUTH, "truth", MIDDLE)
    _draw_yaw(axes, Series(run.estimate.t_s, run.estimate.yaw_rad), style.ESTIMATE, "estimate", NARROW)
    axes.set_ylabel("yaw (deg)")
    run_plots.finish(figure, [axes], run, summary)
    return figure


def _draw_way(axes: Axes, track: Track, colour: str, label: str, width: float) -> None:
    every = max(1, len(track.t_s) // THIN_BINS)
    x_m, y_m = (np.append(values[::every], values[-1]) for values in (track.x_m, track.y_m))
    axes.plot(x_m, y_m, color=colour, label=label, linewidth=width)
    axes.plot(x_m[-1], y_m[-1], "o", color=colour, markersize=7, markeredgecolor="white", zorder=6)


def _draw_ellipse(axes: Axes, run: RunData, index: int) -> float:
    """Draw the 95 % region of a position; return its longer semi-axis, m."""
    xx, xy, _, yy, _, _ = run.covariance[index]
    values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
    width_m, height_m = 2.0 * np.sqrt(CHI_SQUARE * np.maximum(values, 0.0))
    # The picture is scaled to the path: a large region must not make it small.
    axes.add_artist(
        Ellipse(
            (run.estimate.x_m[index], run.estimate.y_m[index]),
            width_m,
            height_m,
            angle=math.degrees(math.atan2(vectors[1, 0], vectors[0, 0])),
            facecolor=style.ESTIMATE,
            edgecolor=style.ESTIMATE,
            alpha=0.13,
        )
    )
    return 0.5 * float(max(width_m, height_m))


def _draw_yaw(axes: Axes, yaw: Series, colour: str, label: str, width: float) -> None:
    run_plots.line(axes, Series(yaw.t_s, np.degrees(yaw.value)), colour, label, width)


def _with_error(name: str, error: TrackError | None) -> str:
    return name if error is None else f"{name}, ends {length(error.position_final_m)} off"


def _path_height_in(run: RunData) -> float:
    tracks = [run.estimate, run.encoders, *([] if run.truth is None else [run.truth])]
    width_m, height_m = (
        float(np.ptp(np.concatenate(values)))
        for values in ([track.x_m for track in tracks], [track.y_m for track in tracks])
    )
    lowest, highest = PATH_HEIGHT_IN
    return min(highest, max(lowest, style.WIDTH_IN * height_m / max(width_m, 1e-3) + 1.2))
