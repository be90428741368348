"""Pictures of a calibrated compass: the field, the deviation, and the error on held-out turns."""

import numpy as np
from matplotlib.figure import Figure

from drivers.heading_calibration import DeviationTable, MagnetometerCalibration
from rover_hil.drives.arrays import Array
from rover_hil.pages import style
from rover_hil.ready.compass.fit import CompassFit

MOST_DOTS = 3000


def draw_field(fit: CompassFit) -> Figure | None:
    """Draw the horizontal field in the sensor before and after calibration; None for a compass."""
    if not len(fit.raw_counts):
        return None
    raw = fit.raw_counts[thin(len(fit.raw_counts))]
    figure = Figure(figsize=(style.WIDTH_IN, 3.6), layout="constrained")
    before, after = figure.subplots(1, 2)
    before.plot(raw[:, 0], raw[:, 1], ".", color=style.TRUTH, markersize=2)
    before.plot(0, 0, "+", color=style.ALARM, markersize=10, label="no field")
    before.set(title="as measured", xlabel="x (counts)", ylabel="y (counts)", aspect="equal")
    before.legend()
    if isinstance(fit.calibration, MagnetometerCalibration):
        field = np.array([fit.calibration.apply((x, y, z)) for x, y, z in raw.tolist()])
        after.plot(field[:, 0], field[:, 1], ".", color=style.ESTIMATE, markersize=2)
        angle = np.linspace(0.0, 2.0 * np.pi, 200)
        after.plot(
            fit.strength_counts * np.cos(angle), fit.strength_counts * np.sin(angle), color=style.COMMANDED
        )
        after.plot(0, 0, "+", color=style.ALARM, markersize=10)
    after.set(title="calibrated", xlabel="x (counts)", aspect="equal")
    return figure


def draw_deviation(fit: CompassFit) -> Figure | None:
    """Draw the deviation over the reading; None for a magnetometer."""
    table = fit.calibration
    if not isinstance(table, DeviationTable):
        return None
    figure = Figure(figsize=(style.WIDTH_IN, 3.0), layout="constrained")
    axes = figure.subplots()
    axes.plot(table.heading_deg, table.deviation_deg, "o-", color=style.ESTIMATE, markersize=3)
    axes.set(xlabel="reading (deg)", ylabel="deviation, added (deg)", xticks=range(0, 361, 45))
    return figure


def draw_errors(fit: CompassFit) -> Figure:
    """Draw the error over the heading, before and after."""
    figure = Figure(figsize=(style.WIDTH_IN, 5.0), layout="constrained")
    before, after = figure.subplots(2, 1, sharex=True)
    _dots(before, fit.before_heading_deg, fit.before_deg, style.TRUTH)
    before.set(title="without calibration", ylabel="error (deg)")
    _dots(after, fit.heading_deg, fit.error_deg, style.ESTIMATE)
    after.set(
        title="with a calibration that did not see the turn",
        xlabel="compass heading (deg)",
        ylabel="error (deg)",
        xticks=range(0, 361, 45),
    )
    return figure


def _dots(axes: object, heading_deg: Array, error_deg: Array, colour: str) -> None:
    keep = thin(len(heading_deg))
    axes.plot(heading_deg[keep], error_deg[keep], ".", color=colour, markersize=2)  # type: ignore[attr-defined]


def thin(count: int) -> slice:
    """Return every so many, so that a page stays small."""
    return slice(None, None, max(1, count // MOST_DOTS))
