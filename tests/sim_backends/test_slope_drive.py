"""Drives over height fields: planes under the rover, crabbing, time and energy, and where a drive ends."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ModelError
from sim_backends.terramechanics.slope.drive import drive
from sim_backends.terramechanics.slope.height_field import HeightField, Plane, plane_under
from sim_backends.terramechanics.slope.rover import Conditions, paper_rover
from sim_backends.terramechanics.slope.steady_state import solve_steady_state
from sim_backends.terramechanics.soil.compiled import compiled_kernel
from sim_backends.terramechanics.soil.library import load_soil

SAND = load_soil("toyoura")


def _plane_field(slope_rad: float, uphill_rad: float) -> HeightField:
    lines = np.linspace(-20.0, 20.0, 5)
    x, y = np.meshgrid(lines, lines, indexing="ij")
    height = math.tan(slope_rad) * (x * math.cos(uphill_rad) + y * math.sin(uphill_rad))
    return HeightField(lines, lines, height)


@given(st.floats(0.01, 0.6), st.floats(-3.0, 3.0), st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_a_plane_is_found_as_it_is(slope: float, uphill: float, x: float, y: float) -> None:
    wheels = np.array(paper_rover().wheel_positions_m)
    plane = plane_under(_plane_field(slope, uphill), x + wheels[:, 0], y + wheels[:, 1])
    assert plane.slope_rad == pytest.approx(slope)
    assert plane.uphill_rad == pytest.approx(uphill)


@given(st.floats(0.0, 0.7), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_headings_and_azimuths(slope: float, uphill: float, azimuth: float) -> None:
    plane = Plane(slope, uphill)
    back = plane.azimuth(plane.heading_in_plane(azimuth))
    assert math.remainder(back - azimuth, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert plane.heading_in_plane(uphill) == pytest.approx(math.pi / 2)


def test_heights_between_grid_points() -> None:
    field = HeightField(np.array([0.0, 1.0]), np.array([0.0, 2.0]), np.array([[0.0, 0.0], [0.0, 4.0]]))
    assert field.height(np.array([1.0, 0.5]), np.array([2.0, 1.0])) == pytest.approx([4.0, 1.0])
    with pytest.raises(ModelError, match=r"x_m is 1\.5 m, outside 0 \.\. 1 m"):
        field.height(np.array([1.5]), np.array([0.0]))


def test_a_climb_is_the_steady_state_of_the_climb() -> None:
    slope = math.radians(10)
    done = drive(
        paper_rover(),
        SAND,
        _plane_field(slope, math.pi / 2),
        np.array([[0.0, 0.0], [0.0, 2.0]]),
        rim_speed_m_s=0.02,
        step_m=0.5,
        kernel=compiled_kernel,
    )
    climb = Conditions(slope, heading_rad=math.pi / 2)
    state = solve_steady_state(paper_rover(), SAND, climb, bound=1e-5, kernel=compiled_kernel)
    assert done.finished
    assert len(done.stations) == 5
    for station in done.stations:
        assert station.state.slip == pytest.approx(state.slip, rel=1e-6)
    last = done.stations[-1]
    length = 2.0 / math.cos(slope)
    assert last.t_s == pytest.approx(length / (0.02 * (1.0 - state.slip)), rel=1e-6)
    assert done.energy_j == pytest.approx(last.t_s * state.forces.torque_nm.sum() * 0.02 / 0.097, rel=1e-6)
    lifted = 23.8 * 9.80665 * length * math.sin(slope)
    assert done.energy_j > lifted, "the soil takes its share"


def test_a_traverse_crabs_so_that_the_rover_stays_on_its_path() -> None:
    done = drive(
        paper_rover(),
        SAND,
        _plane_field(math.radians(12), math.pi / 2),
        np.array([[0.0, 0.0], [1.0, 0.0]]),
        step_m=0.5,
        kernel=compiled_kernel,
    )
    for station in done.stations:
        heading = station.plane.heading_in_plane(station.azimuth_rad)
        travel = station.plane.azimuth(heading + station.state.slip_angle_rad)
        assert travel == pytest.approx(0.0, abs=1e-6)
        assert station.azimuth_rad > 0.05, "it points uphill"


def test_a_hill_too_steep_ends_the_drive() -> None:
    x = np.linspace(-1.0, 9.0, 101)
    y = np.array([-2.0, 2.0])
    height = np.repeat(np.where(x > 3.0, (x - 3.0) ** 2 * 0.15, 0.0)[:, np.newaxis], 2, axis=1)
    done = drive(
        paper_rover(),
        SAND,
        HeightField(x, y, height),
        np.array([[0.0, 0.0], [8.0, 0.0]]),
        step_m=0.5,
        kernel=compiled_kernel,
    )
    assert not done.finished
    assert "thrust" in done.reason
    assert 3.0 < done.stations[-1].distance_m < 6.0
    slips = [station.state.slip for station in done.stations]
    assert slips[-1] > 0.4 > slips[0]


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (np.zeros((1, 2)), "two or more"),
        (np.zeros((2, 2)), "twice in a row"),
        (np.array([[0.0, 0.0], [30.0, 0.0]]), "height field"),
        (np.array([[0.0, math.nan], [1.0, 0.0]]), "finite"),
    ],
)
def test_paths_that_cannot_be_driven_are_refused(path: np.ndarray, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        drive(paper_rover(), SAND, _plane_field(0.0, 0.0), path, step_m=5.0, kernel=compiled_kernel)


def test_height_fields_that_do_not_fit_are_refused() -> None:
    lines = np.array([0.0, 1.0])
    with pytest.raises(ModelError, match="x_m"):
        HeightField(lines[::-1], lines, np.zeros((2, 2)))
    with pytest.raises(ModelError, match="shape"):
        HeightField(lines, lines, np.zeros((3, 2)))
