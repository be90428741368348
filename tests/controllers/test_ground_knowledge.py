"""Tests of what is known of the ground without the excitation."""

import pytest

from controllers.slip.effort.ground_knowledge import GroundKnowledge, KnownSlip
from controllers.slip.effort.surface_map import TOO_SLOW, ForceWindow
from tests.controllers.slip_maps import make_maps

WINDOW_S = 0.5
NOT_YET = "surface not yet recognised"


def soft_ground() -> GroundKnowledge:
    """Return the knowledge of a rover that has recognised the soft surface."""
    ground = GroundKnowledge(make_maps().surfaces, are_named=True, learns=False)
    assert [drive(ground, 25.0).reason for _ in range(6)] == [NOT_YET] * 3 + [""] * 3
    return ground


def drive(ground: GroundKnowledge, force_n: float) -> KnownSlip:
    ground.move(WINDOW_S, 0.1)
    return ground.step(ForceWindow(0.0, 0.2, force_n, ""))


def rest(ground: GroundKnowledge, windows: int) -> None:
    for _ in range(windows):
        ground.move(WINDOW_S, 0.0)
        ground.step(ForceWindow(0.0, 0.0, 0.0, TOO_SLOW))


def test_after_a_long_rest_the_ground_is_recognised_anew() -> None:
    ground = soft_ground()
    rest(ground, 600)
    assert [drive(ground, 25.0).reason for _ in range(4)] == [NOT_YET] * 3 + [""]


def test_after_a_long_time_without_a_force_the_ground_is_recognised_anew() -> None:
    ground = soft_ground()
    ground.move(1.6, 0.3)
    assert [drive(ground, 25.0).reason for _ in range(4)] == [NOT_YET] * 3 + [""]


@pytest.mark.parametrize("windows", [1, 2])
def test_a_short_stop_keeps_the_recognised_ground(windows: int) -> None:
    ground = soft_ground()
    rest(ground, windows)
    assert drive(ground, 25.0).reason == ""
