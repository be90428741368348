"""Picture of the drives behind a fit of radius and base."""

import numpy as np
from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.ready.wheels.fit import Factor


def draw_factor(factor: Factor | None, unit: str) -> Figure | None:
    """Draw what the wheels missed in each drive, before and after; None without drives."""
    if factor is None:
        return None
    figure = Figure(figsize=(style.WIDTH_IN, 2.8), layout="constrained")
    axes = figure.subplots()
    drives = np.arange(1, len(factor.measured) + 1)
    axes.axhline(0.0, color=style.COMMANDED, linewidth=1.0)
    axes.plot(drives, factor.odometry - factor.measured, "o", color=style.ENCODERS, label="present geometry")
    axes.plot(
        drives, factor.value * factor.odometry - factor.measured, "o", color=style.ESTIMATE, label="proposed"
    )
    axes.set(xlabel="drive", ylabel=f"odometry - measured ({unit})", xticks=drives)
    axes.legend()
    return figure
