"""Picture of the offsets between devices: how well each offset explains the turns."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.ready.time.fit import Offset


def draw_offsets(offsets: Sequence[Offset]) -> Figure | None:
    """Draw the share of the turns that each offset leaves; None where no offset was found."""
    known = [each for each in offsets if each.search_s.size]
    if not known:
        return None
    figure = Figure(figsize=(style.WIDTH_IN, 3.6), layout="constrained")
    axes = figure.subplots()
    colours = (style.ESTIMATE, style.ENCODERS, style.GYRO, *style.HEADINGS)
    for index, each in enumerate(known):
        colour = colours[index % len(colours)]
        axes.plot(each.search_s, np.sqrt(each.cost), color=colour, label=each.track.name)
        axes.axvline(each.offset_s, color=colour, linewidth=0.8, linestyle="--")
    axes.set(xlabel="offset: later than the reference (s)", ylabel="not explained", ylim=(0.0, 1.05))
    axes.legend()
    return figure
