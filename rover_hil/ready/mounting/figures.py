"""Pictures of a calibration of mounting and scale."""

import math

import numpy as np
from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.ready.mounting.fit import MountingFit
from rover_hil.ready.mounting.record import InertialTurns


def draw_turns(record: InertialTurns, fit: MountingFit) -> Figure:
    """Draw the yaw rate about the axis that was found, with the turns that were used."""
    figure = Figure(figsize=(style.WIDTH_IN, 2.8), layout="constrained")
    axes = figure.subplots()
    for turn in fit.turns:
        axes.axvspan(turn.start_s, turn.end_s, color=style.ESTIMATE, alpha=0.12, linewidth=0)
    rate = np.degrees(fit.scale * np.nan_to_num(record.rate_rad_s) @ fit.up)
    axes.plot(record.t_s, rate, color=style.ESTIMATE, linewidth=0.8)
    axes.set(xlabel="time (s)", ylabel="yaw rate (deg/s)")
    return figure


def draw_residuals(fit: MountingFit) -> Figure:
    """Draw what the gyro missed in each turn, before and after scaling."""
    figure = Figure(figsize=(style.WIDTH_IN, 2.8), layout="constrained")
    axes = figure.subplots()
    along = np.array([turn.angle_rad @ fit.up for turn in fit.turns])
    numbers = np.arange(1, len(along) + 1)
    axes.axhline(0.0, color=style.COMMANDED, linewidth=1.0)
    axes.plot(numbers, np.degrees(along - fit.known_rad), "o", color=style.ENCODERS, label="as read")
    axes.plot(
        numbers, np.degrees(fit.scale * along - fit.known_rad), "o", color=style.ESTIMATE, label="scaled"
    )
    axes.set(xlabel="turn", ylabel="gyro - known (deg)", xticks=numbers)
    axes.legend()
    return figure


def draw_axis(fit: MountingFit) -> Figure:
    """Draw the axis of each turn and gravity about the axis that was found."""
    figure = Figure(figsize=(style.WIDTH_IN, 3.6), layout="constrained")
    axes = figure.subplots()
    first = np.cross(fit.up, np.eye(3)[int(np.argmin(np.abs(fit.up)))])
    first /= np.linalg.norm(first)
    second = np.cross(fit.up, first)
    for number, turn in enumerate(fit.turns):
        axis = turn.angle_rad * math.copysign(1.0, fit.known_rad[number])
        axis = axis / np.linalg.norm(axis)
        axes.plot(
            math.degrees(axis @ first), math.degrees(axis @ second), "o", color=style.ESTIMATE,
            label="axis of a turn" if number == 0 else None,
        )  # fmt: skip
    if np.isfinite(fit.gravity).all():
        axes.plot(
            math.degrees(fit.gravity @ first), math.degrees(fit.gravity @ second), "x", color=style.ENCODERS,
            label="gravity at rest",
        )  # fmt: skip
    axes.plot(0.0, 0.0, "+", color=style.COMMANDED, markersize=12, label="axis found")
    axes.set(xlabel="tilt (deg)", ylabel="tilt (deg)", aspect="equal")
    axes.legend()
    return figure
