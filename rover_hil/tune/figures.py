"""The pictures of a tuning report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from controllers.motion.mission import Point
from rover_hil.config.tune_settings import TuneSettings
from rover_hil.datasets.arrays import Array
from rover_hil.pages import style
from rover_hil.pages.picture import Drawing, Picture, draw_pictures
from rover_hil.tune.comparison import Comparison, Verdict
from rover_hil.tune.journal import Attempt
from rover_hil.tune.objective import case_cost
from rover_hil.tune.simulated_mission import SimulatedMission

BEFORE = style.ENCODERS
AFTER = style.ESTIMATE
PATHS = 6
COLUMNS = 2
CEILING = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningData:
    """What the report is made of; `corners` are those of the commanded path."""

    tune: TuneSettings
    corners: Sequence[Point]
    attempts: Sequence[Attempt]
    comparison: Comparison


def draw_report(data: TuningData) -> list[Picture]:
    """Return the pictures in the order of the report."""
    return draw_pictures(Drawing(title, caption, partial(draw, data)) for title, caption, draw in PICTURES)


def _draw_scenarios(data: TuningData) -> Figure:
    figure, axes = _plot(2.8, "held-out scenarios, the worst first", "cost")
    order = [mission.seed for mission in _worst_first(data)]
    for name, colour, missions in _sides(data.comparison):
        dots = [(order.index(each.seed), case_cost(each, data.tune.objective)) for each in missions]
        axes.plot(*np.transpose(dots), "o", color=colour, label=name, markersize=6)
    axes.set_xticks([])
    axes.set_ylim(bottom=0)
    return _with_legend(figure, axes)


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
            for other in missions:
                if other.seed == mission.seed:
                    axes.plot(other.true_path.x_m, other.true_path.y_m, color=colour, label=name)
        axes.set_title(f"scenario {mission.seed}")
        axes.set_aspect("equal")
    figure.supxlabel("x (m)", fontsize="medium", color="#374151")
    figure.supylabel("y (m)", fontsize="medium", color="#374151")
    return _with_legend(figure, figure.axes[0])


def _draw_search(data: TuningData) -> Figure:
    figure, axes = _plot(2.8, "trial", "cost on the training scenarios")
    known = [(attempt.number, attempt.cost) for attempt in data.attempts if attempt.cost is not None]
    given_up = [(a.number, a.at_least) for a in data.attempts if a.cost is None and not a.refused]
    refused = [attempt.number for attempt in data.attempts if attempt.refused]
    top = _top(data.attempts)
    if known:
        numbers, costs = np.transpose(known)
        axes.plot(numbers, costs, "o", color=AFTER, markersize=4, label="all cases driven")
        best = np.minimum.accumulate(costs)
        axes.step(numbers, best, where="post", color=style.TRUTH, label="best so far")
    if given_up:
        axes.plot(
            *np.transpose(given_up), "^", color=style.COMMANDED, markersize=4, label="given up, at least"
        )
    if refused:
        axes.plot(refused, [top] * len(refused), "x", color=style.ALARM, markersize=5, label="refused")
    axes.set_ylim(0, 1.05 * top)
    return _with_legend(figure, axes)


def _draw_parameters(data: TuningData) -> Figure:
    parameters = data.tune.parameters
    row_count = -(-len(parameters) // COLUMNS)
    figure = Figure(figsize=(style.WIDTH_IN, 2.1 * row_count + 0.5), layout="constrained")
    grid = figure.subplots(row_count, COLUMNS, squeeze=False, sharey=True)
    grid[0, 0].set_ylim(0, 1.05 * _top(data.attempts))
    start = next((attempt for attempt in data.attempts if attempt.is_start), None)
    for axes, (key, parameter) in zip(grid.flat, parameters.items(), strict=False):
        dots = [(a.values[key], a.cost) for a in data.attempts if a.cost is not None]
        if dots:
            axes.plot(*np.transpose(dots), "o", color=style.pale(style.TRUTH), markersize=4)
        if start is not None:
            axes.axvline(start.values[key], color=BEFORE, label="old value")
        axes.axvline(data.comparison.values[key], color=AFTER, linestyle=(0, (4, 2)), label="new value")
        axes.set_xscale(parameter.scale)
        axes.set_xlabel(f"{key} ({parameter.unit})")
    for axes in grid.flat[len(parameters) :]:
        axes.set_axis_off()
    figure.supylabel("cost on the training scenarios", fontsize="medium", color="#374151")
    return _with_legend(figure, figure.axes[0])


def _draw_trade_off(data: TuningData) -> Figure:
    figure, axes = _plot(3.2, "effort (rad/s2)", "path error, rms (mm)")
    known = [attempt for attempt in data.attempts if attempt.cost is not None and attempt.terms]
    if not known:
        return figure
    effort, path_m, duration_s = np.array(
        [[each.terms[name] for name in ("effort_rad_s2", "path_rms_m", "duration_s")] for each in known]
    ).T
    dots = axes.scatter(effort, 1000.0 * path_m, c=duration_s, s=16, cmap="viridis", label="trials")
    figure.colorbar(dots, ax=axes, label="duration (s)")
    order = np.lexsort((path_m, effort))
    front = [
        index for index, best in zip(order, _least_before(path_m[order]), strict=True) if path_m[index] < best
    ]
    axes.step(effort[front], 1000.0 * path_m[front], where="post", color=style.TRUTH, label="best trade-offs")
    return _with_legend(figure, axes)


def _least_before(values: Array) -> Array:
    """Return the least of all values before each one; infinity for the first."""
    least: Array = np.minimum.accumulate(np.concatenate(([np.inf], values[:-1])))
    return least


def _sides(comparison: Comparison) -> list[tuple[str, str, Sequence[SimulatedMission]]]:
    old = ("old values", BEFORE, comparison.start.missions)
    new = ("new values", AFTER, comparison.tuned.missions)
    return [old, new] if comparison.verdict is Verdict.IMPROVED else [old]


def _worst_first(data: TuningData) -> list[SimulatedMission]:
    """Return the cases of the old values, the worst first; of the new ones where the old were refused."""
    missions = max((side for _, _, side in _sides(data.comparison)), key=len)
    return sorted(missions, key=lambda each: -case_cost(each, data.tune.objective))


def _top(attempts: Sequence[Attempt]) -> float:
    """Return the upper limit of the cost axis, so that bad values do not hide the good ones."""
    costs = sorted(attempt.cost for attempt in attempts if attempt.cost is not None)
    if not costs:
        return 1.0
    start = next((a.cost for a in attempts if a.is_start and a.cost is not None), 0.0)
    return max(CEILING * costs[0], start)


def _aspect(corners: Sequence[Point]) -> float:
    width_m, height_m = np.ptp(np.array(corners), axis=0)
    return float(np.clip(height_m / max(width_m, 1e-3), 0.35, 1.2))


def _plot(height_in: float, x_label: str, y_label: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(style.WIDTH_IN, height_in), layout="constrained")
    return figure, figure.add_subplot(xlabel=x_label, ylabel=y_label)


def _with_legend(figure: Figure, axes: Axes) -> Figure:
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


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
        _draw_search,
    ),
    (
        "Trade-off",
        "Quantiles over the training scenarios of every trial that drove all of them. On the line no trial "
        "has a smaller path error with less effort.",
        _draw_trade_off,
    ),
    (
        "Parameters",
        "A valley means that the parameter matters, an even cloud that it does not. A best value at an edge "
        "requires a wider range.",
        _draw_parameters,
    ),
)
