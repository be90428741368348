"""A page with the picture of a mission before it is driven."""

import math
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from controllers.motion.missions.mission import Leg
from controllers.motion.settings import MissionSettings
from controllers.safety.area import Area
from drivers.errors import ConfigError
from rover_hil.pages import style
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render

MOST_WORDS = 40
"""Corners that get words in the picture; more would cover it."""


def mission_page(name: str, mission: MissionSettings | None, area: Area | None) -> str:
    """Return the page of a mission.

    Args:
        name: Of the configuration.
        mission: The mission.
        area: What the rover must not leave; None for no limit.

    Raises:
        ConfigError: It has no path.
    """
    if mission is None or not mission.has_path:
        raise ConfigError(f"{name}: the mission has no path to draw: leave --preview out")
    legs = mission.legs()
    lengths_m = [math.dist(*line) for line in pairwise(mission.corners())]
    waits_s = sum(leg.wait_s for leg in legs)
    least_s = sum(
        length_m / (leg.speed_m_s or mission.speed_m_s) for leg, length_m in zip(legs, lengths_m, strict=True)
    )
    facts = (
        ("legs", f"{len(legs)}, {sum(lengths_m):.2f} m in all"),
        ("time", f"at least {least_s + waits_s:.0f} s, of these {waits_s:.0f} s at rest"),
        ("heading", mission.heading),
    )
    drawing = Drawing(
        "Path seen from above",
        "The rover starts at the ring and looks along x. See whether every corner lies in the free space.",
        lambda: _draw(mission, legs, area),
    )
    return render(
        "pages/facts.html",
        grade="plain",
        title=f"Mission of {name}",
        facts=facts,
        pictures=draw_pictures([drawing]),
    )


def _draw(mission: MissionSettings, legs: tuple[Leg, ...], area: Area | None) -> Figure:
    figure = Figure(figsize=(style.WIDTH_IN, 5.0), layout="constrained")
    axes = figure.add_subplot(aspect="equal", adjustable="datalim", xlabel="x (m)", ylabel="y (m)")
    if area is not None:
        axes.plot(*np.array(area.outline()).T, color=style.ALARM, linestyle="--", label="area")
    corners = np.array(mission.corners())
    axes.plot(*corners.T, color=style.COMMANDED)
    axes.plot(0, 0, "o", color="white", markeredgecolor=style.TRUTH, markersize=9, label="start")
    for (start, end), leg in dict(zip(pairwise(mission.corners()), legs, strict=True)).items():
        middle = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
        axes.annotate(
            "", middle, start, arrowprops={"arrowstyle": "-|>", "color": style.COMMANDED, "shrinkA": 0}
        )
        if leg.wait_s > 0.0:
            axes.plot(*end, "s", color=style.ENCODERS)
        if len(legs) <= MOST_WORDS:
            words = [f"{leg.speed_m_s or mission.speed_m_s:g} m/s"]
            axes.annotate(
                words[0],
                middle,
                fontsize=8,
                color=style.TRUTH,
                ha="center",
                xytext=(0, 10),
                textcoords="offset points",
                bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none"},
            )
            if leg.wait_s > 0.0:
                axes.annotate(f"{leg.wait_s:g} s", end, fontsize=8, xytext=(4, 4), textcoords="offset points")
    axes.legend(loc="best")
    return figure
