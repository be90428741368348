"""Pictures of a commissioning run."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from rover_hil.drives.marks import Marks
from rover_hil.pages import style
from rover_hil.ready.commission.drive import Poses
from rover_hil.ready.commission.worth import Worth


def draw_drives(drives: Sequence[tuple[str, Poses, Marks]]) -> Figure:
    """Draw the paths by wheels and estimate, with the measured marks."""
    figure = Figure(figsize=(style.WIDTH_IN, 5.0), layout="constrained")
    axes = figure.add_subplot(aspect="equal", adjustable="datalim", xlabel="x (m)", ylabel="y (m)")
    for number, (_, poses, marks) in enumerate(drives):
        labels = ("wheels", "estimate", "measured") if number == 0 else (None, None, None)
        axes.plot(*poses.odometry[:, :2].T, color=style.ENCODERS, linewidth=0.8, label=labels[0])
        axes.plot(*poses.estimate[:, :2].T, color=style.ESTIMATE, linewidth=0.8, label=labels[1])
        axes.plot(marks.x_m, marks.y_m, "x", color=style.TRUTH, label=labels[2])
    axes.legend()
    return figure


def draw_errors(worth: Worth) -> Figure:
    """Draw the error of the estimate at each mark over its standard deviation."""
    figure = Figure(figsize=(style.WIDTH_IN, 3.2), layout="constrained")
    axes = figure.subplots()
    numbers = np.arange(1, len(worth.marks) + 1)
    for values, colour, label in (
        ([np.hypot(*each.odometry_m) for each in worth.marks], style.ENCODERS, "wheels"),
        ([np.hypot(*each.estimate_m) for each in worth.marks], style.ESTIMATE, "estimate"),
    ):
        axes.plot(numbers, 1e3 * np.array(values), "o", color=colour, label=label)
    two_sigma_mm = [2e3 * each.sigma_m for each in worth.marks]
    axes.plot(numbers, two_sigma_mm, "_", color=style.COMMANDED, markersize=12, label="2 standard deviations")
    axes.set(xlabel="mark", ylabel="off the mark (mm)", xticks=numbers)
    axes.legend()
    return figure
