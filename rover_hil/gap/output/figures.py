"""The pictures of a gap report."""

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_hil.gap.explain.candidates import Candidate, confusability
from rover_hil.gap.findings import Analysis, Findings
from rover_hil.gap.output import residual_figures
from rover_hil.gap.statistics.score import one_sided_z
from rover_hil.pages import style
from rover_hil.pages.picture import Drawing, Picture, draw_pictures

MOST_BARS = 16
FEW = 2


def draw_report(analysis: Analysis) -> list[Picture]:
    """Return the pictures in the order of the report; those without content are left out."""
    findings = analysis.findings
    if findings is None:
        return []
    return draw_pictures(
        Drawing(title, caption, partial(draw, analysis, findings)) for title, caption, draw in PICTURES
    )


def _draw_scores(analysis: Analysis, findings: Findings) -> Figure | None:
    del analysis
    candidates = findings.naming.scores[:MOST_BARS]
    if not candidates:
        return None
    figure, axes = _bars(len(candidates), "standard deviations")
    named = findings.best.names if findings.best is not None else ()
    for position, item in enumerate(candidates):
        colour = style.ESTIMATE if item.card.name in named else style.COMMANDED
        axes.barh(position, one_sided_z(item.score), color=colour)
        wrong = one_sided_z(item.score) == 0.0 and abs(item.score.z) > 1.0
        if wrong:
            axes.text(0.05, position, f"{item.score.z:+.1f}, impossible sign", va="center", fontsize=8)
    axes.axvline(findings.naming.threshold, color=style.ALARM, linestyle=(0, (4, 2)), label="significant")
    axes.legend(loc="lower right")
    _label_rows(axes, [item.card.name for item in candidates])
    return figure


def _draw_confusion(analysis: Analysis, findings: Findings) -> Figure | None:
    del analysis
    candidates: Sequence[Candidate] = findings.naming.scores[:MOST_BARS]
    if len(candidates) < FEW:
        return None
    names, matrix = confusability(candidates)
    order = _by_likeness(matrix)
    names, matrix = [names[index] for index in order], matrix[np.ix_(order, order)]
    side = 2.4 + 0.34 * len(names)
    figure = Figure(figsize=(style.WIDTH_IN, side), layout="constrained")
    axes = figure.add_subplot()
    image = axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    axes.grid(visible=False)
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right")
    axes.set_yticks(range(len(names)), names)
    for row, column in np.ndindex(matrix.shape):
        if row != column and abs(matrix[row, column]) > 0.3:
            colour = "white" if abs(matrix[row, column]) > 0.7 else style.TRUTH
            text = f"{matrix[row, column]:.1f}"
            axes.text(column, row, text, ha="center", va="center", color=colour, fontsize=8)
    figure.colorbar(image, ax=axes, label="cosine", shrink=0.7)
    return figure


def _by_likeness(matrix: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> list[int]:
    """Return an order with similar effects next to each other."""
    from scipy.cluster.hierarchy import leaves_list, linkage
    from scipy.spatial.distance import squareform

    distance = 1.0 - np.abs(matrix)
    distance = np.maximum(0.5 * (distance + distance.T), 0.0)
    np.fill_diagonal(distance, 0.0)
    return [int(index) for index in leaves_list(linkage(squareform(distance, checks=False), "average"))]


def _draw_waterfall(analysis: Analysis, findings: Findings) -> Figure | None:
    del analysis
    if findings.validation is None:
        return None
    steps = findings.validation.steps
    figure, axes = _bars(len(steps), "root mean square error, in units of the scatter")
    for position, (name, size) in enumerate(steps):
        colour = {"base": style.ENCODERS, "base fitted": style.pale(style.ENCODERS), "noise": style.COMMANDED}
        axes.barh(position, size, color=colour.get(name, style.ESTIMATE))
        axes.text(size, position, f" {size:.2f}", va="center", fontsize=9)
    axes.axvline(1.0, color=style.TRUTH, linewidth=1.0)
    labels = {"base": "before", "base fitted": "parameters fitted", "noise": "scatter"}
    _label_rows(axes, [labels.get(name, f"with {name}") for name, _ in steps])
    return figure


def _draw_pulls(analysis: Analysis, findings: Findings) -> Figure | None:
    start, best = findings.prepared.start, findings.best
    names = [
        item.name for item in analysis.model.parameters if ("", item.name) in {f.key for f in start.free}
    ]
    if not names:
        return None
    figure, axes = _bars(len(names), "prior standard deviations")
    sides = [(start, style.ENCODERS, "without effect", -0.18)]
    if best is not None:
        sides.append((best.fit, style.ESTIMATE, "with effects", 0.18))
    for fitted, colour, label, shift in sides:
        pulls = {
            item.key[1]: pull for item, pull in zip(fitted.free, fitted.pull, strict=True) if not item.key[0]
        }
        positions = [position + shift for position, name in enumerate(names) if name in pulls]
        values = [float(pulls[name]) for name in names if name in pulls]
        axes.barh(positions, values, height=0.34, color=colour, label=label)
    for edge in (-2.0, 2.0):
        axes.axvline(edge, color=style.ALARM, linestyle=(0, (4, 2)), linewidth=1.0)
    reach = max(2.5, *(math.ceil(abs(value)) for value in start.pull))
    axes.set_xlim(-reach, reach)
    _label_rows(axes, names)
    axes.legend(loc="best")
    return figure


def _bars(count: int, label: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(style.WIDTH_IN, 0.9 + 0.3 * count), layout="constrained")
    axes = figure.add_subplot(xlabel=label)
    axes.grid(visible=False, axis="y")
    return figure, axes


def _label_rows(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)


PICTURES: Sequence[tuple[str, str, Callable[[Analysis, Findings], Figure | None]]] = (
    (
        "Measured against simulated",
        "Dots are runs, hollow if they were locked; the band is the scatter of one run. The orange line is "
        "the simulation without the effects, the blue one with them.",
        residual_figures.draw_overlay,
    ),
    (
        "Where they differ",
        "Measured minus simulated in units of the scatter, before and after, on one scale; white is "
        "agreement.",
        residual_figures.draw_maps,
    ),
    (
        "Scores of the effects",
        "Score of each effect, after base parameters have absorbed what they can. Only bars beyond the "
        "line are significant: without a gap, none reaches it in 995 of 1000 experiments.",
        _draw_scores,
    ),
    (
        "What could be confused",
        "Similarity of two effects in these runs: at +1 or -1 no analysis can distinguish them.",
        _draw_confusion,
    ),
    (
        "From the base model to the noise",
        "Error on the locked runs over all channels, in units of the scatter; 1 is perfect.",
        _draw_waterfall,
    ),
    (
        "Base parameters",
        "Distance of each fitted base parameter from its prior, in prior standard deviations. Beyond 2 it "
        "compensates another effect.",
        _draw_pulls,
    ),
)
