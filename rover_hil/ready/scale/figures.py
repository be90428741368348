"""Picture of the pieces of a drive behind the scale of a camera."""

import numpy as np
from matplotlib.figure import Figure

from drivers.samples import Image
from rover_hil.pages import style
from rover_hil.ready.scale.fit import ScaleFit


def draw_view(picture: Image | None) -> Figure | None:
    """Draw the ground from above, BGR; None without a picture."""
    if picture is None:
        return None
    rows, columns = picture.shape[:2]
    figure = Figure(figsize=(style.WIDTH_IN, style.WIDTH_IN * rows / columns), layout="constrained")
    axes = figure.subplots()
    axes.imshow(picture[..., ::-1])
    axes.set_axis_off()
    return figure


def draw_scale(fit: ScaleFit) -> Figure | None:
    """Draw by how much camera and known travel differ, before and after; None without pieces."""
    factor = fit.factor
    if factor is None:
        return None
    figure = Figure(figsize=(style.WIDTH_IN, 2.8), layout="constrained")
    axes = figure.subplots()
    pieces = np.arange(1, len(factor.measured) + 1)
    axes.axhline(0.0, color=style.COMMANDED, linewidth=1.0)
    for scale, color, label in (
        (1.0, style.ENCODERS, "the rig alone"),
        (factor.value, style.ESTIMATE, "with the scale"),
    ):
        missed = 100.0 * (scale * factor.odometry / factor.measured - 1.0)
        axes.plot(pieces, missed, "o", color=color, label=label)
    axes.set(xlabel="piece of the drive", ylabel="camera - known (%)")
    axes.legend()
    return figure
