"""The table of traverses against a second implementation."""

import math

import numpy as np
import pytest

from rover_hil.terrain.setup import Choice
from rover_hil.terrain.traverse import Traverse, solve_traverses
from sim_backends.terramechanics.soil.numpy_kernel import numpy_kernel
from tests.rover_hil.terrain import terrain_reference

CONDITIONS = [
    (10.0, 0.0, 23.8),
    (10.0, 15.0, 23.8),
    (15.0, 20.0, 23.8),
    (20.0, 0.0, 23.8),
    (20.0, 15.0, 33.8),
]
AWAY = np.array([1.1, 0.9, 1.05, 0.95])


def traverse(slope_deg: float, roll_deg: float, mass_kg: float) -> Traverse:
    rover, soil = Choice("paper_001", None, "toyoura").load()
    (state,) = solve_traverses(rover, soil, [slope_deg], [roll_deg], [mass_kg], numpy_kernel)
    return state


@pytest.mark.parametrize(
    "condition",
    [CONDITIONS[-1], *(pytest.param(condition, marks=pytest.mark.nightly) for condition in CONDITIONS[:-1])],
)
def test_traverse_agrees_with_adaptive_quadrature_and_a_general_solver(
    condition: tuple[float, float, float],
) -> None:
    state = traverse(*condition)
    assert state.slip is not None
    assert state.slip_angle_deg is not None
    assert state.sinkage_uphill_m is not None
    assert state.sinkage_downhill_m is not None
    found = np.array(
        [
            state.slip,
            math.radians(state.slip_angle_deg),
            state.sinkage_uphill_m,
            state.sinkage_downhill_m,
        ]
    )
    expected = terrain_reference.solve(*condition, start=found * AWAY)
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_boundary_has_thrust_to_spare_in_the_second_implementation_too() -> None:
    state = traverse(15.0, 15.0, 23.8)
    assert state.boundary
    assert (state.slip, state.slip_angle_deg) == (0.0, 0.0)
    unknown = np.array([0.0, 0.0, state.sinkage_uphill_m, state.sinkage_downhill_m])
    angle = math.radians(15.0)
    forward, side, uphill, downhill = terrain_reference.missing(unknown, angle, angle, 23.8)
    assert 1e-3 < forward < 0.044
    assert max(abs(side), abs(uphill), abs(downhill)) < 1e-8
