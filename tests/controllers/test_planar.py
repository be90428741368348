"""Angles and poses."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.motion.planar import Pose, move, wrap_angle


@given(angle=st.floats(-1e6, 1e6))
def test_wrapping_keeps_the_direction_and_the_range(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    assert abs(cmath.rect(1.0, wrapped) - cmath.rect(1.0, angle)) < 1e-9


@pytest.mark.parametrize("angle", [math.pi, -math.pi, math.nextafter(-math.pi, -4.0)])
def test_wrapping_pi_gives_minus_pi(angle: float) -> None:
    assert wrap_angle(angle) == -math.pi


@pytest.mark.parametrize("angle", [math.inf, -math.inf, math.nan])
def test_wrapping_what_is_not_finite_gives_nan(angle: float) -> None:
    assert math.isnan(wrap_angle(angle))


@given(yaw=st.floats(-3.0, 3.0), x=st.floats(-1.0, 1.0), y=st.floats(-1.0, 1.0), turn=st.floats(-0.05, 0.05))
def test_a_small_move_is_the_arc_to_second_order(yaw: float, x: float, y: float, turn: float) -> None:
    arc = cmath.exp(0.5j * turn) * float(np.sinc(0.5 * turn / math.pi))
    expected = complex(0.5, -0.5) + cmath.rect(1.0, yaw) * complex(x, y) * arc
    moved = move(Pose(x_m=0.5, y_m=-0.5, yaw_rad=yaw), x, y, turn)
    assert abs(complex(moved.x_m, moved.y_m) - expected) <= turn**2 / 12.0 * math.hypot(x, y) + 1e-12
    assert wrap_angle(moved.yaw_rad - yaw - turn) == pytest.approx(0.0, abs=1e-12)
