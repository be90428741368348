"""Fit the surfaces of the simulated Robotino to measured runs; print them as `surfaces.toml` has them.

    python -m benchmarks.robotino.fit ../shared/data/robotino_2023 ../shared/data/robotino_2021

Fitted are traction and resistance of each surface and, first, the centre of mass, all to every second
cell: directions 0, 20, 40 ... degrees; `benchmarks.robotino.plant` checks on the others. Of the 2021 runs
(blue, red) every second command is used, with a centre of mass of its own: the robot was loaded differently.
Red is soft: it gets the resistance of blue and a sinkage.
"""

import argparse
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize_scalar

from benchmarks.robotino.cells import Cell, measured_cells, measured_cells_2021, simulated
from sim_backends.plants.robotino.surfaces import Surface, shipped_surfaces

Floats = NDArray[np.float64]
Simulate = Callable[[Cell, Floats], Cell]

DURATION_S = 2.0
TOLERANCE = 0.15
LARGEST_MISFIT = 4.0
TABLE_FRICTION = 0.7
TABLE_STIFFNESS = 25.0
CENTRE_OF_MASS_2021_M = -0.0125
RED_SINKAGE_M = 0.0086
NAMES = ("friction", "stiffness", "drag_along", "drag_across")


def used_for_fitting(cell: Cell) -> bool:
    """Return whether a cell of 2023 is used for fitting; the others are the check."""
    return cell.direction_deg % 20 == 0


def misfit(measured: Cell, model: Cell) -> list[float]:
    """Return errors in units of 15 per cent; those per wheel and in yaw count less."""
    speed = max(measured.true_speed_m_s, 0.25 * measured.encoder_speed_m_s, 0.01)
    velocity = (model.velocity[:2] - measured.velocity[:2]) / speed
    turning = 0.125 * (model.velocity[2] - measured.velocity[2]) / max(speed, 0.03)
    mean_a = measured.current_a.mean()
    currents = (model.current_a - measured.current_a) / mean_a
    errors = [*velocity, 0.5 * turning, currents.mean(), *(0.3 * currents)]
    return [min(max(float(error) / TOLERANCE, -LARGEST_MISFIT), LARGEST_MISFIT) for error in errors]


def fit(cells: Sequence[Cell], start: Sequence[float], simulate: Simulate) -> tuple[Floats, float]:
    """Return the parameters that fit best, and the cost; they are varied as logarithms."""

    def residuals(logarithms: Floats) -> list[float]:
        parameters = np.exp(logarithms)
        return [error for cell in cells for error in misfit(cell, simulate(cell, parameters))]

    best = least_squares(residuals, np.log(start), diff_step=0.02, max_nfev=12, loss="soft_l1", xtol=1e-3)
    return np.exp(best.x), float(best.cost)


def fit_surface(cells: Sequence[Cell], centre_of_mass_x_m: float) -> tuple[dict[str, float], float]:
    """Fit traction and resistance of one surface; on the table only the resistance can be determined."""
    known = shipped_surfaces()[cells[0].surface]
    fixed = [TABLE_FRICTION, TABLE_STIFFNESS] if cells[0].surface == "table" else []

    def simulate(cell: Cell, parameters: Floats) -> Cell:
        values = dict(zip(NAMES, [*fixed, *parameters.tolist()], strict=True))
        return simulated(cell, Surface(**values), 0.0, centre_of_mass_x_m, DURATION_S)

    start = [getattr(known, name) for name in NAMES[len(fixed) :]]
    parameters, cost = fit(cells, start, simulate)
    return dict(zip(NAMES, [*fixed, *parameters.tolist()], strict=True)), cost


def fit_soft(cells: Sequence[Cell], firm: dict[str, float]) -> dict[str, float]:
    """Fit friction, stiffness and sinkage of red, with the resistance of a firm surface."""
    drags = {name: firm[name] for name in ("drag_along", "drag_across")}

    def simulate(cell: Cell, parameters: Floats) -> Cell:
        friction, stiffness, sinkage_m = parameters.tolist()
        surface = Surface(friction=friction, stiffness=stiffness, **drags)
        return simulated(cell, surface, sinkage_m, CENTRE_OF_MASS_2021_M, DURATION_S)

    (friction, stiffness, sinkage_m), cost = fit(cells, [0.5, 2.7, 0.009], simulate)
    return {"friction": friction, "stiffness": stiffness, **drags, "sinkage_m": sinkage_m, "cost": cost}


def main() -> None:
    """Print the fitted values as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data_2023", type=Path)
    parser.add_argument("data_2021", type=Path)
    arguments = parser.parse_args()
    scale, cells = measured_cells(arguments.data_2023)
    used = [cell for cell in cells if used_for_fitting(cell)]
    of = {name: [cell for cell in used if cell.surface == name] for name in {cell.surface for cell in used}}

    def cost_of(centre_of_mass_x_m: float) -> float:
        costs = [fit_surface(of[name][::3], centre_of_mass_x_m)[1] for name in ("gray", "green")]
        return math.fsum(costs)

    centre_m = float(minimize_scalar(cost_of, bounds=(-0.04, -0.01), options={"maxiter": 6}).x)
    result: dict[str, object] = {"scale_mm_per_px": scale, "centre_of_mass_x_m": centre_m}
    for name in sorted(of):
        result[name], cost = fit_surface(of[name], centre_m)
        print(json.dumps({name: result[name], "cost": cost}), flush=True)
    earlier = measured_cells_2021(arguments.data_2021, scale)[::2]
    blue, cost = fit_surface([cell for cell in earlier if cell.surface == "blue"], CENTRE_OF_MASS_2021_M)
    result["blue"] = blue
    result["red"] = fit_soft([cell for cell in earlier if cell.surface == "red"], blue)
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
