"""Pictures of wheels in slip and skid, as figures 5 to 8 of paper 002."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rover_hil.terrain.figures import COLOURS, legend, plots
from sim_backends.terramechanics.soil.library import load_soil, load_wheel
from sim_backends.terramechanics.soil.skid_from_slip import (
    drawbar_pull_in_skid_n,
    resistance_moment_in_skid_nm,
)
from sim_backends.terramechanics.soil.slip_skid_model import (
    RESISTANCE_LIMIT,
    TESTED_LOAD_N,
    drawbar_pull_n,
    resistance_moment_nm,
    shipped_wheels,
    sinkage_m,
)
from sim_backends.terramechanics.soil.wheel_forces import wheel_at_load

Floats = NDArray[np.float64]
TESTED_SLIP = (-1.0, 0.6)
LUGGED = ("Wh31", "Wh32")
SMOOTH = "Wh34"


def draw_measured() -> Figure:
    """Draw sinkage, torque and drawbar pull by the measured lines (figures 5 and 7)."""
    figure, panels = _three("sinkage (mm)", "torque (N m)", "drawbar pull (N)")
    _draw_lines(panels, _slips())
    return legend(figure, panels[1])


def draw_coefficients() -> Figure:
    """Draw tractive, drawbar pull and resistance coefficient (figure 6)."""
    figure, panels = _three("tractive coefficient", "drawbar pull coefficient", "resistance coefficient")
    slip = _slips()
    near = slip[np.abs(slip) <= RESISTANCE_LIMIT]
    for colour, (name, wheel) in zip(COLOURS, shipped_wheels().items(), strict=False):
        panels[0].plot(slip, wheel.moment.at(slip), color=colour, label=name)
        panels[1].plot(slip, wheel.drawbar_pull.at(slip), color=colour, label=name)
        panels[2].plot(near, wheel.resistance.at(near), color=colour, label=name)
    panels[2].set_ylim(bottom=0.0)
    return legend(figure, panels[0])


def draw_law() -> Figure:
    """Draw the wheel law of paper 001 on HIT-LSS1 with the measured lines (figure 7)."""
    figure, panels = _three("sinkage (mm)", "torque (N m)", "drawbar pull (N)")
    slip = np.linspace(-0.95, TESTED_SLIP[1], 78)
    soil = load_soil("hit_lss1")
    law_depth, law = wheel_at_load(load_wheel(SMOOTH.lower()), soil, load_n=TESTED_LOAD_N, slip=slip)
    for axes, values in zip(panels, (1000.0 * law_depth, law.torque_nm, law.drawbar_n), strict=True):
        axes.plot(slip, values, color="black", linestyle="--", label=f"{SMOOTH}, law")
    _draw_lines(panels, slip)
    return legend(figure, panels[1])


def draw_skid_from_slip() -> Figure:
    """Draw torque and drawbar pull in skid, measured and predicted from slip (figure 8)."""
    figure, panels = plots(1, 2, 3.0)
    slip = np.linspace(-1.0, 0.0, 101)
    for colour, name in zip(COLOURS, LUGGED, strict=False):
        wheel = shipped_wheels()[name]
        for axes, predicted, measured in (
            (panels[0], resistance_moment_in_skid_nm(wheel, slip), resistance_moment_nm(wheel, slip)),
            (panels[1], drawbar_pull_in_skid_n(wheel, slip), drawbar_pull_n(wheel, slip)),
        ):
            axes.plot(slip, predicted, color=colour, linestyle="--", label=f"{name}, from slip")
            axes.plot(slip, measured, color=colour, label=f"{name}, measured lines")
    for axes, label in zip(panels, ("torque (N m)", "drawbar pull (N)"), strict=True):
        axes.set_xlabel("slip ratio")
        axes.set_ylabel(label)
    return legend(figure, panels[0], 2)


def _draw_lines(panels: list[Axes], slip: Floats) -> None:
    for colour, (name, wheel) in zip(COLOURS, shipped_wheels().items(), strict=False):
        if wheel.sinkage_mm is not None:
            panels[0].plot(slip, 1000.0 * sinkage_m(wheel, slip), color=colour, label=name)
        panels[1].plot(slip, resistance_moment_nm(wheel, slip), color=colour, label=name)
        panels[2].plot(slip, drawbar_pull_n(wheel, slip), color=colour, label=name)


def _slips() -> Floats:
    return np.linspace(*TESTED_SLIP, 321)


def _three(*labels: str) -> tuple[Figure, list[Axes]]:
    figure, panels = plots(1, 3, 2.8)
    for axes, label in zip(panels, labels, strict=True):
        axes.set_xlabel("slip ratio")
        axes.set_title(label)
    return figure, panels
