"""What a browser sends is looked at before anything is computed with it."""

import pytest

pytest.importorskip("nicegui", reason="the extra `bench` is not installed")

from rover_hil.bench.page import finite_numbers


@pytest.mark.parametrize(
    "given",
    [
        ["nan", 0, 0],
        [float("nan"), 0, 0],
        [float("inf"), 0.0, 0.0],
        [0, 0, -float("inf")],
        [10**400, 0, 0],
        [True, 0, 0],
        [None, 0, 0],
        ["1", 0, 0],
        [[0], 0, 0],
        [0, 0],
        [0, 0, 0, 0],
        {"0": 0},
        "000",
        None,
        1,
    ],
)
def test_anything_but_so_many_finite_numbers_is_refused(given: object) -> None:
    assert finite_numbers(given, 3) is None


def test_finite_numbers_are_taken_as_they_are() -> None:
    assert finite_numbers([1, -0.5, 7.0], 3) == [1.0, -0.5, 7.0]
