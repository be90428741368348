import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import OmniKinematics
from controllers.slip.effort.slip_sharing import share_slip
from tests.controllers.simulated import OMNI

KINEMATICS = OmniKinematics(OMNI)
AHEAD_RAD = KINEMATICS.wheel_speeds(0.06, 0.0, 0.0)
"""Wheel 1 stands, the others turn against each other."""


def moved(turned_rad: tuple[float, ...], slips: tuple[float, ...]) -> BodyMotion:
    return KINEMATICS.body_motion([a * (1.0 - s) for a, s in zip(turned_rad, slips, strict=True)])


def shared(turned_rad: tuple[float, ...], slip: float, slips: tuple[float, ...]) -> tuple[float, ...]:
    missing_rad = moved(turned_rad, (slip,) * 3)[2] - moved(turned_rad, slips)[2]
    return share_slip(KINEMATICS, turned_rad, slip, missing_rad)


@pytest.mark.parametrize("slips", [(0.1, 0.0, 0.5), (0.45, 0.0, 0.35), (-0.1, 0.0, 0.3)])
def test_the_gyro_tells_the_drift_of_a_rover_that_goes_ahead(slips: tuple[float, ...]) -> None:
    x_m, y_m, _ = moved(AHEAD_RAD, slips)
    assert abs(y_m) > 0.001
    found_x_m, found_y_m, _ = moved(AHEAD_RAD, shared(AHEAD_RAD, 0.5 * (slips[0] + slips[2]), slips))
    assert found_x_m == pytest.approx(x_m, rel=1e-6)
    # The turn is taken with a grain of salt: see EFFORT.sharing.turn_noise_rad.
    assert found_y_m == pytest.approx(y_m, rel=0.15)
    assert found_y_m * y_m > 0.0


def test_the_drift_is_to_the_side_of_the_wheel_that_slips_more() -> None:
    right_rear, left_rear = (0.1, 0.0, 0.6), (0.6, 0.0, 0.1)
    assert moved(AHEAD_RAD, shared(AHEAD_RAD, 0.35, right_rear))[1] == pytest.approx(
        -moved(AHEAD_RAD, shared(AHEAD_RAD, 0.35, left_rear))[1]
    )


@given(st.floats(-1.0, 1.0), st.lists(st.floats(-30.0, 30.0), min_size=3, max_size=3))
def test_without_a_missing_turn_all_wheels_slip_alike(slip: float, turned_rad: list[float]) -> None:
    assert share_slip(KINEMATICS, turned_rad, slip, 0.0) == (slip,) * 3


@given(
    st.floats(-1.0, 1.0),
    st.lists(st.floats(-30.0, 30.0), min_size=3, max_size=3),
    st.floats(-10.0, 10.0),
)
def test_slips_stay_slips(slip: float, turned_rad: list[float], missing_rad: float) -> None:
    slips = share_slip(KINEMATICS, turned_rad, slip, missing_rad)
    assert all(-1.0 <= one <= 1.0 for one in slips)
    for angle_rad, one in zip(turned_rad, slips, strict=True):
        assert (one - slip) * angle_rad * missing_rad >= 0.0, "who turns on loses turn"


def test_a_rover_that_stands_blames_no_wheel_for_noise() -> None:
    slips = share_slip(KINEMATICS, (0.001, -0.002, 0.001), 0.2, 0.002)
    assert slips == pytest.approx((0.2, 0.2, 0.2), abs=0.001)
