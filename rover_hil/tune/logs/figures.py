"""The pictures of a tuning by logs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from rover_hil.config.tune_settings import TuneSettings
from rover_hil.pages import style
from rover_hil.pages.picture import Drawing, Picture, draw_pictures
from rover_hil.tune.comparison import Comparison, Verdict
from rover_hil.tune.journal import Attempt
from rover_hil.tune.logs.objective import consistency, mean_nees
from rover_hil.tune.logs.replayed_log import ReplayErrors
from rover_hil.tune.search_figures import (
    AFTER,
    BEFORE,
    TradeOffAxis,
    draw_parameters,
    draw_search,
    draw_trade_off,
    plot,
    with_legend,
)

POSITION = TradeOffAxis("position_m", 1000.0, "position error, rms (mm)")
NEES = TradeOffAxis("nees", 1.0, "|ln of NEES over its dimension|, 0 is right")
HEADING = TradeOffAxis("heading_deg", 1.0, "heading error, rms (deg)")


@dataclass(frozen=True, slots=True, kw_only=True)
class LogTuningData:
    """What the report is made of."""

    tune: TuneSettings
    attempts: Sequence[Attempt]
    comparison: Comparison[ReplayErrors]


def draw_log_report(data: LogTuningData) -> list[Picture]:
    """Return the pictures in the order of the report."""
    return draw_pictures(Drawing(title, caption, partial(draw, data)) for title, caption, draw in PICTURES)


def _sides(comparison: Comparison[ReplayErrors]) -> list[tuple[str, str, Sequence[ReplayErrors]]]:
    old = ("old values", BEFORE, comparison.start.runs if comparison.start.cost is not None else ())
    new = ("new values", AFTER, comparison.tuned.runs)
    return [old, new] if comparison.verdict is Verdict.IMPROVED else [old]


def _draw_consistency(data: LogTuningData) -> Figure:
    figure, axes = plot(3.2, "squared error over its reported variance, 1 is right", "")
    names: list[str] = []
    for label, colour, logs in _sides(data.comparison):
        if not logs:
            continue
        ratios = {f"{name} (NEES)": ratio for name, ratio in mean_nees(logs).items()}
        ratios |= {name: ratio for name, (ratio, _) in consistency(logs).items()}
        names += [name for name in ratios if name not in names]
        places = [names.index(name) for name in ratios]
        axes.plot(list(ratios.values()), places, "o", color=colour, label=label, markersize=6)
    axes.axvline(1.0, color=style.TRUTH, linewidth=1)
    axes.set_xscale("log")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    return with_legend(figure, axes)


def _draw_errors(data: LogTuningData) -> Figure:
    figure, axes = plot(2.8, "judged poses of the held-out logs, in their order", "position error (mm)")
    for label, colour, logs in _sides(data.comparison):
        if not logs:
            continue
        axes.plot(1000.0 * np.concatenate([log.position_m for log in logs]), color=colour, label=label)
        for edge in np.cumsum([len(log.position_m) for log in logs])[:-1]:
            axes.axvline(edge - 0.5, color=style.COMMANDED, linewidth=0.5)
    axes.set_ylim(bottom=0)
    return with_legend(figure, axes)


PICTURES: tuple[tuple[str, str, Callable[[LogTuningData], Figure]], ...] = (
    (
        "Consistency on held-out logs",
        "Left of 1 the filter reports more uncertainty than there is, right of 1 less.",
        _draw_consistency,
    ),
    (
        "Errors on held-out logs",
        "Each log begins at a line. The search used none of them.",
        _draw_errors,
    ),
    (
        "Search",
        "More trials help while the line still falls at its end.",
        lambda data: draw_search(data.attempts, "logs"),
    ),
    (
        "Trade-off",
        "Accuracy and consistency of every trial on the training logs.",
        lambda data: draw_trade_off(data.attempts, NEES, POSITION, HEADING),
    ),
    (
        "Parameters",
        "A valley means that the parameter matters, an even cloud that it does not. A best value at an edge "
        "requires a wider range.",
        lambda data: draw_parameters(data.tune, data.attempts, data.comparison.values, "logs"),
    ),
)
