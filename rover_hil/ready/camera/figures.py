"""Pictures of a calibrated camera: where the board was seen, and what the calibration misses."""

import numpy as np
from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.ready.camera.fit import Calibration, View


def draw_coverage(calibration: Calibration) -> Figure:
    """Draw the corners of the board in all pictures, and those on the ground, over the whole view."""
    width, height = calibration.size
    figure = Figure(figsize=(style.WIDTH_IN, style.WIDTH_IN * height / width), layout="constrained")
    axes = figure.add_subplot(xlim=(0, width), ylim=(height, 0), aspect="equal")
    pixels = np.concatenate([view.pixels for view in calibration.views])
    axes.plot(*pixels.T, ".", color=style.ESTIMATE, markersize=3, label="pictures")
    axes.plot(*calibration.ground.pixels.T, "x", color=style.TRUTH, markersize=4, label="on the ground")
    axes.set(xlabel="column (pixels)", ylabel="row (pixels)")
    axes.legend()
    return figure


def draw_errors(calibration: Calibration, largest_px: float) -> Figure:
    """Draw the error of each corner, and the rms error of each picture under the largest allowed one."""
    figure = Figure(figsize=(style.WIDTH_IN, 3.4), layout="constrained")
    corners, pictures = figure.subplots(1, 2)
    for label, colour, views in _kinds(calibration):
        errors = np.concatenate([view.error for view in views])
        corners.plot(*errors.T, ".", color=colour, markersize=3, label=label)
    corners.axhline(0.0, color=style.COMMANDED, linewidth=0.5)
    corners.axvline(0.0, color=style.COMMANDED, linewidth=0.5)
    corners.set(xlabel="error along columns (pixels)", ylabel="along rows (pixels)", aspect="equal")
    corners.set_adjustable("datalim")
    numbers = np.arange(1, len(calibration.views) + 1)
    pictures.plot(
        numbers, [view.rms_px for view in calibration.views], "o", color=style.ESTIMATE, label="pictures"
    )
    pictures.plot([0], [calibration.ground.rms_px], "x", color=style.TRUTH, label="on the ground")
    pictures.axhline(largest_px, color=style.ALARM, linewidth=1.0, label="largest allowed")
    pictures.set(xlabel="picture", ylabel="rms error (pixels)", ylim=(0.0, None))
    pictures.legend()
    return figure


def _kinds(calibration: Calibration) -> tuple[tuple[str, str, tuple[View, ...]], ...]:
    return ("pictures", style.ESTIMATE, calibration.views), (
        "on the ground",
        style.TRUTH,
        (calibration.ground,),
    )
