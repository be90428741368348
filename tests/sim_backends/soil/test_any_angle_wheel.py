import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ConfigError, ModelError
from sim_backends.terramechanics.soil.any_angle_wheel import (
    AnyAngleForces,
    Motion,
    _Rim,
    any_angle_at_load,
    any_angle_forces,
    load_any_angle_soil,
)
from sim_backends.terramechanics.soil.library import load_wheel

WHEEL = load_wheel("cmu_smooth")
LUGS = load_wheel("cmu_grousered")
SOIL = load_any_angle_soil("cmu_sand_blind").model_copy(update={"slide_number": 5.0, "push_number": 30.0})


def motion(rim: float, angle_deg: float, speed: float = 0.01) -> Motion:
    angle = np.radians(angle_deg)
    return Motion(*(np.array([value]) for value in (rim, speed * np.cos(angle), speed * np.sin(angle))))


def at_load(rim: float, angle_deg: float, load_n: float = 20.0) -> tuple[float, AnyAngleForces]:
    sinkage, forces = any_angle_at_load(WHEEL, SOIL, motion(rim, angle_deg), np.array([load_n]))
    return float(sinkage[0]), forces


ANGLES = st.floats(0.0, 90.0)
RIMS = st.sampled_from([0.0, 0.002, 0.01, 0.03, 0.1])


@given(RIMS, ANGLES, st.floats(0.002, 0.06))
def test_sliding_to_either_side_is_mirrored(rim: float, angle_deg: float, sinkage: float) -> None:
    left = any_angle_forces(WHEEL, SOIL, motion(rim, angle_deg), np.array([sinkage]))
    right = any_angle_forces(WHEEL, SOIL, motion(rim, -angle_deg), np.array([sinkage]))
    assert right.side_n == pytest.approx(-left.side_n)
    for name in ("drawbar_n", "vertical_n", "torque_nm"):
        assert getattr(right, name) == pytest.approx(getattr(left, name))


@given(RIMS, ANGLES, st.floats(0.1, 20.0))
def test_only_ratios_of_speeds_matter(rim: float, angle_deg: float, faster: float) -> None:
    slow = any_angle_forces(WHEEL, SOIL, motion(rim, angle_deg), np.array([0.02]))
    fast = any_angle_forces(WHEEL, SOIL, motion(rim * faster, angle_deg, 0.01 * faster), np.array([0.02]))
    assert np.stack(fast) == pytest.approx(np.stack(slow), rel=1e-6, abs=1e-9)


@given(RIMS, ANGLES)
def test_the_soil_carries_the_load_that_was_asked_for(rim: float, angle_deg: float) -> None:
    sinkage, forces = at_load(rim, angle_deg)
    if np.isfinite(sinkage):
        assert float(forces.vertical_n[0]) == pytest.approx(20.0, abs=1e-4)


def test_the_soil_resists_sliding_and_its_force_grows_with_the_angle() -> None:
    sides = [float(at_load(0.012, angle)[1].side_n[0]) for angle in (0, 15, 30, 45, 60, 75)]
    assert sides[0] == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.diff(sides) < 0)


def test_slip_skid_and_sliding_sideways_all_sink_the_wheel() -> None:
    rolling = at_load(0.01, 0)[0]
    assert at_load(0.1, 0)[0] > 1.2 * rolling
    assert at_load(0.003, 0)[0] > 1.5 * rolling
    assert at_load(0.01, 75)[0] > 1.5 * rolling


def test_a_spinning_wheel_pulls_and_a_locked_one_drags() -> None:
    assert float(at_load(0.05, 0)[1].torque_nm[0]) > 0.1
    _, locked = at_load(0.0, 0)
    assert float(locked.drawbar_n[0]) < -10.0
    assert float(locked.torque_nm[0]) < 0.0


def test_pressed_soil_carries_most_at_the_greatest_stress_and_nothing_where_the_wheel_leaves_it() -> None:
    soil = SOIL.model_copy(update={"press_exponent": 0.0})
    rim = _Rim(soil, motion(0.01, 0), np.array([0.02]), WHEEL.radius_m)
    entry, greatest, leaving = (float(angle[0, 0]) for angle in (rim.entry, rim.greatest, rim.leaving))
    edges = rim.pressure(np.array([[leaving, leaving + 1e-9, greatest - 1e-9, greatest, entry]]))[0]
    assert edges[[0, 1, 4]] == pytest.approx(0.0, abs=1e-3)
    assert edges[2] == pytest.approx(edges[3], rel=1e-6)
    everywhere = rim.pressure(np.linspace(leaving, entry, 101)[None, :])[0]
    assert everywhere.max() <= edges[3] * (1 + 1e-9)


def test_a_dragged_wheel_leaves_no_pressure_behind() -> None:
    rim = _Rim(SOIL, motion(0.0, 0), np.array([0.04]), WHEEL.radius_m)
    behind, under, ahead = rim.pressure(np.array([[-0.5, 0.0, 0.5]]))[0]
    assert behind == pytest.approx(0.0, abs=1e-9)
    assert 0.0 < under < ahead


def test_locked_and_sideways_is_the_limit_of_nearly_so() -> None:
    exact = any_angle_forces(WHEEL, SOIL, motion(0.0, 90), np.array([0.05]))
    near = any_angle_forces(WHEEL, SOIL, motion(1e-8, 89.9999), np.array([0.05]))
    assert np.stack(near) == pytest.approx(np.stack(exact), rel=1e-3, abs=1e-3)


def test_a_wheel_at_rest_along_its_heading_has_no_drawbar_when_it_slides_straight_sideways() -> None:
    forces = any_angle_forces(WHEEL, SOIL, motion(0.0, 90), np.array([0.05]))
    assert float(forces.drawbar_n[0]) == pytest.approx(0.0, abs=1e-9)
    dragged = SOIL.model_copy(update={"wall_drag": 0.13})
    assert float(any_angle_forces(WHEEL, dragged, motion(0.0, 90), np.array([0.05])).drawbar_n[0]) < -1.0


@given(RIMS, st.floats(0.0, 80.0))
def test_more_sinkage_carries_more(rim: float, angle_deg: float) -> None:
    depths = np.linspace(0.002, 0.05, 12)
    motions = Motion(*(np.repeat(part, len(depths)) for part in motion(rim, angle_deg)))
    soil = SOIL.model_copy(update={"rim_friction_deg": 10.0})
    assert np.all(np.diff(any_angle_forces(WHEEL, soil, motions, depths).vertical_n) > 0)


def test_lugs_pull_more_at_the_same_slip_of_the_rim() -> None:
    load = np.array([20.0])
    smooth = any_angle_at_load(WHEEL, SOIL, motion(0.02, 0), load)[1]
    lugged = any_angle_at_load(LUGS, SOIL, motion(0.02, 0), load)[1]
    assert float(lugged.drawbar_n[0]) > float(smooth.drawbar_n[0]) + 1.0
    assert float(lugged.torque_nm[0]) > float(smooth.torque_nm[0])


def test_a_load_beyond_the_soil_is_not_carried() -> None:
    sinkage, forces = at_load(0.0, 90, load_n=1000.0)
    assert np.isnan(sinkage)
    assert np.all(np.isnan(np.stack(forces)))


@pytest.mark.parametrize(
    ("moving", "load", "named"),
    [
        (Motion(np.array([0.0]), np.array([0.0]), np.array([0.0])), 20.0, "at rest"),
        (Motion(np.array([0.1]), np.array([-0.1]), np.array([0.0])), 20.0, "forward_m_s"),
        (Motion(np.array([np.nan]), np.array([0.1]), np.array([0.0])), 20.0, "rim_speed_m_s"),
        (motion(0.01, 0), -1.0, "load_n"),
    ],
)
def test_what_the_law_does_not_know_is_refused(moving: Motion, load: float, named: str) -> None:
    with pytest.raises(ModelError, match=named):
        any_angle_at_load(WHEEL, SOIL, moving, np.array([load]))
    with pytest.raises(ModelError, match="sinkage_m"):
        any_angle_forces(WHEEL, SOIL, motion(0.01, 0), np.array([0.2]))


def test_unknown_soils_are_named() -> None:
    with pytest.raises(ConfigError, match="marshmallow"):
        load_any_angle_soil("marshmallow")
