import math
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from controllers.slip.effort.motor_model import EffortFlag, WheelEffort
from controllers.slip.effort.slip_map import (
    Feature,
    MonotoneMap,
    PolynomialMap,
    TractionMap,
    WheelMap,
    slip_at,
    wheel_slip,
)
from controllers.slip.interpolation import interpolate

LINE = PolynomialMap(feature="paper_torque_nm", valid_from=0.02, valid_to=0.4, coefficients=(0.1, 1.5))
PARABOLA = PolynomialMap(feature="current_a", valid_from=0.0, valid_to=1.5, coefficients=(-0.05, 0.2, 0.1))
TABLE = MonotoneMap(
    feature="current_a",
    valid_from=0.1,
    valid_to=1.2,
    points=(0.1, 0.5, 0.6, 1.2),
    slips=(0.0, 0.1, 0.1, 0.7),
)
TRACTION = TractionMap(
    feature="wheel_torque_nm", valid_from=-0.05, valid_to=0.9, greatest=0.8, slip_scale=0.2
)
MAPS: Sequence[WheelMap] = (LINE, PARABOLA, TABLE, TRACTION)


def effort(
    flags: tuple[EffortFlag, ...] = (), *, speed_rad_s: float = 3.0, value: float = 0.3
) -> WheelEffort:
    return WheelEffort(value, speed_rad_s, value, value, flags)


@pytest.mark.parametrize("wheel_map", MAPS)
@given(value=st.floats(allow_nan=False))
def test_slip_is_within_its_limits_everywhere(wheel_map: WheelMap, value: float) -> None:
    assert -1.0 <= slip_at(wheel_map, value) <= 1.0


@pytest.mark.parametrize("wheel_map", MAPS)
@given(value=st.floats(-1.0, 2.0), more=st.floats(0.0, 1.0))
def test_more_effort_never_means_less_slip(wheel_map: WheelMap, value: float, more: float) -> None:
    assert slip_at(wheel_map, value + more) >= slip_at(wheel_map, value) - 1e-12


def test_forms_follow_their_equations() -> None:
    assert slip_at(LINE, 0.2) == pytest.approx(0.4)
    assert slip_at(PARABOLA, 1.0) == pytest.approx(0.25)
    assert slip_at(TABLE, 0.9) == pytest.approx(0.4)
    slip = slip_at(TRACTION, 0.5)
    assert 0.8 * (1 - math.exp(-slip / 0.2)) == pytest.approx(0.5)


def test_traction_beyond_its_greatest_is_full_slip() -> None:
    assert slip_at(TRACTION, 0.8) == 1.0
    assert slip_at(TRACTION, 0.9) == 1.0


def test_value_is_held_at_the_ends_and_flagged() -> None:
    inside = wheel_slip(LINE, effort(value=0.4))
    outside = wheel_slip(LINE, effort(value=0.5))
    assert inside.slip == pytest.approx(0.7)
    assert (inside.valid, inside.reason) == (True, "")
    assert outside.slip == inside.slip
    assert not outside.valid
    assert outside.reason == "paper_torque_nm of 0.5 is outside the training range"


def test_flags_of_the_effort_make_the_slip_invalid() -> None:
    estimate = wheel_slip(LINE, effort((EffortFlag.SATURATED,)))
    assert (estimate.valid, estimate.reason) == (False, "current saturated")


def test_a_wheel_turning_backwards_slips_like_one_turning_forwards() -> None:
    assert wheel_slip(LINE, effort(value=-0.3, speed_rad_s=-3.0)) == wheel_slip(LINE, effort())
    # Effort against the direction of turning is no drive: outside every map.
    assert not wheel_slip(LINE, effort(value=-0.3)).valid


@given(st.floats(-2.0, 2.0))
def test_interpolation_stays_between_its_values(at: float) -> None:
    assert 0.0 <= interpolate(TABLE.points, TABLE.slips, at) <= 0.7


def test_interpolation_meets_its_points() -> None:
    for point, slip in zip(TABLE.points, TABLE.slips, strict=True):
        assert interpolate(TABLE.points, TABLE.slips, point) == pytest.approx(slip)


@pytest.mark.parametrize(
    ("points", "slips"),
    [((0.1, 0.1), (0.0, 0.1)), ((0.1, 0.2), (0.1, 0.0)), ((0.1, 0.2, 0.3), (0.0, 0.1))],
)
def test_wrong_tables_are_refused(points: tuple[float, ...], slips: tuple[float, ...]) -> None:
    with pytest.raises(ValidationError):
        MonotoneMap(feature="current_a", valid_from=0.0, valid_to=1.0, points=points, slips=slips)


@pytest.mark.parametrize("feature", ["paper_torque_nm", "current_a", "wheel_torque_nm"])
def test_each_feature_is_read_from_the_effort(feature: Feature) -> None:
    wheel_map = PolynomialMap(feature=feature, valid_from=0.0, valid_to=9.0, coefficients=(0.0, 0.1))
    read = WheelEffort(current_a=1.0, speed_rad_s=2.0, paper_torque_nm=3.0, wheel_torque_nm=4.0, flags=())
    assert wheel_slip(wheel_map, read).slip == pytest.approx(0.1 * getattr(read, feature))


@pytest.mark.parametrize("wheel_map", MAPS)
def test_maps_survive_a_file(wheel_map: WheelMap) -> None:
    adapter: TypeAdapter[WheelMap] = TypeAdapter(WheelMap)
    assert adapter.validate_python(adapter.dump_python(wheel_map)) == wheel_map
