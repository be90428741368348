"""Place of the front wheel's trace relative to the observed one."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.ftrace.rut.front_wheel_trace import FrontWheelTrace
from controllers.ground_motion.ground_patch import Floats
from tests.controllers.ftrace.rigs import geometry

BLOCK_M, WIDTHS = 0.04, 1.1
S_M = (np.arange(15) + 0.5) * BLOCK_M
AHEAD_M = 0.6


def trace(ahead_m: float = AHEAD_M, left_m: float = 0.0, steer_deg: float = 0.0) -> FrontWheelTrace:
    return FrontWheelTrace(replace(geometry(steer_deg), lead_m=(ahead_m, left_m)), BLOCK_M, WIDTHS)


@pytest.mark.parametrize("theta_deg", [-12.0, 0.0, 7.0])
def test_a_rover_that_drifts_leaves_the_front_trace_on_the_other_side(theta_deg: float) -> None:
    curve = np.asarray(-np.tan(np.radians(theta_deg)) * S_M)

    beside = trace().offsets(curve[None])[0]

    assert beside == pytest.approx(np.full(15, -AHEAD_M * np.tan(np.radians(theta_deg))), abs=1e-9)


def trace_of(contact_m: Floats) -> Floats:
    """Return how far left of the last contact a way went, at `S_M` behind it."""
    back, left = contact_m[-1, 0] - contact_m[:, 0], contact_m[:, 1] - contact_m[-1, 1]
    return np.asarray(np.interp(S_M, back[::-1], left[::-1]), np.float64)


@pytest.mark.parametrize("left_m", [0.0, 0.03])
def test_on_a_bend_it_lies_where_that_wheel_went(left_m: float) -> None:
    x = np.linspace(0, 3, 3001)
    rear = np.column_stack([x, 0.25 * x**2 / 3])
    front = rear + np.array([AHEAD_M, left_m])
    gone = front[front[:, 0] <= rear[-1, 0]]
    seen = np.interp(rear[-1, 0] - S_M, gone[:, 0], gone[:, 1]) - rear[-1, 1]

    own = trace_of(rear)
    beside = trace(left_m=left_m).offsets(own[None])[0]

    assert own + beside == pytest.approx(seen, abs=0.04)
    assert np.abs(beside[0]) > 0.1


def test_a_steered_wheel_sees_it_from_its_own_axes() -> None:
    straight_ahead = np.asarray(np.tan(np.radians(5.0)) * S_M)

    beside = trace(steer_deg=5.0).offsets(straight_ahead[None])[0]

    assert beside == pytest.approx(np.zeros(15), abs=1e-3)


def test_steer_turns_the_place_of_the_other_wheel() -> None:
    beside = trace(left_m=0.2, steer_deg=10.0).offsets(np.zeros((1, 15)))[0]

    expected = 0.2 * np.cos(np.radians(10.0)) - AHEAD_M * np.sin(np.radians(10.0))
    assert beside == pytest.approx(np.full(15, expected), abs=1e-9)


@pytest.mark.parametrize(("steer_deg", "left_m"), [(70.0, -0.28), (90.0, 0.0)])
def test_a_wheel_steered_away_has_none_ahead(steer_deg: float, left_m: float) -> None:
    away = trace(left_m=left_m, steer_deg=steer_deg)

    assert not away.exists
    assert np.isinf(away.offsets(np.zeros((2, 15)))).all()


def test_only_traces_that_touch_make_one_rut() -> None:
    near, far = (-np.tan(np.radians(theta_deg)) * S_M for theta_deg in (5.0, 20.0))

    right, left = trace().edges(np.stack([near, far]))

    assert (right[0] < near - 0.04).all()
    assert left[0] == pytest.approx(near)
    assert right[1] == pytest.approx(far)
    assert left[1] == pytest.approx(far)


def test_without_a_wheel_ahead_there_is_none() -> None:
    alone = FrontWheelTrace(replace(geometry(), lead_m=None), BLOCK_M, WIDTHS)
    curve = np.asarray(0.1 * S_M[None], np.float64)

    assert np.isinf(alone.offsets(curve)).all()
    assert all((edge == curve).all() for edge in alone.edges(curve))
