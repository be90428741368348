"""Paper 001's steady states reproduced: `python -m benchmarks.terrain.side_slope_table`."""

import math

from sim_backends.terramechanics.slope.rover import Conditions, paper_rover
from sim_backends.terramechanics.slope.steady_state import solve_steady_state
from sim_backends.terramechanics.soil.library import load_soil

EXPECTED = {
    (1, 0): (0.0695, -6.289),
    (1, 5): (0.0327, -1.882),
    (1, 10): (0.0, 0.0),
    (1, 15): (0.0157, 1.174),
    (1, 20): (0.0364, 3.625),
    (2, 0): (0.1017, -12.446),
    (2, 5): (0.0677, -6.220),
    (2, 10): (0.0258, -1.631),
    (2, 15): (0.0, 0.0),
    (2, 20): (0.0067, 0.789),
}
"""Slip ratio and slip angle (deg) by condition and roll (deg), with Table III."""


def main() -> None:
    soil = load_soil("toyoura")
    print("condition  roll deg   slip     angle deg   expected         boundary")
    for (condition, roll), (slip, angle) in EXPECTED.items():
        slope = {1: 10.0, 2: 15.0}[condition]
        state = solve_steady_state(
            paper_rover(), soil, Conditions(slope_rad=math.radians(slope), roll_rad=math.radians(roll))
        )
        shown = math.degrees(state.slip_angle_rad)
        print(
            f"{condition:9} {roll:9} {state.slip:8.4f} {shown:11.3f}   {slip:.4f} {angle:8.3f}   "
            f"{state.boundary}"
        )


if __name__ == "__main__":
    main()
