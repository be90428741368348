"""Pictures of a field test: slip angle (figures 15, 17), slip (18, 20) and path (19, 21) of paper 000."""

import io
from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from controllers.scomp.drive import Track
from rover_hil.report.style import ENCODERS, ESTIMATE, STYLE, TRUTH, WIDTH_IN

Floats = NDArray[np.float64]
COLOURS = {"plain": ENCODERS, "compass": "#9b4dca", "scomp_paper": "#0f8a5f", "ours": ESTIMATE}
LEAST_SPEED = 0.99
"""No slip angle is drawn where the slip is greater: the rover stands."""


def field_pictures(tracks: Mapping[str, Track], truth: Mapping[str, Floats]) -> dict[str, str]:
    """Return SVG texts by file name.

    Args:
        tracks: Of each odometry, by name.
        truth: Columns t_s, x_m, y_m, slip, slip_angle_rad of the drive.
    """
    moves = truth["slip"] < LEAST_SPEED
    with mpl.rc_context(STYLE):
        figures = {name: _one(*labels) for name, labels in _LABELS.items()}
        angle, slip, path = (figures[name][1] for name in _LABELS)
        angle.plot(
            truth["t_s"][moves], np.degrees(truth["slip_angle_rad"][moves]), color=TRUTH, label="truth"
        )
        slip.plot(truth["t_s"][moves], truth["slip"][moves], color=TRUTH, label="truth")
        path.plot(truth["x_m"], truth["y_m"], color=TRUTH, label="truth")
        for name, track in tracks.items():
            colour = COLOURS[name]
            path.plot(track.x_m, track.y_m, color=colour, label=name, linewidth=1.2)
            if name in ("scomp_paper", "ours"):
                angle.plot(
                    track.t_s, np.degrees(track.slip_angle_rad), color=colour, label=name, linewidth=1.0
                )
                slip.plot(track.t_s, track.slip, color=colour, label=name, linewidth=1.0)
        path.set_aspect("equal", adjustable="datalim")
        return {name: _svg(*found) for name, found in figures.items()}


_LABELS = {
    "slip_angle.svg": ("time (s)", "slip angle (deg)"),
    "slip.svg": ("time (s)", "slip ratio"),
    "path.svg": ("x (m)", "y (m)"),
}


def _one(x_label: str, y_label: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(WIDTH_IN, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    return figure, axes


def _svg(figure: Figure, axes: Axes) -> str:
    axes.legend(fontsize="small")
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()
