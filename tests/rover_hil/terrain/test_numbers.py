"""Lists of numbers on the command line, and tables of results."""

import csv
import io
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ConfigError, ModelError
from rover_hil.terrain.number_list import parse_numbers
from rover_hil.terrain.table import Table


def numbers(text: str) -> tuple[float, ...]:
    return parse_numbers("--roll-deg", text, "deg", -45.0, 45.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("20", (20.0,)),
        ("10, 15,20", (10.0, 15.0, 20.0)),
        ("0:20:5", (0.0, 5.0, 10.0, 15.0, 20.0)),
        ("0:19:5", (0.0, 5.0, 10.0, 15.0)),
        ("0:0.3:0.1", (0.0, 0.1, 0.2, 0.3)),
        ("10:-10:-10", (10.0, 0.0, -10.0)),
        ("-5:5:5,20", (-5.0, 0.0, 5.0, 20.0)),
        ("7:7:1", (7.0,)),
    ],
)
def test_lists_are_read(text: str, expected: tuple[float, ...]) -> None:
    assert numbers(text) == expected


@pytest.mark.parametrize(
    "text", ["", "a", "1,,2", "0:20", "0:20:0", "0:20:-5", "20:0:5", "0:1:1e-9", "nan:1:1", "0:inf:1", "1;2"]
)
def test_malformed_lists_name_option_text_unit_and_range(text: str) -> None:
    with pytest.raises(
        ConfigError, match=r"--roll-deg is .* in deg within -45 \.\. 45: write a,b,c or"
    ) as caught:
        numbers(text)
    assert f"'{text}'" in str(caught.value)


@pytest.mark.parametrize("text", ["46", "-45.1", "nan", "inf", "0:50:10", "1e400"])
def test_numbers_outside_the_range_are_named_with_unit_and_range(text: str) -> None:
    with pytest.raises(ModelError, match=r"--roll-deg is \S+ deg, outside -45 \.\. 45 deg"):
        numbers(text)


@given(st.integers(-400, 400), st.integers(0, 30), st.integers(1, 14))
def test_ranges_have_their_end_and_no_rounding(start: int, steps: int, tenths: int) -> None:
    end = start + steps * tenths
    text = f"{start / 10}:{end / 10}:{tenths / 10}"
    if end > 450:
        with pytest.raises(ModelError):
            numbers(text)
    else:
        assert numbers(text) == tuple((start + index * tenths) / 10 for index in range(steps + 1))


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_csv_keeps_every_digit(value: float) -> None:
    table = Table("t", "T", ("a", "b", "c", "d"), [(value, None, True, "word")])
    header, row = csv.reader(io.StringIO(table.csv_text()))
    assert header == ["a", "b", "c", "d"]
    assert math.copysign(1.0, float(row[0])) == math.copysign(1.0, value)
    assert (float(row[0]), row[1], row[2], row[3]) == (value, "", "true", "word")
