"""Motion over stretches: the same as the difference of poses."""

import numpy as np
import pytest

from sim_backends.wheels_model.stretches import STRETCH_S, over_stretches, windows_of_stretch

WIDTH_S = 0.2


def test_a_stretch_is_the_difference_of_the_poses_at_its_ends() -> None:
    """A circle: chord and turn by the formula, whatever the heading at the start of the stretch."""
    t_s = WIDTH_S * (np.arange(100.0) + 0.5)
    speed_m_s, turn_rad_s = 0.3, 0.5
    found = over_stretches(t_s, np.tile((speed_m_s, 0.0, turn_rad_s), (100, 1)))
    count = windows_of_stretch(t_s)
    assert count == round(STRETCH_S / WIDTH_S)
    assert np.isnan(found[: count - 1]).all()
    angle = turn_rad_s * STRETCH_S
    radius_m = speed_m_s / turn_rad_s
    expected = (radius_m * np.sin(angle), radius_m * (1.0 - np.cos(angle)), angle)
    assert np.allclose(found[count - 1 :], expected, rtol=1e-3)


def test_a_short_drive_has_one_stretch() -> None:
    t_s = WIDTH_S * (np.arange(8.0) + 0.5)
    found = over_stretches(t_s, np.tile((0.0, 0.1, 0.0), (8, 1)))
    assert np.isnan(found[:-2]).all()
    assert found[-1, 1] == pytest.approx(7 * WIDTH_S * 0.1)
