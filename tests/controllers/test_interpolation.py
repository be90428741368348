import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.slip.interpolation import check_rising, interpolate

numbers = st.floats(-1e3, 1e3)


@given(st.lists(numbers, min_size=2, unique=True), st.data(), numbers)
def test_the_same_as_numpy(points: list[float], data: st.DataObject, at: float) -> None:
    points.sort()
    values = data.draw(st.lists(numbers, min_size=len(points), max_size=len(points)))
    found = interpolate(points, values, at)
    assert found == pytest.approx(float(np.interp(at, points, values)), rel=1e-6, abs=1e-6)


@given(st.lists(numbers, min_size=2, unique=True), st.data(), numbers, numbers)
def test_a_table_that_rises_is_never_read_falling(
    points: list[float], data: st.DataObject, one: float, other: float
) -> None:
    points.sort()
    values = sorted(data.draw(st.lists(numbers, min_size=len(points), max_size=len(points))))
    low, high = sorted((one, other))
    assert interpolate(points, values, low) <= interpolate(points, values, high) + 1e-9
    assert values[0] <= interpolate(points, values, one) <= values[-1] + 1e-9


def test_points_and_ends() -> None:
    points, values = (0.0, 1.0, 3.0), (5.0, 6.0, 10.0)
    assert [interpolate(points, values, at) for at in (-1.0, 0.0, 0.5, 1.0, 2.0, 3.0, 4.0)] == [
        5.0,
        5.0,
        5.5,
        6.0,
        8.0,
        10.0,
        10.0,
    ]


@pytest.mark.parametrize(
    ("points", "values", "message"),
    [
        ((0.0, 1.0), (0.0,), "x and y must have the same length"),
        ((0.0, 0.0), (0.0, 1.0), "x must increase"),
        ((0.0, 1.0), (1.0, 0.0), "y must not decrease"),
    ],
)
def test_other_tables_are_refused(points: tuple[float, ...], values: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        check_rising("x", points, "y", values)


def test_level_stretches_are_allowed() -> None:
    check_rising("x", (0.0, 1.0, 2.0), "y", (3.0, 3.0, 4.0))
