"""A rover on a slope: the paper's states, its symmetries, its edges, and what has no steady state."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from benchmarks.terrain.adaptive_wheel import AdaptiveWheel
from drivers.errors import ModelError
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.terramechanics.slope.load_transfer import demand
from sim_backends.terramechanics.slope.rover import Conditions, Effects, SlopeRover, paper_rover
from sim_backends.terramechanics.slope.steady_state import SteadyState, solve_steady_state
from sim_backends.terramechanics.soil.compiled import compiled_kernel
from sim_backends.terramechanics.soil.library import load_soil, load_wheel
from sim_backends.terramechanics.soil.numpy_kernel import numpy_kernel

SAND = load_soil("toyoura")
EXPECTED = [
    (10, 0, 0.0695, -6.289, ""),
    (10, 5, 0.0327, -1.882, ""),
    (10, 10, 0.0, 0.0, "slip = 0"),
    (10, 15, 0.0157, 1.174, ""),
    (10, 20, 0.0364, 3.625, ""),
    (15, 0, 0.1017, -12.446, ""),
    (15, 5, 0.0677, -6.220, ""),
    (15, 10, 0.0258, -1.631, ""),
    (15, 15, 0.0, 0.0, "slip = 0"),
    (15, 20, 0.0067, 0.789, ""),
]


def paper_loads(
    weight_n: float, slope_rad: float, cog_height_m: float, uphill_m: float, downhill_m: float
) -> tuple[float, float]:
    """Return the loads of an uphill and a downhill wheel of four in a traverse, N (paper 001, eqs 3, 4)."""
    span = 2.0 * (uphill_m + downhill_m)
    lever = cog_height_m * math.tan(slope_rad)
    return weight_n * (downhill_m - lever) / span, weight_n * (uphill_m + lever) / span


def _traverse(slope_deg: float, roll_deg: float, mass_kg: float = 23.8, **options: float) -> SteadyState:
    conditions = Conditions(math.radians(slope_deg), math.radians(roll_deg), **options)
    return solve_steady_state(paper_rover(mass_kg), SAND, conditions, kernel=compiled_kernel)


@pytest.mark.parametrize(("slope_deg", "roll_deg", "slip", "angle_deg", "boundary"), EXPECTED)
def test_the_corrected_equations_of_the_paper(
    slope_deg: int, roll_deg: int, slip: float, angle_deg: float, boundary: str
) -> None:
    state = _traverse(slope_deg, roll_deg)
    assert state.equilibrium
    assert state.boundary == boundary
    assert state.slip == pytest.approx(slip, abs=5.1e-5)
    assert math.degrees(state.slip_angle_rad) == pytest.approx(angle_deg, abs=5.1e-4)


@pytest.mark.parametrize(
    ("slope_deg", "roll_deg", "mass_kg"), [(15, 0, 23.8), (20, 10, 33.8), (20, 15, 33.8)]
)
def test_states_balance_by_adaptive_quadrature(slope_deg: int, roll_deg: int, mass_kg: float) -> None:
    state = _traverse(slope_deg, roll_deg, mass_kg)
    slope, roll = math.radians(slope_deg), math.radians(roll_deg)
    weight = mass_kg * 9.80665
    wheel = AdaptiveWheel(
        load_wheel("paper_001"), SAND, camber_rad=roll, cross_slope_rad=slope, tolerance=1e-9
    )
    loads = paper_loads(weight, slope, 0.187, 0.275, 0.275)
    total = np.zeros(2)
    for sinkage, load in zip((state.sinkage_uphill_m, state.sinkage_downhill_m), loads, strict=True):
        forward, left, up, _ = wheel.forces(sinkage, state.slip, state.slip_angle_rad)
        assert up == pytest.approx(load * math.cos(slope - roll), rel=1e-7)
        total += 2.0 * np.array([forward, left])
    assert total == pytest.approx([0.0, weight * math.sin(slope - roll)], abs=1e-7 * weight)


@pytest.mark.parametrize(("slope_deg", "roll_deg"), [(0, 0), (10, 3), (15, 15), (20, 18), (20, 20), (5, 9)])
def test_numpy_and_compiled_find_the_same_state(slope_deg: int, roll_deg: int) -> None:
    conditions = Conditions(math.radians(slope_deg), math.radians(roll_deg))
    one, other = (
        solve_steady_state(paper_rover(), SAND, conditions, kernel=kernel)
        for kernel in (numpy_kernel, compiled_kernel)
    )
    assert one.boundary == other.boundary
    for name in ("slip", "slip_angle_rad", "sinkage_uphill_m", "sinkage_downhill_m"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-10, abs=1e-12)


@settings(deadline=None, max_examples=25)
@given(st.floats(0.0, 22.0), st.floats(-5.0, 25.0), st.floats(0.5, 25.0))
def test_without_cohesion_gravity_does_not_matter(slope: float, roll: float, gravity: float) -> None:
    here, there = _traverse(slope, roll), _traverse(slope, roll, gravity_m_s2=gravity)
    assert here.boundary == there.boundary
    for name in ("slip", "slip_angle_rad", "sinkage_uphill_m", "sinkage_downhill_m"):
        assert getattr(here, name) == pytest.approx(getattr(there, name), rel=1e-6, abs=1e-9)


@settings(deadline=None, max_examples=25)
@given(st.floats(10.0, 25.0))
def test_wheels_upright_do_not_slide_and_have_thrust_to_spare(slope: float) -> None:
    state = _traverse(slope, slope)
    assert state.boundary == "slip = 0"
    assert (state.slip, state.slip_angle_rad) == (0.0, 0.0)
    assert 0.0 < state.forces.drawbar_n.sum() < 0.044 * 23.8 * 9.81


@settings(deadline=None, max_examples=25)
@given(st.floats(0.0, 22.0), st.floats(0.0, 25.0))
def test_mirrored_traverses(slope: float, roll: float) -> None:
    state = _traverse(slope, roll)
    back = _traverse(slope, -roll, heading_rad=math.pi)
    assert back.slip == pytest.approx(state.slip, rel=1e-6, abs=1e-9)
    assert back.slip_angle_rad == pytest.approx(-state.slip_angle_rad, rel=1e-6, abs=1e-9)
    assert back.sinkage_uphill_m == pytest.approx(state.sinkage_downhill_m, rel=1e-6)


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0.0, 30.0),
    st.floats(-10.0, 30.0),
    st.floats(-math.pi, math.pi),
    st.floats(4.0, 60.0),
    st.booleans(),
)
def test_every_search_ends_in_balance_or_with_a_reason(
    slope: float, roll: float, heading: float, mass: float, skid: bool
) -> None:
    # Steeper, the walls lean beyond the soil's wedge, which the model refuses.
    assume(slope + roll < 51.0)
    conditions = Conditions(math.radians(slope), math.radians(roll), heading)
    rover = paper_rover(mass)
    state = solve_steady_state(rover, SAND, conditions, skid=skid, kernel=compiled_kernel)
    if not state.equilibrium:
        assert "slope" in state.reason
        assert math.isnan(state.slip)
        return
    asked = demand(rover, conditions)
    assert state.forces.vertical_n == pytest.approx(asked.vertical_n, rel=1e-7)
    assert state.forces.side_n.sum() == pytest.approx(asked.left_n, abs=1e-7 * asked.weight_n)
    spare = state.forces.drawbar_n.sum() - asked.forward_n
    if state.boundary:
        assert state.slip == 0.0
        assert spare > 0.0
    else:
        assert spare == pytest.approx(0.0, abs=1e-7 * asked.weight_n)


def test_more_load_means_less_slip_and_stiffer_soil_more() -> None:
    # The paper measured the opposite for the load: part of the gap between model and sand.
    slip = _traverse(20, 10).slip
    assert _traverse(20, 10, 33.8).slip < slip
    stiff = SAND.model_copy(update={"pressure": SAND.pressure.model_copy(update={"k_phi": 200.0})})
    conditions = Conditions(math.radians(20), math.radians(10))
    assert solve_steady_state(paper_rover(), stiff, conditions, kernel=compiled_kernel).slip > slip


def test_loads_are_equations_3_and_4() -> None:
    slope = math.radians(20.0)
    asked = demand(paper_rover(), Conditions(slope))
    uphill, downhill = paper_loads(asked.weight_n, slope, 0.187, 0.275, 0.275)
    worked = asked.weight_n * (0.275 * math.cos(slope) - 0.187 * math.sin(slope)) / (1.1 * math.cos(slope))
    assert uphill == pytest.approx(worked)
    assert uphill + downhill == pytest.approx(0.5 * asked.weight_n)
    assert asked.vertical_n / math.cos(slope) == pytest.approx([uphill, downhill, uphill, downhill])


def test_a_climb_loads_the_rear_and_a_shifted_centre_its_side() -> None:
    climb = demand(paper_rover(), Conditions(0.2, heading_rad=math.pi / 2))
    assert climb.vertical_n[0] == pytest.approx(climb.vertical_n[1])
    assert climb.vertical_n[2] > climb.vertical_n[0]
    assert climb.forward_n == pytest.approx(climb.weight_n * math.sin(0.2))
    shifted = demand(paper_rover().model_copy(update={"cog_lateral_m": 0.02}), Conditions(0.0))
    assert shifted.vertical_n[0] > shifted.vertical_n[1]
    assert shifted.vertical_n.sum() == pytest.approx(shifted.weight_n)


def test_any_number_of_wheels() -> None:
    wheel = load_wheel("paper_001")
    places = ((0.3, 0.275), (0.3, -0.275), (0.0, 0.275), (0.0, -0.275), (-0.3, 0.275), (-0.3, -0.275))
    six = SlopeRover(mass_kg=1.5 * 23.8, wheel=wheel, wheel_positions_m=places)
    conditions = Conditions(math.radians(15), math.radians(5))
    state = solve_steady_state(six, SAND, conditions, kernel=compiled_kernel)
    assert state.sinkage_m.shape == (6,)
    assert state.slip == pytest.approx(_traverse(15, 5).slip, rel=1e-9), (
        "as much weight per wheel, same sides"
    )
    one = SlopeRover(mass_kg=5.0, wheel=wheel, wheel_positions_m=((0.0, 0.0),), cog_height_m=0.0)
    assert solve_steady_state(one, SAND, Conditions(0.1), kernel=compiled_kernel).equilibrium


def test_climbing_slips_and_descending_skids() -> None:
    slips = []
    for slope_deg in (-20, -10, 0, 10, 20):
        heading = math.copysign(math.pi / 2, slope_deg)
        conditions = Conditions(math.radians(abs(slope_deg)), heading_rad=heading)
        state = solve_steady_state(paper_rover(), SAND, conditions, skid=True, kernel=compiled_kernel)
        assert state.boundary == ""
        assert state.slip_angle_rad == pytest.approx(0.0, abs=1e-12)
        slips.append(state.slip)
    assert slips == sorted(slips)
    assert slips[0] < -0.05
    assert slips[-1] > 0.2


def test_without_skid_a_descent_stands_at_the_edge() -> None:
    conditions = Conditions(math.radians(10), heading_rad=-math.pi / 2)
    state = solve_steady_state(paper_rover(), SAND, conditions, kernel=compiled_kernel)
    assert (state.boundary, state.slip) == ("slip = 0", 0.0)


@pytest.mark.parametrize(
    ("conditions", "reason"),
    [
        (Conditions(math.radians(28), heading_rad=math.pi / 2), "thrust"),
        (Conditions(math.radians(36), math.radians(-8)), "across the slope"),
        (Conditions(math.radians(40)), "angle of friction"),
    ],
)
@pytest.mark.parametrize("kernel", [numpy_kernel, compiled_kernel])
def test_too_steep_is_said(conditions: Conditions, reason: str, kernel: object) -> None:
    chosen = numpy_kernel if kernel is numpy_kernel else compiled_kernel
    state = solve_steady_state(paper_rover(), SAND, conditions, kernel=chosen)
    assert not state.equilibrium
    assert reason in state.reason
    assert math.isnan(state.slip)
    assert np.isnan(state.sinkage_m).all()


def test_a_rover_that_tips_over_is_said() -> None:
    tall = paper_rover().model_copy(update={"cog_height_m": 1.5})
    state = solve_steady_state(tall, SAND, Conditions(math.radians(15)))
    assert not state.equilibrium
    assert "tips over" in state.reason


def test_soil_that_flows_downhill_carries_the_rover_along() -> None:
    def flow(conditions: Conditions, slip: float, sinkage_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        del slip
        return np.zeros(sinkage_m.size), np.full(sinkage_m.size, -0.05 * math.sin(conditions.slope_rad))

    conditions = Conditions(math.radians(15), math.radians(15))
    effects = Effects(soil_flow=flow)
    state = solve_steady_state(paper_rover(), SAND, conditions, effects=effects, kernel=compiled_kernel)
    # Upright wheels do not slide over the soil, so they go with it.
    assert math.tan(state.slip_angle_rad) == pytest.approx(-0.05 * math.sin(conditions.slope_rad), rel=1e-6)
    none = Effects(soil_flow=lambda _, __, depth: (np.zeros(depth.size), np.zeros(depth.size)))
    at = Conditions(math.radians(15), math.radians(5))
    still = solve_steady_state(paper_rover(), SAND, at, effects=none, kernel=compiled_kernel)
    assert still.slip_angle_rad == pytest.approx(_traverse(15, 5).slip_angle_rad, rel=1e-9)


def test_slip_sinkage_and_sidewalls_act() -> None:
    conditions = Conditions(math.radians(15))
    plain = _traverse(15, 0)
    dug, bare = (
        solve_steady_state(paper_rover(), SAND, conditions, effects=effects, kernel=compiled_kernel)
        for effects in (Effects(slip_sinkage_m=0.02), Effects(sidewall=False))
    )
    assert dug.slip > plain.slip * 1.01
    assert dug.sinkage_uphill_m > plain.sinkage_uphill_m + 0.001
    assert bare.slip > plain.slip * 1.01
    assert bare.slip_angle_rad < plain.slip_angle_rad * 1.01


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"slope_rad": 20.0}, r"slope_rad is 20 rad, outside 0 \.\. 0\.785.*degrees\?"),
        ({"slope_rad": -0.1}, "slope_rad is -0.1 rad"),
        ({"slope_rad": 0.1, "roll_rad": 5.0}, "roll_rad is 5 rad"),
        ({"slope_rad": float("nan")}, "slope_rad is nan"),
        ({"slope_rad": 0.1, "heading_rad": 90.0}, "heading_rad is 90 rad"),
        ({"slope_rad": 0.1, "gravity_m_s2": 0.0}, "gravity_m_s2 is 0"),
    ],
)
def test_impossible_conditions_are_named(numbers: dict[str, float], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        Conditions(**numbers)


def test_a_rig_of_one_wheel_bears_its_load_and_cannot_tip() -> None:
    """Its centre of gravity may be anywhere: the frame of the rig takes the moments."""
    wheel, soil = load_wheel("wh34"), load_soil("hit_lss1")
    low = SlopeRover(mass_kg=10.0, wheel=wheel, wheel_positions_m=((0.0, 0.0),), cog_height_m=0.0)
    high = low.model_copy(update={"cog_height_m": 0.225, "cog_forward_m": 0.1, "cog_lateral_m": -0.2})
    conditions = Conditions(math.radians(8.0), heading_rad=0.5 * math.pi)
    states = [solve_steady_state(rover, soil, conditions, skid=True) for rover in (low, high)]
    weight_n = 10.0 * STANDARD_GRAVITY_M_S2
    for state in states:
        assert state.equilibrium
        assert state.forces.vertical_n.tolist() == pytest.approx([weight_n * math.cos(math.radians(8.0))])
        assert state.forces.drawbar_n.tolist() == pytest.approx([weight_n * math.sin(math.radians(8.0))])
        assert state.sinkage_uphill_m == state.sinkage_downhill_m == state.sinkage_m[0] > 0.0
    assert states[0].slip == states[1].slip
