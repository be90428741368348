"""Definitions of slip, skid and shearing radius."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ModelError
from sim_backends.terramechanics.soil.slip import shearing_radius, speed_ratio


def slip_ratio(speed: float, rim: float) -> float:
    return (rim - speed) / max(speed, rim)


def test_shearing_radii_of_the_lugged_wheels() -> None:
    # Three wheels of 157.35 mm with lugs of 15, 10 and 0 mm.
    radii = [
        shearing_radius(0.15735, lug, share) for lug, share in ((0.015, 0.75), (0.010, 0.65), (0.0, 0.0))
    ]
    assert radii == pytest.approx([0.1686, 0.16385, 0.15735])


@given(st.floats(0.0, 10.0), st.floats(0.001, 10.0))
def test_speed_ratio_undoes_the_slip_ratio(speed: float, rim: float) -> None:
    ratio = slip_ratio(speed, rim)
    if ratio > -0.999:
        assert speed_ratio(ratio) == pytest.approx(speed / rim, rel=1e-9, abs=1e-12)


@given(st.floats(1e-9, 1e-6))
def test_slip_and_skid_meet_at_zero(step: float) -> None:
    assert speed_ratio(step) == pytest.approx(1.0, abs=2 * step)
    assert speed_ratio(-step) == pytest.approx(1.0, abs=2 * step)


@pytest.mark.parametrize("slip", [1.5, -1.0, math.nan])
def test_slips_outside_the_domain_are_refused(slip: float) -> None:
    with pytest.raises(ModelError, match="slip"):
        speed_ratio(slip)


@pytest.mark.parametrize(("radius", "share", "name"), [(-0.1, 0.0, "radius_m"), (0.1, 1.5, "shearing_share")])
def test_radii_outside_the_domain_are_refused(radius: float, share: float, name: str) -> None:
    with pytest.raises(ModelError, match=name):
        shearing_radius(radius, 0.01, share)
