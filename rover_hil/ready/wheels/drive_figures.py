"""Pictures of the numbers that recorded drives show, and of what they are worth."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.ready.wheels.from_drives import GeometryResult, KindDifference
from rover_hil.ready.wheels.validation import trajectories


def draw_errors(result: GeometryResult) -> Figure | None:
    """Draw the error at the end of each validation drive, by kind of motion; None without such drives."""
    if not result.errors:
        return None
    errors = sorted(result.errors, key=lambda each: each.kind)
    has_yaw = not math.isnan(errors[0].end_rad[0])
    figure = Figure(figsize=(style.WIDTH_IN, 3.0 if not has_yaw else 4.6), layout="constrained")
    rows = figure.subplots(2 if has_yaw else 1, 1, sharex=True, squeeze=False)[:, 0]
    drives = np.arange(1, len(errors) + 1)
    for axes, unit, pairs in zip(
        rows,
        ("m", "deg"),
        (
            np.array([each.end_m for each in errors]),
            np.degrees(np.array([each.end_rad for each in errors])),
        ),
        strict=False,
    ):
        axes.plot(drives, pairs[:, 0], "o", color=style.ENCODERS, label="as described")
        axes.plot(drives, pairs[:, 1], "o", color=style.ESTIMATE, label="corrected")
        axes.set(ylabel=f"error at the end ({unit})", ylim=(0.0, max(1e-6, 1.15 * float(pairs.max()))))
        for place, kind in enumerate(each.kind for each in errors):
            if place == 0 or kind != errors[place - 1].kind:
                axes.axvline(place + 0.5, color=style.COMMANDED, linewidth=0.8)
                axes.annotate(kind, (place + 0.6, 1.0), xycoords=("data", "axes fraction"), va="top")
    rows[-1].set(xlabel="validation drive")
    rows[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure


def draw_kinds(differences: Sequence[KindDifference]) -> Figure | None:
    """Draw each number that differs by kind of motion with its intervals; None where none does."""
    if not differences:
        return None
    figure = Figure(figsize=(style.WIDTH_IN, 1.2 + 0.9 * len(differences)), layout="constrained")
    rows = figure.subplots(len(differences), 1, squeeze=False)[:, 0]
    for axes, each in zip(rows, differences, strict=True):
        factor, unit = (100.0, "%") if not each.number.unit else (math.degrees(1.0), "deg")
        for place, (value, half) in enumerate(each.values.values()):
            axes.errorbar(factor * value, place, xerr=factor * half, fmt="o", color=style.ESTIMATE, capsize=3)
        axes.axvline(0.0, color=style.COMMANDED, linewidth=0.8)
        axes.set(
            yticks=range(len(each.values)),
            yticklabels=list(each.values),
            ylim=(-0.5, len(each.values) - 0.5),
            xlabel=f"{each.number.name}, from the description ({unit})",
        )
    return figure


def draw_path(result: GeometryResult) -> Figure | None:
    """Draw the path of the validation drive with the greatest error; None without such drives."""
    if not result.errors:
        return None
    worst = max(result.errors, key=lambda each: each.end_m[0])
    truth_m, described_m, corrected_m = trajectories(worst, result.geometry)
    figure = Figure(figsize=(style.WIDTH_IN, 4.6), layout="constrained")
    axes = figure.add_subplot(aspect="equal", adjustable="datalim", xlabel="x (m)", ylabel="y (m)")
    axes.plot(described_m.real, described_m.imag, color=style.ENCODERS, label="wheels as described")
    axes.plot(truth_m.real, truth_m.imag, color=style.TRUTH, label=worst.drive.source)
    axes.plot(corrected_m.real, corrected_m.imag, color=style.ESTIMATE, linestyle="--", label="corrected")
    axes.legend()
    axes.set_title(f"{worst.drive.path.name}: {worst.kind}, {worst.way_m:.3g} m")
    return figure
