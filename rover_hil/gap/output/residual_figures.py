"""Measured and simulated values, before and after, for a gap report."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_hil.gap.data.problem import Point, predict_rows
from rover_hil.gap.findings import Analysis, Findings
from rover_hil.pages import style
from sim_backends.models.interface import Array, Channel, Run

MOST_CHANNELS = 3
MOST_PANELS = 4
MOST_SERIES = 4
TIME_BINS = 24
LEAST_SCALE = 3.0


def draw_overlay(analysis: Analysis, findings: Findings) -> Figure | None:
    """Draw measured and simulated values over the condition with most levels, or over time."""
    channels = _worst_channels(findings)
    if findings.prepared.problem.observations.is_steady:
        return _overlay_conditions(analysis, findings, channels)
    return _overlay_series(analysis, findings, channels)


def draw_maps(analysis: Analysis, findings: Findings) -> Figure | None:
    """Draw residuals in units of the scatter, before and after, on one colour scale."""
    channels = _worst_channels(findings)
    sides = _sides(findings)
    names = [name for name, _, _ in sides]
    steady = findings.prepared.problem.observations.is_steady
    tables = [
        [
            _map(analysis, findings, channel, point) if steady else _time_map(findings, channel, point)
            for _, _, point in sides
        ]
        for channel in channels
    ]
    rows = len(tables[0][0][1])
    height = len(channels) * (0.8 + 0.2 * rows) + 0.6
    figure = Figure(figsize=(style.WIDTH_IN, min(height, 12.0)), layout="constrained")
    grid = figure.subplots(len(channels), len(sides), squeeze=False, sharey=True)
    most = max(float(np.nanmax(np.abs(table))) for one in tables for table, _, _, _ in one)
    scale = max(LEAST_SCALE, most)
    image = None
    for row, channel in enumerate(channels):
        for column, (table, row_labels, labels, label) in enumerate(tables[row]):
            axes: Axes = grid[row, column]
            image = axes.imshow(table, cmap="RdBu_r", vmin=-scale, vmax=scale, aspect="auto")
            axes.grid(visible=False)
            axes.set_title(f"{channel.name}, {names[column]}", fontsize=9)
            axes.set_yticks(range(len(row_labels)), row_labels, fontsize=7)
            step = max(1, len(labels) // 8)
            axes.set_xticks(range(0, len(labels), step), labels[::step], fontsize=8)
            if row == len(channels) - 1:
                axes.set_xlabel(label)
    if image is not None:
        figure.colorbar(image, ax=grid, label="measured minus simulated, in units of the scatter", shrink=0.8)
    return figure


def _shown(analysis: Analysis) -> list[Run]:
    """Return the runs to draw, without those that stayed locked."""
    locked = set(analysis.plan.confirm) if analysis.plan is not None else set()
    opened = analysis.findings is not None and analysis.findings.validation is not None
    return [run for run in analysis.runs if opened or run.name not in locked]


def _sides(findings: Findings) -> list[tuple[str, str, Point]]:
    sides: list[tuple[str, str, Point]] = [("before", style.ENCODERS, {})]
    if findings.best is not None:
        sides.append(("after", style.ESTIMATE, findings.best.fit.point))
    else:
        sides.append(("parameters fitted", style.ESTIMATE, findings.prepared.start.point))
    return sides


def _worst_channels(findings: Findings) -> list[Channel]:
    problem = findings.prepared.problem
    error = (problem.observations.values - problem.predict({})) / findings.prepared.noise.row_sd
    size = [
        float(np.sqrt(np.nanmean(error[problem.observations.channel == index] ** 2)))
        if np.any(problem.observations.channel == index)
        else 0.0
        for index in range(len(problem.observations.channels))
    ]
    order = np.argsort(size)[::-1][:MOST_CHANNELS]
    return [problem.observations.channels[int(index)] for index in order]


def _abscissa(analysis: Analysis) -> tuple[str, list[str]]:
    """Return the condition to draw over, and the others that vary."""
    levels = {
        name: len({run.conditions[name] for run in _shown(analysis)})
        for name in analysis.model.condition_units
    }
    first = max(levels, key=lambda name: levels[name])
    return first, [name for name, count in levels.items() if name != first and count > 1]


def _panels(analysis: Analysis) -> tuple[str, dict[tuple[float, ...], list[Run]], list[str]]:
    first, others = _abscissa(analysis)
    panels: dict[tuple[float, ...], list[Run]] = {}
    for run in _shown(analysis):
        panels.setdefault(tuple(run.conditions[name] for name in others), []).append(run)
    for runs in panels.values():
        runs.sort(key=lambda run: run.conditions[first])
    return first, dict(sorted(panels.items())), others


def _overlay_conditions(analysis: Analysis, findings: Findings, channels: Sequence[Channel]) -> Figure | None:
    first, panels, others = _panels(analysis)
    chosen = list(panels)[:: max(1, math.ceil(len(panels) / MOST_PANELS))]
    figure = Figure(figsize=(style.WIDTH_IN, 1.9 * len(channels) + 0.7), layout="constrained")
    grid = figure.subplots(len(channels), len(chosen), squeeze=False, sharex=True, sharey="row")
    locked = set(analysis.plan.confirm) if analysis.plan is not None else set()
    for row, channel in enumerate(channels):
        for column, key in enumerate(chosen):
            axes = grid[row, column]
            _one_panel(axes, findings, channel, first, panels[key], locked)
            if row == 0:
                names = [f"{name} {value:g}" for name, value in zip(others, key, strict=True)]
                axes.set_title("\n".join(names), fontsize=8)
            if column == 0:
                axes.set_ylabel(
                    f"{channel.name}\n({channel.unit})" if channel.unit != "1" else channel.name, fontsize=8
                )
            axes.tick_params(labelsize=8)
    figure.supxlabel(f"{first} ({analysis.model.condition_units[first]})", fontsize="medium", color="#374151")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


def _one_panel(
    axes: Axes, findings: Findings, channel: Channel, first: str, runs: Sequence[Run], locked: set[str]
) -> None:
    model = findings.prepared.problem.model
    sd = _single_sd(findings, channel)
    x = np.array([run.conditions[first] for run in runs])
    for name, colour, point in _sides(findings):
        tables = [_channel_value(predict_rows(model, [run], point), run, findings, channel) for run in runs]
        y = np.array(tables)
        axes.plot(x, y, color=colour, label=name)
        axes.fill_between(x, y - 2.0 * sd, y + 2.0 * sd, color=colour, alpha=0.15, linewidth=0)
    for is_locked in (False, True):
        chosen = [run for run in runs if (run.name in locked) == is_locked and channel.name in run.measured]
        if chosen:
            axes.plot(
                [run.conditions[first] for run in chosen],
                [run.measured[channel.name][0] for run in chosen],
                "o",
                markersize=3.5,
                color=style.TRUTH,
                markerfacecolor="white" if is_locked else style.TRUTH,
                label="locked" if is_locked else "measured",
                zorder=3,
            )


def _channel_value(rows: Array, run: Run, findings: Findings, channel: Channel) -> float:
    names = [item.name for item in findings.prepared.problem.model.channels if item.name in run.measured]
    return float(rows[names.index(channel.name)]) if channel.name in names else math.nan


def _single_sd(findings: Findings, channel: Channel) -> float:
    prepared = findings.prepared
    index = [item.name for item in prepared.problem.observations.channels].index(channel.name)
    if prepared.scatter is not None:
        return float(np.sqrt(prepared.scatter.covariance[:, index, index].mean()))
    return float(prepared.noise.row_sd[prepared.problem.observations.channel == index].mean())


def _overlay_series(analysis: Analysis, findings: Findings, channels: Sequence[Channel]) -> Figure | None:
    model = analysis.model
    locked = set(analysis.plan.confirm) if analysis.plan is not None else set()
    chosen = sorted(_shown(analysis), key=lambda run: run.name not in locked)[:MOST_SERIES]
    figure = Figure(figsize=(style.WIDTH_IN, 1.5 * len(chosen) + 0.7), layout="constrained")
    grid = figure.subplots(len(chosen), 1, squeeze=False, sharex=False)[:, 0]
    channel = channels[0]
    for axes, run in zip(grid, chosen, strict=True):
        x = run.inputs.get("t_s", np.arange(run.measured[channel.name].size, dtype=np.float64))
        axes.plot(x, run.measured[channel.name], color=style.TRUTH, linewidth=0.8, label="measured")
        for name, colour, point in _sides(findings):
            rows = predict_rows(model, [run], point)
            start = 0
            for item in model.channels:
                if item.name == channel.name:
                    break
                start += run.measured[item.name].size if item.name in run.measured else 0
            y = rows[start : start + run.measured[channel.name].size]
            sd = _single_sd(findings, channel)
            axes.plot(x, y, color=colour, linewidth=1.2, label=name)
            axes.fill_between(x, y - 2.0 * sd, y + 2.0 * sd, color=colour, alpha=0.15, linewidth=0)
        axes.set_title(run.name + (", locked" if run.name in locked else ""), fontsize=8)
        axes.tick_params(labelsize=8)
    figure.supxlabel(
        "time (s)" if "t_s" in chosen[0].inputs else "sample", fontsize="medium", color="#374151"
    )
    figure.supylabel(f"{channel.name} ({channel.unit})", fontsize="medium", color="#374151")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


Table = tuple[Array, list[str], list[str], str]


def _map(analysis: Analysis, findings: Findings, channel: Channel, point: Point) -> Table:
    first, panels, others = _panels(analysis)
    levels = sorted({run.conditions[first] for run in _shown(analysis)})
    sd = _single_sd(findings, channel)
    table = np.full((len(panels), len(levels)), np.nan)
    for row, runs in enumerate(panels.values()):
        for column, level in enumerate(levels):
            here = [run for run in runs if run.conditions[first] == level and channel.name in run.measured]
            if here:
                rows = predict_rows(analysis.model, here[:1], point)
                simulated = _channel_value(rows, here[0], findings, channel)
                measured = float(np.mean([run.measured[channel.name][0] for run in here]))
                table[row, column] = (measured - simulated) / sd
    labels = [
        ", ".join(f"{name} {value:g}" for name, value in zip(others, key, strict=True)) for key in panels
    ]
    return (
        table,
        labels,
        [f"{level:g}" for level in levels],
        f"{first} ({analysis.model.condition_units[first]})",
    )


def _time_map(findings: Findings, channel: Channel, point: Point) -> Table:
    problem = findings.prepared.problem
    observations = problem.observations
    index = [item.name for item in observations.channels].index(channel.name)
    residual = observations.values - problem.predict(point)
    sd = _single_sd(findings, channel)
    table = np.full((len(observations.groups), TIME_BINS), np.nan)
    for site in range(len(observations.groups)):
        series = residual[(observations.site == site) & (observations.channel == index)]
        for part_number, part in enumerate(np.array_split(series, TIME_BINS)):
            if np.isfinite(part).any():
                table[site, part_number] = float(np.nanmean(part)) / sd
    labels = [group.site.name for group in observations.groups]
    return (
        table,
        labels,
        [f"{part_number / TIME_BINS:.0%}" for part_number in range(TIME_BINS)],
        "part of the run",
    )
