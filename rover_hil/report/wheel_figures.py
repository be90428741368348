"""Pictures of what the wheels did: slip, motor currents, speeds."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from rover_hil.report import style
from rover_hil.report.run_data import RunData, WheelData
from rover_hil.report.summary import Summary
from rover_hil.report.tracks import Series, slip_over_time

ROW_HEIGHT_IN = 1.15
TURNING_SHARE = 0.05
MEAN_WINDOW_S = 0.5


def draw_slip(run: RunData, summary: Summary) -> Figure | None:
    """Draw the true slip ratio of each wheel, or of the whole rover where that is all that is known."""
    slips = {wheel.name: slip for wheel in run.wheels if (slip := _slip_while_turning(wheel)) is not None}
    if not slips and run.truth is not None:
        slips = {"whole rover": slip_over_time(run.encoders, run.truth)}
    shown = {name: Series(slip.t_s, 100.0 * slip.value) for name, slip in slips.items()}
    return _draw_with_means(shown, style.TRUTH, "slip (%)", run, summary)


def draw_currents(run: RunData, summary: Summary) -> Figure | None:
    """Draw the motor current of each wheel."""
    currents = {wheel.name: wheel.current for wheel in run.wheels if wheel.current is not None}
    return _draw_with_means(currents, style.MEASURED, "current (A)", run, summary)


def draw_speeds(run: RunData, summary: Summary) -> Figure | None:
    """Draw set-point and measured speed of each wheel."""
    wheels = [wheel for wheel in run.wheels if wheel.speed is not None]
    if not wheels:
        return None
    figure, plots = style.rows(len(wheels), ROW_HEIGHT_IN, "speed (rad/s)")
    for axes, wheel in zip(plots, wheels, strict=True):
        axes.set_title(wheel.name)
        if wheel.set_point is not None:
            style.line(axes, wheel.set_point, style.pale(style.COMMANDED), "set-point", 4.0)
        if wheel.speed is not None:
            style.line(axes, wheel.speed, style.MEASURED, "measured")
    style.finish(figure, plots, run, summary)
    return figure


def _draw_with_means(
    values: Mapping[str, Series], colour: str, label: str, run: RunData, summary: Summary
) -> Figure | None:
    if not values:
        return None
    figure, plots = style.rows(len(values), ROW_HEIGHT_IN, label)
    for axes, (name, series) in zip(plots, values.items(), strict=True):
        axes.set_title(name)
        style.line(axes, series, style.pale(colour), "unsmoothed", 0.8)
        style.line(axes, _mean(series), colour, f"mean over {MEAN_WINDOW_S:g} s")
    style.finish(figure, plots, run, summary)
    return figure


def _mean(series: Series) -> Series:
    """Return the running mean over `MEAN_WINDOW_S`; NaN counts for nothing and stays NaN."""
    if len(series.t_s) < 2:
        return series
    period_s = float(np.median(np.diff(series.t_s)))
    window = np.ones(min(len(series.t_s), max(1, round(MEAN_WINDOW_S / period_s))))
    known = np.isfinite(series.value)
    total = np.convolve(np.where(known, series.value, 0.0), window, mode="same")
    count = np.convolve(known.astype(float), window, mode="same")
    return Series(series.t_s, np.where(known, total / np.maximum(count, 1.0), np.nan))


def _slip_while_turning(wheel: WheelData) -> Series | None:
    """Return the slip with NaN where the wheel hardly turns: a ratio of two small speeds says nothing."""
    slip, speed = wheel.slip, wheel.true_speed
    if slip is None or speed is None:
        return None
    speed_rad_s = np.abs(np.interp(slip.t_s, speed.t_s, speed.value))
    turns = speed_rad_s > TURNING_SHARE * speed_rad_s.max()
    return Series(slip.t_s, np.where(turns, slip.value, np.nan))
