"""Units of free-form terms and of their coefficients."""

import pytest

from rover_hil.gap.evidence.terms import power, product, ratio


@pytest.mark.parametrize(
    ("unit", "squared"),
    [("1", "1"), ("deg", "deg^2"), ("m/s", "(m/s)^2"), ("N m", "(N m)^2"), ("deg^2", "(deg^2)^2")],
)
def test_a_squared_unit_squares_the_whole_unit(unit: str, squared: str) -> None:
    assert power(unit, 2) == squared


@pytest.mark.parametrize(
    ("first", "second", "together"),
    [
        ("1", "1", "1"),
        ("1", "deg", "deg"),
        ("kg", "1", "kg"),
        ("deg", "kg", "deg kg"),
        ("m/s", "rad/s", "(m/s) (rad/s)"),
        ("m/s", "m/s", "(m/s)^2"),
    ],
)
def test_units_of_products(first: str, second: str, together: str) -> None:
    assert product(first, second) == together


@pytest.mark.parametrize(
    ("above", "below", "quotient"),
    [
        ("m/s", "1", "m/s"),
        ("m/s", "m/s", "1"),
        ("N", "deg", "N/deg"),
        ("N", "deg^2", "N/deg^2"),
        ("m/s", "(m/s)^2", "m/s per (m/s)^2"),
        ("deg", "deg kg", "deg per deg kg"),
        ("deg/m", "kg", "deg/m per kg"),
    ],
)
def test_units_of_coefficients(above: str, below: str, quotient: str) -> None:
    assert ratio(above, below) == quotient
