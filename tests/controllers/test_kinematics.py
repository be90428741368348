"""Kinematics against the geometry of contacts and drive directions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.motion.kinematics import Kinematics, make_kinematics
from controllers.motion.rover_geometry import OmniRoverSettings
from tests.controllers.simulated import OMNI, SKID, Geometry, omni_geometry, skid_geometry

speeds = st.floats(-3.0, 3.0)
ROVERS = [
    pytest.param(make_kinematics(OMNI), omni_geometry(), id="omni3"),
    pytest.param(make_kinematics(SKID), skid_geometry(), id="skid_steer_4"),
]


@pytest.mark.parametrize(("kinematics", "geometry"), ROVERS)
@given(x=speeds, y=speeds, turn=speeds)
def test_wheel_speeds_match_the_geometry(
    kinematics: Kinematics, geometry: Geometry, x: float, y: float, turn: float
) -> None:
    expected = geometry.wheel_speeds(complex(x, y), turn)
    assert kinematics.wheel_speeds(x, y, turn) == pytest.approx(expected.tolist(), abs=1e-9)


@pytest.mark.parametrize(("kinematics", "geometry"), ROVERS)
@given(x=speeds, y=speeds, turn=speeds)
def test_body_motion_undoes_wheel_speeds(
    kinematics: Kinematics, geometry: Geometry, x: float, y: float, turn: float
) -> None:
    sideways = y if kinematics.moves_sideways else 0.0
    motion = kinematics.body_motion(kinematics.wheel_speeds(x, sideways, turn))
    assert motion == pytest.approx((x, sideways, turn), abs=1e-12)


@given(wheels=st.lists(speeds, min_size=4, max_size=4))
def test_four_wheels_that_disagree_give_the_least_squares_motion(wheels: list[float]) -> None:
    velocity, turn = skid_geometry().twist(np.array(wheels))
    motion = make_kinematics(SKID).body_motion(wheels)
    assert motion == pytest.approx((velocity.real, velocity.imag, turn), abs=1e-9)


@given(wheels=st.lists(speeds, min_size=3, max_size=3))
def test_the_inverse_is_the_published_one_for_wheels_120_degrees_apart(wheels: list[float]) -> None:
    v1, v2, v3 = (0.04 * wheel for wheel in wheels)
    expected = ((v3 - v1) / math.sqrt(3.0), (v1 + v3 - 2.0 * v2) / 3.0, (v1 + v2 + v3) / 3.0 / 0.125)
    assert make_kinematics(OMNI).body_motion(wheels) == pytest.approx(expected, abs=1e-12)


def test_straight_ahead_the_second_wheel_of_the_omni_rover_stands() -> None:
    first, second, third = make_kinematics(OMNI).wheel_speeds(0.1, 0.0, 0.0)
    assert second == pytest.approx(0.0, abs=1e-12)
    assert third == pytest.approx(-first)
    assert third == pytest.approx(math.sqrt(3.0) / 2.0 * 0.1 / 0.04)


def test_other_wheel_angles_follow_the_geometry() -> None:
    angles = (0.0, 100.0, 250.0)
    settings = OmniRoverSettings(
        kinematics="omni3", wheel_radius_m=0.04, base_radius_m=0.125, wheel_angles_deg=angles
    )
    expected = omni_geometry(angles).wheel_speeds(0.3 - 0.2j, 0.7)
    assert make_kinematics(settings).wheel_speeds(0.3, -0.2, 0.7) == pytest.approx(expected.tolist())
    assert make_kinematics(settings).body_motion(expected.tolist()) == pytest.approx((0.3, -0.2, 0.7))
