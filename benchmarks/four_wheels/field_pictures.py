"""Pictures of a field test: path (figures 19, 21), slip angle (15, 17) and slip (18, 20) of paper 000."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rover_hil.pages.style import ENCODERS, ESTIMATE, GYRO, HEADINGS, STYLE, TRUTH, WIDTH_IN
from rover_hil.scomp.drive import Track

Floats = NDArray[np.float64]
NAMES = {
    "plain": "plain",
    "compass": "with compass",
    "scomp_paper": "sComp as in the paper",
    "ours": "ours",
}
COLOURS = {"plain": ENCODERS, "compass": GYRO, "scomp_paper": HEADINGS[0], "ours": ESTIMATE}
LEAST_SPEED = 0.99
"""No slip angle is drawn where the slip is greater: the rover stands."""
DOTS_PER_INCH = 110


def draw_test(tracks: Mapping[str, Track], truth: Mapping[str, Floats], path: Path) -> None:
    """Write a picture of a test.

    Args:
        tracks: Of each odometry, by name.
        truth: Columns t_s, x_m, y_m, slip, slip_angle_rad of the drive.
        path: PNG file.
    """
    moves = truth["slip"] < LEAST_SPEED
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, 8.4), layout="constrained")
        way, angle, slip = figure.subplots(3, height_ratios=(1.2, 1.0, 1.0))
        for name, track in tracks.items():
            way.plot(track.x_m, track.y_m, color=COLOURS[name], label=NAMES[name], linewidth=1.2)
            if name in ("scomp_paper", "ours"):
                degrees = np.degrees(track.slip_angle_rad)
                angle.plot(track.t_s, degrees, color=COLOURS[name], label=NAMES[name], linewidth=1.0)
                slip.plot(track.t_s, track.slip, color=COLOURS[name], label=NAMES[name], linewidth=1.0)
        way.plot(truth["x_m"], truth["y_m"], color=TRUTH, label="truth")
        degrees = np.degrees(truth["slip_angle_rad"][moves])
        angle.plot(truth["t_s"][moves], degrees, color=TRUTH, label="truth")
        slip.plot(truth["t_s"][moves], truth["slip"][moves], color=TRUTH, label="truth")
        way.set_aspect("equal", adjustable="datalim")
        _label(way, "x (m)", "y (m)")
        _label(angle, "time (s)", "slip angle (deg)")
        _label(slip, "time (s)", "slip ratio")
        figure.savefig(path, dpi=DOTS_PER_INCH)


def _label(axes: Axes, x_label: str, y_label: str) -> None:
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.legend(fontsize="small")
