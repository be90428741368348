"""Pictures of the diagnosis."""

import numpy as np
from matplotlib.figure import Figure

from rover_hil.diagnose.diagnosis import Diagnosis
from rover_hil.diagnose.drive_errors import ESTIMATE, ODOMETRY
from rover_hil.diagnose.trajectory_errors import aligned
from rover_hil.drives.arrays import rms
from rover_hil.pages import style
from rover_hil.pages.picture import Drawing

MOST_PATHS = 6
EXPECTED = 3.0
"""Of the normalised squared error of x, y and yaw."""


def drawings_of(diagnosis: Diagnosis) -> list[Drawing]:
    """Return the pictures of the page."""
    return [
        Drawing(
            "Paths after alignment",
            "See whether the blue path stays with the black one. The drives with the greatest errors.",
            lambda: draw_paths(diagnosis),
        ),
        Drawing(
            "Normalised squared error of the estimate",
            "An honest standard deviation gives values about the grey line: far below it is too wide, far "
            "above it is too narrow.",
            lambda: draw_normalised(diagnosis),
        ),
    ]


def draw_paths(diagnosis: Diagnosis) -> Figure | None:
    """Draw odometry, estimate and ground truth of some drives; None without known places."""
    if diagnosis.errors is None:
        return None
    of_drives = diagnosis.errors.of_drives
    names = sorted(of_drives, key=lambda name: -of_drives[name][ODOMETRY].ate_m)[:MOST_PATHS]
    columns = min(len(names), 2)
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(style.WIDTH_IN, 3.4 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(names) :]:
        axes.set_visible(False)
    for axes, name in zip(grid, names, strict=False):
        compared = diagnosis.compared[name]
        true_m = compared.true.place_m
        axes.plot(true_m.real, true_m.imag, color=style.TRUTH, linewidth=3.0, label="ground truth")
        for track, colour in ((ODOMETRY, style.ENCODERS), (ESTIMATE, style.ESTIMATE)):
            own_m = aligned(compared.tracks[track].place_m, true_m)
            label = f"{track}, ATE {rms(np.abs(own_m - true_m)):.2g} m"
            axes.plot(own_m.real, own_m.imag, color=colour, label=label)
        axes.set(aspect="equal", adjustable="datalim", xlabel="x (m)", ylabel="y (m)", title=name)
        axes.legend(fontsize=8)
    return figure


def draw_normalised(diagnosis: Diagnosis) -> Figure | None:
    """Draw the normalised errors over time, by kind of motion; None where they are not known."""
    if not diagnosis.normalised:
        return None
    figure = Figure(figsize=(style.WIDTH_IN, 3.0), layout="constrained")
    axes = figure.add_subplot(xlabel="time (s)", ylabel="squared error over variance", yscale="log")
    kinds = dict.fromkeys(each.kind for each in diagnosis.normalised)
    for kind, colour in zip(
        kinds, (style.ESTIMATE, style.ENCODERS, style.GYRO, *style.HEADINGS), strict=False
    ):
        for place, each in enumerate(each for each in diagnosis.normalised if each.kind == kind):
            label = None if place else kind
            axes.plot(each.t_s, np.maximum(each.nees, 1e-4), color=colour, linewidth=1.0, label=label)
    axes.axhline(EXPECTED, color=style.COMMANDED)
    axes.legend()
    return figure
