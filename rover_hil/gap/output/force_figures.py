"""Pictures of the unknown force at a port: over time, and against each state."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from rover_hil.gap.output.figures import MOST_RUNS, WIDTH_IN
from rover_hil.gap.output.series import ForceTrace
from rover_hil.pages import style

NORMAL_95 = 1.96
"""Half of a 95 % interval of a normal distribution, in standard deviations."""


def draw_force_over_time(shown: Sequence[ForceTrace]) -> Figure:
    """Draw the force at one port in up to three runs with its 95 % band."""
    ranked = sorted(shown, key=lambda one: -float(np.mean(one.force**2)))[:MOST_RUNS]
    figure = Figure(figsize=(WIDTH_IN, 0.8 + 1.05 * len(ranked)), layout="constrained")
    rows = figure.subplots(len(ranked), 1, squeeze=False, sharey=True)[:, 0]
    for axes, one in zip(rows, ranked, strict=True):
        half = NORMAL_95 * one.sd
        axes.fill_between(
            one.times_s, one.force - half, one.force + half, color=style.GYRO, alpha=0.25, linewidth=0
        )
        axes.plot(one.times_s, one.force, color=style.GYRO, linewidth=1.3)
        axes.axhline(0.0, color=style.TRUTH, linewidth=0.8)
        axes.set_title(f"{one.port}, {one.run}")
    rows[-1].set_xlabel("time (s)")
    figure.supylabel(_label(ranked[0]), fontsize="medium", color="#374151")
    return figure


def draw_force_by_state(shown: Sequence[ForceTrace], state: str, unit: str) -> Figure:
    """Draw the force at one port in all runs against a state, with 95 % intervals."""
    figure = Figure(figsize=(WIDTH_IN, 2.7), layout="constrained")
    label = state if unit == "1" else f"{state} ({unit})"
    axes = figure.add_subplot(title=f"{shown[0].port} against {state}", xlabel=label, ylabel=_label(shown[0]))
    values = np.concatenate([one.sources[state] for one in shown])
    force = np.concatenate([one.force for one in shown])
    half = NORMAL_95 * np.concatenate([one.sd for one in shown])
    axes.errorbar(values, force, half, fmt="none", ecolor=style.pale(style.GYRO), elinewidth=0.7)
    axes.plot(values, force, "o", color=style.GYRO, markersize=2.5)
    axes.axhline(0.0, color=style.TRUTH, linewidth=0.8)
    return figure


def _label(trace: ForceTrace) -> str:
    return "force" if trace.unit == "1" else f"force ({trace.unit})"
