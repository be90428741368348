"""Pictures of a search: cost of the trials, over each parameter, and its trade-off."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_hil.config.tune_settings import TuneSettings
from rover_hil.drives.arrays import Array
from rover_hil.pages import style
from rover_hil.tune.journal import Attempt

BEFORE = style.ENCODERS
AFTER = style.ESTIMATE
COLUMNS = 2
CEILING = 2.0


@dataclass(frozen=True, slots=True)
class TradeOffAxis:
    """A measured value as an axis: its name, what it is multiplied by, and the label with the unit."""

    term: str
    scale: float
    label: str


def draw_search(attempts: Sequence[Attempt], cases: str) -> Figure:
    """Draw the cost of every trial, and the best so far."""
    figure, axes = plot(3.4, "trial", f"cost on the training {cases}")
    known = [(attempt.number, attempt.cost) for attempt in attempts if attempt.cost is not None]
    given_up = [(a.number, a.at_least) for a in attempts if a.cost is None and not a.refused]
    refused = [attempt.number for attempt in attempts if attempt.refused]
    top = top_cost(attempts)
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
    return with_legend(figure, axes)


def draw_parameters(
    tune: TuneSettings, attempts: Sequence[Attempt], values: Mapping[str, float], cases: str
) -> Figure:
    """Draw the cost over each parameter."""
    parameters = tune.parameters
    row_count = -(-len(parameters) // COLUMNS)
    figure = Figure(figsize=(style.WIDTH_IN, 2.1 * row_count + 0.5), layout="constrained")
    grid = figure.subplots(row_count, COLUMNS, squeeze=False, sharey=True)
    grid[0, 0].set_ylim(0, 1.05 * top_cost(attempts))
    start = next((attempt for attempt in attempts if attempt.is_start), None)
    for axes, (key, parameter) in zip(grid.flat, parameters.items(), strict=False):
        dots = [(a.values[key], a.cost) for a in attempts if a.cost is not None]
        if dots:
            axes.plot(*np.transpose(dots), "o", color=style.pale(style.TRUTH), markersize=4)
        if start is not None:
            axes.axvline(start.values[key], color=BEFORE, label="old value")
        axes.axvline(values[key], color=AFTER, linestyle=(0, (4, 2)), label="new value")
        axes.set_xscale(parameter.scale)
        axes.set_xlabel(f"{key} ({parameter.unit})")
    for axes in grid.flat[len(parameters) :]:
        axes.set_axis_off()
    figure.supylabel(f"cost on the training {cases}", fontsize="medium", color="#374151")
    return with_legend(figure, figure.axes[0])


def draw_trade_off(
    attempts: Sequence[Attempt], across: TradeOffAxis, upward: TradeOffAxis, colour: TradeOffAxis
) -> Figure:
    """Draw two measured values of every trial against each other, and the best trade-offs."""
    known = [attempt for attempt in attempts if attempt.cost is not None and attempt.terms]
    figure, axes = plot(3.2, across.label, upward.label)
    if not known:
        return figure
    x, y, shade = (
        axis.scale * np.array([each.terms[axis.term] for each in known]) for axis in (across, upward, colour)
    )
    dots = axes.scatter(x, y, c=shade, s=16, cmap="viridis", label="trials")
    figure.colorbar(dots, ax=axes, label=colour.label)
    order = np.lexsort((y, x))
    front = [index for index, best in zip(order, _least_before(y[order]), strict=True) if y[index] < best]
    axes.step(x[front], y[front], where="post", color=style.TRUTH, label="best trade-offs")
    return with_legend(figure, axes)


def _least_before(values: Array) -> Array:
    """Return the least of all values before each one; infinity for the first."""
    least: Array = np.minimum.accumulate(np.concatenate(([np.inf], values[:-1])))
    return least


def top_cost(attempts: Sequence[Attempt]) -> float:
    """Return the upper limit of the cost axis, so that bad values do not hide the good ones."""
    costs = sorted(attempt.cost for attempt in attempts if attempt.cost is not None)
    if not costs:
        return 1.0
    start = next((a.cost for a in attempts if a.is_start and a.cost is not None), 0.0)
    return max(CEILING * costs[0], start)


def plot(height_in: float, x_label: str, y_label: str) -> tuple[Figure, Axes]:
    """Return a figure of the width of a page with one pair of axes."""
    figure = Figure(figsize=(style.WIDTH_IN, height_in), layout="constrained")
    return figure, figure.add_subplot(xlabel=x_label, ylabel=y_label)


def with_legend(figure: Figure, axes: Axes) -> Figure:
    """Put the legend of some axes above a figure; return the figure."""
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure
