"""The pictures of the report on a machine. Each is as wide as a phone; a wide screen shows two in a row."""

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.evidence.error_budget import ChannelError
from rover_hil.gap.output.series import Trace
from rover_hil.pages import style
from sim_backends.models.interface import Array

WIDTH_IN = 4.3
"""Of a drawing that a phone shows."""
SMALL = mpl.RcParams({"font.size": 9.0, "axes.titlesize": 9.0, "legend.fontsize": 8.0})
"""Sizes of text for pictures of this width."""
MOST_CHANNELS = 4
"""That a drawing shows."""
MOST_RUNS = 3
"""That a drawing shows."""
BAND_SD = 2.0
"""Half of the band of noise in a drawing, in standard deviations."""
TIME_BINS = 20
"""Columns of the map of errors."""
MANY = 2000
"""Samples from which a line is drawn as an image, which keeps the page small."""
LEAST_SCALE = 3.0
"""Error at which the scale of a map ends at least, in units of the sensor noise: noise stays pale."""
LOCKED = ", locked"
NO_VALUES = "#e5e7eb"


def draw_budget(before: ChannelError, after: ChannelError | None) -> Figure:
    """Draw the error budget of a channel as bars, with upper bounds and the tolerance."""
    rows = [("sensor noise", before.sensor_noise, math.nan, style.COMMANDED)]
    label = "model error" if after is None else "model error before"
    rows.append((label, before.model_error, before.upper, style.ENCODERS))
    if after is not None:
        rows.append(("model error after", after.model_error, after.upper, style.ESTIMATE))
    figure = Figure(figsize=(WIDTH_IN, 0.95 + 0.3 * len(rows)), layout="constrained")
    axes = figure.add_subplot(title=before.channel, xlabel=f"root mean square ({before.unit})")
    axes.grid(visible=False, axis="y")
    for position, (_, size, upper, colour) in enumerate(rows):
        axes.barh(position, size, height=0.6, color=colour)
        end = size
        if math.isfinite(upper):
            axes.plot([size, upper], [position, position], color=style.TRUTH, linewidth=1.2)
            axes.plot([upper], [position], "|", color=style.TRUTH, markersize=8)
            end = max(upper, size)
        axes.annotate(f"{size:.3g}", (end, position), (4, 0), textcoords="offset points", va="center")
    axes.axvline(before.tolerance, color=style.ALARM, linestyle=(0, (4, 2)), linewidth=1.2)
    axes.text(
        before.tolerance, -0.55, "tolerance", color=style.ALARM, ha="center", va="bottom", fontsize="small"
    )
    axes.margins(x=0.18)
    axes.set_xlim(left=0.0)
    axes.set_yticks(range(len(rows)), [name for name, *_ in rows])
    axes.set_ylim(len(rows) - 0.5, -1.1)
    return figure


def chosen_traces(findings: MachineFindings, shown: Sequence[Trace]) -> list[list[Trace]]:
    """Return the worst, the median, and a locked or the best run of each of the worst channels."""
    ranked = sorted(findings.budget_before, key=lambda one: -one.model_error / one.sensor_noise)
    found = []
    for budget in ranked[:MOST_CHANNELS]:
        own = [one for one in shown if one.channel.name == budget.channel]
        learned = sorted((one for one in own if not one.is_locked), key=_error)
        locked = sorted((one for one in own if one.is_locked), key=_error)
        if not learned:
            continue
        runs = [learned[-1], *([learned[(len(learned) - 1) // 2]] if len(learned) > 1 else [])]
        runs += locked[-1:] or learned[:1]
        found.append(list(dict.fromkeys(runs)))
    return found


def _error(trace: Trace) -> float:
    return float(np.nan_to_num(np.nanmean((trace.measured - trace.before) ** 2)))


def draw_trace(trace: Trace) -> Figure:
    """Draw measured and simulated values of a run, and the residuals below, with the sensor's band."""
    figure = Figure(figsize=(WIDTH_IN, 3.5), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    band = BAND_SD * trace.channel.noise_sd
    upper.set_title(f"{trace.channel.name}, {trace.run}{LOCKED if trace.is_locked else ''}")
    upper.set_ylabel(_with_unit(trace.channel.name, trace.channel.unit))
    lower.set_ylabel("residual" if trace.channel.unit == "1" else f"residual ({trace.channel.unit})")
    _line(upper, trace.times_s, trace.measured, style.TRUTH, "measured", 0.8)
    upper.fill_between(
        trace.times_s,
        trace.measured - band,
        trace.measured + band,
        color=style.COMMANDED,
        alpha=0.3,
        linewidth=0,
        label="sensor ±2 sd",
    )
    lower.axhspan(-band, band, color=style.COMMANDED, alpha=0.3, linewidth=0)
    sides = [("model" if trace.after is None else "before", trace.before, style.ENCODERS)]
    if trace.after is not None:
        sides.append(("after", trace.after, style.ESTIMATE))
    for label, values, colour in sides:
        _line(upper, trace.times_s, values, colour, label, 1.3)
        _line(lower, trace.times_s, trace.measured - values, colour, "", 1.0)
    lower.set_xlabel("time (s)")
    figure.legend(*upper.get_legend_handles_labels(), loc="outside lower center", ncols=4, columnspacing=1.2)
    return figure


def draw_agreement(shown: Sequence[Trace]) -> Figure | None:
    """Draw the measured values of one channel over the simulated ones, with the typical error."""
    if not shown:
        return None
    channel = shown[0].channel
    figure = Figure(figsize=(WIDTH_IN, 3.2), layout="constrained")
    axes = figure.add_subplot(title=channel.name, xlabel=_with_unit("simulated", channel.unit))
    axes.set_ylabel(_with_unit("measured", channel.unit))
    measured = np.concatenate([one.measured for one in shown])
    before = np.concatenate([one.before for one in shown])
    band = np.full(measured.size, BAND_SD * channel.noise_sd)
    has_after = all(one.after is not None for one in shown)
    sides = [("before" if has_after else "model", before, style.ENCODERS)]
    if has_after:
        after = np.concatenate([one.after for one in shown if one.after is not None])
        sides.append(("after", after, style.ESTIMATE))
    for label, values, colour in sides:
        axes.errorbar(
            values, measured, band, fmt="o", markersize=3, color=colour, elinewidth=0.6, label=label
        )
    ends = [float(np.nanmin(measured)), float(np.nanmax(measured))]
    axes.plot(ends, ends, color=style.COMMANDED, linewidth=1.0)
    axes.legend()
    return figure


def _line(axes: Axes, times_s: Array, values: Array, colour: str, label: str, width: float) -> None:
    is_image = times_s.size > MANY
    axes.plot(times_s, values, color=colour, label=label, linewidth=width, rasterized=is_image)


def draw_map(shown: Sequence[Trace], *, is_after: bool) -> Figure | None:
    """Draw the root mean square residual of one channel by run and time; None without values."""
    sides = [one.before for one in shown], [one.after for one in shown if one.after is not None]
    if is_after and not sides[1]:
        return None
    width_s = max(float(one.times_s[-1]) for one in shown) / TIME_BINS
    before, *after = [
        np.stack([_rms_by_time(one, values, width_s) for one, values in zip(shown, side, strict=True)])
        for side in sides
        if side
    ]
    channel = shown[0].channel
    greatest = max(float(np.nanmax(one)) for one in (before, *after))
    figure = Figure(figsize=(WIDTH_IN, 1.1 + 0.19 * len(shown)), layout="constrained")
    side = ", after" if is_after else ", before" if after else ""
    axes = figure.add_subplot(title=f"{channel.name}{side}", xlabel="time (s)")
    image = axes.imshow(
        after[0] if is_after else before,
        cmap=mpl.colormaps["YlOrRd"].with_extremes(under="white", bad=NO_VALUES),
        vmin=channel.noise_sd,
        vmax=max(greatest, LEAST_SCALE * channel.noise_sd),
        aspect="auto",
        extent=(0.0, TIME_BINS * width_s, len(shown) - 0.5, -0.5),
        interpolation="nearest",
    )
    axes.grid(visible=False)
    labels = [f"{one.run}{LOCKED if one.is_locked else ''}" for one in shown]
    axes.set_yticks(range(len(shown)), labels, fontsize=7)
    figure.colorbar(image, ax=axes, label=channel.unit if channel.unit != "1" else "", extend="min")
    return figure


def _rms_by_time(trace: Trace, simulated: Array, width_s: float) -> Array:
    squares = (trace.measured - simulated) ** 2
    where = np.minimum((trace.times_s / width_s).astype(np.intp), TIME_BINS - 1)
    good = np.isfinite(squares)
    counts = np.bincount(where[good], minlength=TIME_BINS)
    sums = np.bincount(where[good], weights=squares[good], minlength=TIME_BINS)
    found: Array = np.where(counts > 0, np.sqrt(sums / np.maximum(counts, 1)), np.nan)
    return found


def _with_unit(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name}\n({unit})"
