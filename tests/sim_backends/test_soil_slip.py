"""Definitions of slip, skid and shearing radius."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ModelError
from sim_backends.terramechanics.soil.slip import shearing_radius, slip_ratio, speed_ratio


def test_worked_values() -> None:
    assert slip_ratio(0.8, 1.0) == pytest.approx(0.2)
    assert slip_ratio(1.0, 0.8) == pytest.approx(-0.2)
    assert slip_ratio(1.0, 1.0) == 0.0
    assert slip_ratio(0.0, 1.0) == 1.0
    assert slip_ratio(1.0, 0.0) == -1.0


def test_shearing_radii_of_the_lugged_wheels() -> None:
    # Three wheels of 157.35 mm with lugs of 15, 10 and 0 mm.
    radii = [
        shearing_radius(0.15735, lug, share) for lug, share in ((0.015, 0.75), (0.010, 0.65), (0.0, 0.0))
    ]
    assert radii == pytest.approx([0.1686, 0.16385, 0.15735])


@given(st.floats(0.0, 10.0), st.floats(0.001, 10.0))
def test_speed_ratio_undoes_slip_ratio(speed: float, rim: float) -> None:
    ratio = slip_ratio(speed, rim)
    if ratio > -0.999:
        assert speed_ratio(ratio) == pytest.approx(speed / rim, rel=1e-9, abs=1e-12)


@given(st.floats(1e-9, 1e-6))
def test_slip_and_skid_meet_at_zero(step: float) -> None:
    assert speed_ratio(step) == pytest.approx(1.0, abs=2 * step)
    assert speed_ratio(-step) == pytest.approx(1.0, abs=2 * step)
    assert slip_ratio(1.0 + step, 1.0) == pytest.approx(-slip_ratio(1.0, 1.0 + step))


def test_shapes_broadcast() -> None:
    assert slip_ratio(np.ones((3, 1)), np.ones(4)).shape == (3, 4)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: slip_ratio(-1.0, 1.0), "speed_m_s"),
        (lambda: slip_ratio(math.nan, 1.0), "speed_m_s"),
        (lambda: slip_ratio(0.0, 0.0), "the greater of"),
        (lambda: speed_ratio(1.5), "slip"),
        (lambda: shearing_radius(-0.1, 0.0, 0.0), "radius_m"),
        (lambda: shearing_radius(0.1, 0.01, 1.5), "shearing_share"),
    ],
)
def test_what_cannot_be_is_refused(call: object, name: str) -> None:
    assert callable(call)
    with pytest.raises(ModelError, match=name):
        call()
