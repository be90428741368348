"""Single wheels: symmetries, limits and monotonicity of the model; sinkage at a load; input checks."""

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import ModelError
from sim_backends.terramechanics.soil.library import load_soil, load_wheel
from sim_backends.terramechanics.soil.wheel_forces import wheel_at_load
from tests.sim_backends.wheel_cases import forces_at_sinkage

WHEEL, SAND = load_wheel("paper_001"), load_soil("toyoura")
SLIPS = st.floats(-0.9, 0.9)
ANGLES = st.floats(0.001, 1.0)
SINKAGES = st.floats(0.002, 0.05)


@settings(deadline=None)
@given(SINKAGES, SLIPS, ANGLES)
def test_mirrored_wheels_feel_mirrored_forces(sinkage: float, slip: float, angle: float) -> None:
    # A wheel mirrored at its plane: slip angle, camber and slope change sign.
    one = forces_at_sinkage(
        WHEEL, SAND, sinkage_m=sinkage, slip=slip, slip_angle_rad=angle, camber_rad=0.1, cross_slope_rad=0.2
    )
    other = forces_at_sinkage(
        WHEEL,
        SAND,
        sinkage_m=sinkage,
        slip=slip,
        slip_angle_rad=-angle,
        camber_rad=-0.1,
        cross_slope_rad=-0.2,
    )
    assert one.side_n == pytest.approx(-other.side_n, rel=1e-9)
    for name in ("drawbar_n", "vertical_n", "torque_nm"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-9, abs=1e-9)


@settings(deadline=None)
@given(SINKAGES, st.floats(0.0, 0.9), ANGLES)
def test_bottom_forces_are_even_and_odd_in_the_slip_angle(sinkage: float, slip: float, angle: float) -> None:
    # On level ground both walls are alike, so the whole wheel shows the symmetry of its bottom.
    forces = forces_at_sinkage(WHEEL, SAND, sinkage_m=sinkage, slip=slip, slip_angle_rad=[angle, -angle])
    assert forces.drawbar_n[0] == pytest.approx(forces.drawbar_n[1], abs=1e-9)
    assert forces.vertical_n[0] == pytest.approx(forces.vertical_n[1], rel=1e-9)
    assert forces.side_n[0] == pytest.approx(-forces.side_n[1], rel=1e-9)
    assert forces.side_n[0] < 0.0 < forces.side_n[1], "the soil pushes against the motion"


@settings(deadline=None)
@given(SINKAGES, st.floats(0.0, 0.9), ANGLES, st.floats(1.0, 25.0))
def test_without_cohesion_forces_scale_with_gravity(
    sinkage: float, slip: float, angle: float, gravity: float
) -> None:
    one, other = (
        np.array(
            forces_at_sinkage(
                WHEEL,
                SAND,
                sinkage_m=sinkage,
                slip=slip,
                slip_angle_rad=angle,
                cross_slope_rad=0.1,
                gravity_m_s2=g,
            )
        )
        for g in (1.0, gravity)
    )
    assert other == pytest.approx(gravity * one, rel=1e-9)


@settings(deadline=None)
@given(st.floats(-0.9, 0.9), st.floats(-1.0, 1.0), st.floats(-0.35, 0.35))
def test_more_sinkage_bears_more(slip: float, angle: float, camber: float) -> None:
    tilt = 0.05 * math.tan(abs(camber))
    sinkages = np.linspace(-tilt, WHEEL.radius_m - tilt, 60)[1:]
    forces = forces_at_sinkage(
        WHEEL, SAND, sinkage_m=sinkages, slip=slip, slip_angle_rad=angle, camber_rad=camber, bound=1e-5
    )
    assert (np.diff(forces.vertical_n) > 0.0).all()
    assert forces.vertical_n[0] >= 0.0


@pytest.mark.parametrize("camber", [0.0, 0.3])
def test_forces_are_continuous_across_branches(camber: float) -> None:
    # Past the sinkages at which an edge leaves the soil and at which the contact gets longer than wide.
    tilt = 0.05 * math.tan(camber)
    sinkages = np.linspace(-0.99 * tilt + 1e-4, 0.05, 4001)
    forces = np.array(
        forces_at_sinkage(WHEEL, SAND, sinkage_m=sinkages, slip=0.2, slip_angle_rad=0.1, camber_rad=camber)
    )
    steps = np.abs(np.diff(forces, axis=1))
    assert (steps.max(axis=1) < 30.0 * np.median(steps, axis=1)).all()
    slips = np.linspace(-0.02, 0.02, 4001)
    along = np.array(forces_at_sinkage(WHEEL, SAND, sinkage_m=0.02, slip=slips, slip_angle_rad=0.1))
    assert np.abs(np.diff(along, axis=1)).max() < 0.02


def test_side_force_grows_like_the_root_of_a_small_slip_angle() -> None:
    angles = np.array([1e-6, 4e-6])
    side = forces_at_sinkage(WHEEL, SAND, sinkage_m=0.02, slip=0.0, slip_angle_rad=angles).side_n
    assert side[1] / side[0] == pytest.approx(2.0, rel=0.01)


def test_a_spinning_wheel_pulls_and_a_locked_one_drags() -> None:
    forces = forces_at_sinkage(WHEEL, SAND, sinkage_m=0.02, slip=[0.8, -0.8])
    assert forces.drawbar_n[0] > 0.0 > forces.drawbar_n[1]
    assert forces.torque_nm[0] > 0.0 > forces.torque_nm[1]


@settings(deadline=None, max_examples=30)
@given(st.floats(1.0, 300.0), st.floats(-0.5, 0.8), st.floats(-0.8, 0.8), st.floats(-0.3, 0.3))
def test_sinkage_at_a_load_bears_that_load(load: float, slip: float, angle: float, camber: float) -> None:
    sinkage, forces = wheel_at_load(
        WHEEL, SAND, load_n=load, slip=slip, slip_angle_rad=angle, camber_rad=camber
    )
    assert forces.vertical_n == pytest.approx(load, rel=1e-9)
    again = forces_at_sinkage(
        WHEEL, SAND, sinkage_m=sinkage, slip=slip, slip_angle_rad=angle, camber_rad=camber
    )
    assert np.array(again) == pytest.approx(np.array(forces), rel=1e-9)


def test_loads_that_soil_cannot_bear_are_not_a_number() -> None:
    sinkage, forces = wheel_at_load(WHEEL, SAND, load_n=[50.0, 1e5], slip=0.1)
    assert np.isfinite(sinkage[0])
    assert np.isnan(sinkage[1])
    assert np.isnan(forces.drawbar_n[1])


def test_slip_sinkage_adds_to_the_sinkage() -> None:
    slips = np.array([0.0, 0.4])
    plain, _ = wheel_at_load(WHEEL, SAND, load_n=60.0, slip=slips)
    dug, forces = wheel_at_load(WHEEL, SAND, load_n=60.0, slip=slips, slip_sinkage_m=0.01)
    assert dug[0] == pytest.approx(plain[0], rel=1e-9)
    assert 0.001 < dug[1] - plain[1] < 0.008
    assert forces.vertical_n == pytest.approx(60.0)


def test_lugs_shear_at_their_own_radius() -> None:
    lugged = WHEEL.model_copy(update={"lug_height_m": 0.01, "shearing_share": 0.5})
    smooth, rough = (forces_at_sinkage(wheel, SAND, sinkage_m=0.02, slip=0.2) for wheel in (WHEEL, lugged))
    assert rough.drawbar_n > smooth.drawbar_n


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"slip_angle_rad": 10.0}, r"slip_angle_rad is 10 rad, outside .*degrees\?"),
        ({"slip": 1.2}, r"slip is 1\.2, outside -0\.99 \.\. 1"),
        ({"slip": float("nan")}, "slip is nan"),
        ({"camber_rad": 5.0}, r"camber_rad is 5 rad"),
        ({"cross_slope_rad": 0.7}, r"cross_slope_rad is 0\.7 rad.*friction angle"),
        ({"gravity_m_s2": -9.8}, r"gravity_m_s2 is -9\.8 m/s\^2"),
        ({"bound": 1e-12}, "bound is 1e-12"),
    ],
)
def test_what_is_outside_the_domain_is_named(change: dict[str, float], words: str) -> None:
    call = partial(wheel_at_load, WHEEL, SAND, load_n=50.0, slip=0.1)
    with pytest.raises(ModelError, match=words):
        call(**change)  # type: ignore[arg-type]


def test_negative_loads_are_named() -> None:
    with pytest.raises(ModelError, match="load_n is -5 N"):
        wheel_at_load(WHEEL, SAND, load_n=-5.0, slip=0.1)
