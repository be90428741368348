"""The pictures of a tuning report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from controllers.motion.missions.mission import Point
from rover_hil.config.tune_settings import TuneSettings
from rover_hil.pages import style
from rover_hil.pages.picture import Drawing, Picture, draw_pictures
from rover_hil.tune.comparison import Comparison, Verdict
from rover_hil.tune.journal import Attempt
from rover_hil.tune.objective import case_cost
from rover_hil.tune.search_figures import (
    AFTER,
    BEFORE,
    COLUMNS,
    TradeOffAxis,
    draw_parameters,
    draw_search,
    draw_trade_off,
    plot,
    with_legend,
)
from rover_hil.tune.simulated_mission import SimulatedMission

PATHS = 6
EFFORT = TradeOffAxis("effort_rad_s2", 1.0, "effort (rad/s2)")
PATH = TradeOffAxis("path_rms_m", 1000.0, "path error, rms (mm)")
DURATION = TradeOffAxis("duration_s", 1.0, "duration (s)")


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningData:
    """What the report is made of; `corners` are those of the commanded path."""

    tune: TuneSettings
    corners: Sequence[Point]
    attempts: Sequence[Attempt]
    comparison: Comparison[SimulatedMission]


def draw_report(data: TuningData) -> list[Picture]:
    """Return the pictures in the order of the report."""
    return draw_pictures(Drawing(title, caption, partial(draw, data)) for title, caption, draw in PICTURES)


def _draw_scenarios(data: TuningData) -> Figure:
    figure, axes = plot(2.8, "held-out scenarios, the worst first", "cost")
    order = [mission.seed for mission in _worst_first(data)]
    for name, colour, missions in _sides(data.comparison):
        dots = [(order.index(each.seed), case_cost(each, data.tune.objective)) for each in missions]
        axes.plot(*np.transpose(dots), "o", color=colour, label=name, markersize=6)
    axes.set_xticks([])
    axes.set_ylim(bottom=0)
    return with_legend(figure, axes)


def _draw_paths(data: TuningData) -> Figure:
    ordered = _worst_first(data)
    shown = [ordered[index] for index in np.unique(np.linspace(0, len(ordered) - 1, PATHS, dtype=int))]
    height_in = style.WIDTH_IN / COLUMNS * _aspect(data.corners) + 0.4
    row_count = -(-len(shown) // COLUMNS)
    figure = Figure(figsize=(style.WIDTH_IN, height_in * row_count + 0.5), layout="constrained")
    grid = figure.subplots(row_count, COLUMNS, sharex=True, sharey=True, squeeze=False).flat
    for axes, mission in zip(grid, shown, strict=False):
        axes.plot(
            *np.transpose(data.corners), color=style.COMMANDED, linestyle=(0, (5, 3)), label="commanded"
        )
        for name, colour, missions in _sides(data.comparison):
            for driven in missions:
                if driven.seed == mission.seed:
                    axes.plot(driven.true_path.x_m, driven.true_path.y_m, color=colour, label=name)
        axes.set_title(f"scenario {mission.seed}")
        axes.set_aspect("equal")
    figure.supxlabel("x (m)", fontsize="medium", color="#374151")
    figure.supylabel("y (m)", fontsize="medium", color="#374151")
    return with_legend(figure, figure.axes[0])


def _sides(comparison: Comparison[SimulatedMission]) -> list[tuple[str, str, Sequence[SimulatedMission]]]:
    old = ("old values", BEFORE, comparison.start.runs)
    new = ("new values", AFTER, comparison.tuned.runs)
    return [old, new] if comparison.verdict is Verdict.IMPROVED else [old]


def _worst_first(data: TuningData) -> list[SimulatedMission]:
    """Return the cases of the old values, the worst first; of the new ones where the old were refused."""
    missions = max((side for _, _, side in _sides(data.comparison)), key=len)
    return sorted(missions, key=lambda each: -case_cost(each, data.tune.objective))


def _aspect(corners: Sequence[Point]) -> float:
    width_m, height_m = np.ptp(np.array(corners), axis=0)
    return float(np.clip(height_m / max(width_m, 1e-3), 0.35, 1.2))


PICTURES: tuple[tuple[str, str, Callable[[TuningData], Figure]], ...] = (
    (
        "Held-out scenarios",
        "Are the new values better everywhere or only on average? The search used none of these scenarios.",
        _draw_scenarios,
    ),
    (
        "True paths",
        "The difference in the path, from the worst held-out scenario of the old values to the best.",
        _draw_paths,
    ),
    (
        "Search",
        "More trials help while the line still falls at its end.",
        lambda data: draw_search(data.attempts, "scenarios"),
    ),
    (
        "Trade-off",
        "Quantiles over the training scenarios of every trial that drove all of them. On the line no trial "
        "has a smaller path error with less effort.",
        lambda data: draw_trade_off(data.attempts, EFFORT, PATH, DURATION),
    ),
    (
        "Parameters",
        "A valley means that the parameter matters, an even cloud that it does not. A best value at an edge "
        "requires a wider range.",
        lambda data: draw_parameters(data.tune, data.attempts, data.comparison.values, "scenarios"),
    ),
)
