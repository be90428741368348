"""Pictures of the field of motor currents at a compass."""

import numpy as np
from matplotlib.figure import Figure

from rover_hil.pages import style
from rover_hil.ready.compass.figures import thin
from rover_hil.ready.motors.fit import MotorFieldFit


def draw_motor_fields(fit: MotorFieldFit) -> Figure:
    """Draw the field per ampere of each motor, with two standard deviations."""
    figure = Figure(figsize=(style.WIDTH_IN, 3.6), layout="constrained")
    axes = figure.add_subplot(aspect="equal", xlabel="ahead (per A)", ylabel="to the left (per A)")
    axes.plot(0, 0, "+", color=style.COMMANDED, markersize=10)
    field, sd = np.array(fit.fields.per_ampere), np.array(fit.fields.per_ampere_sd)
    for number, ((x, y), (x_sd, y_sd)) in enumerate(zip(field.tolist(), sd.tolist(), strict=True), start=1):
        axes.errorbar(x, y, xerr=2 * x_sd, yerr=2 * y_sd, color=style.ESTIMATE, fmt="o", markersize=4)
        axes.annotate(f"motor {number}", (x, y), xytext=(6, 6), textcoords="offset points")
    axes.set_adjustable("datalim")
    axes.margins(0.2)
    return figure


def draw_motor_errors(fit: MotorFieldFit) -> Figure:
    """Draw currents, and the errors of the held-out headings without and with them, over the time."""
    figure = Figure(figsize=(style.WIDTH_IN, 5.0), layout="constrained")
    currents, errors = figure.subplots(2, 1, sharex=True)
    keep = thin(len(fit.t_s))
    for number, current_a in enumerate(fit.current_a[keep].T, start=1):
        currents.plot(fit.t_s[keep], current_a, linewidth=0.7, label=f"motor {number}")
    currents.set(ylabel="current (A)")
    currents.legend(ncols=4)
    for values, colour, label in (
        (fit.before_deg, style.TRUTH, "without the currents"),
        (fit.after_deg, style.ESTIMATE, "with them"),
    ):
        errors.plot(fit.t_s[keep], values[keep], ".", color=colour, markersize=2, label=label)
    errors.set(ylabel="error of the heading (deg)", xlabel="time (s)")
    errors.legend()
    return figure
