"""Poses as a measure of the wheels: a marker beside the origin, on a circle and on other paths."""

import numpy as np
import pytest

from rover_hil.drives.quality.references import PoseReference

ARM_M = 0.05 + 0.1j


def reference(turn_rad: np.ndarray, scale: float) -> tuple[PoseReference, np.ndarray]:
    """Return poses of a marker with an arm, and the moves by wheels that go too far by 1 / scale."""
    step_m = 0.1 * np.ones(len(turn_rad)) + 2j * np.sin(0.5 * turn_rad) * ARM_M
    moves = np.column_stack((np.full(len(turn_rad), 0.1 / scale), np.zeros(len(turn_rad)), turn_rad))
    used = np.ones(len(turn_rad), np.bool_)
    yaw_rad = np.cumsum(turn_rad)
    return PoseReference("ground truth", used, turn_rad, step_m, yaw_rad, wheels_turn=True), moves


def test_the_arm_is_taken_off_where_the_rotation_changes() -> None:
    found, moves = reference(np.tile([0.0, 0.1, -0.15, 0.2], 20), 0.95)
    assert found.at_origin(moves).fit_there(moves).distance_scale == pytest.approx(0.95, abs=1e-6)
    assert found.arm_growth(moves) < 1.2


def test_on_a_circle_an_unknown_arm_hides_the_factor_of_the_distance() -> None:
    rng = np.random.default_rng(1)
    found, moves = reference(0.12 * (1.0 + 0.01 * rng.standard_normal(80)), 0.95)
    assert found.arm_growth(moves) > 50.0
