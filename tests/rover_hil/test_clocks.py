"""Wrong times of recorded rows: counters that wrap, clocks that are coarser than the rows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rover_hil.drives.clocks import WRAPS, spread, unwrapped


@given(
    steps=st.lists(st.integers(2, 5), min_size=20, max_size=200),
    start=st.floats(0.0, 1.0),
    length=st.sampled_from([length_s for length_s, _ in WRAPS]),
)
def test_a_counter_that_wraps_gives_the_times_before(steps: list[int], start: float, length: float) -> None:
    true_s = 0.01 * np.cumsum(steps) + start * length
    found = unwrapped(np.mod(true_s, length))
    # Which turn of the counter the first row stands in is in no file.
    assert found.times_s - found.times_s[0] == pytest.approx(true_s - true_s[0], abs=1e-6)
    assert bool(found.findings) == bool(np.floor(true_s[-1] / length) > np.floor(true_s[0] / length))


def test_times_that_run_back_by_something_else_stay_as_they_are() -> None:
    times_s = np.concatenate((np.arange(100) * 0.01, np.arange(100) * 0.01))
    found = unwrapped(times_s)
    assert not found.findings
    assert np.array_equal(found.times_s, times_s)


@pytest.mark.parametrize("rows", [2, 3, 5])
def test_rows_of_one_time_are_spread_up_to_the_next(rows: int) -> None:
    true_s = np.linspace(0.0, 0.02 * (20 * rows - 1), 20 * rows)
    coarse_s = true_s[::rows].repeat(rows)
    found = spread(coarse_s, np.ones((len(coarse_s), 1)))
    assert found.times_s == pytest.approx(true_s)
    assert found.findings[0][1] == 20
    assert f"{rows} of each" in found.findings[0][0]


def test_a_single_row_of_one_time_is_no_coarse_clock() -> None:
    times_s = np.sort(np.append(np.linspace(0.0, 0.98, 50), 0.3))
    found = spread(times_s, np.ones((len(times_s), 1)))
    assert not found.findings
    assert np.array_equal(found.times_s, times_s)


def test_after_a_gap_rows_of_one_time_do_not_fill_it() -> None:
    times_s = np.concatenate((np.arange(20) * 0.04, 60.0 + np.arange(20) * 0.04)).repeat(2)
    found = spread(times_s, np.ones((len(times_s), 1)))
    assert found.times_s[39] == pytest.approx(19 * 0.04 + 0.02)
    assert np.all(np.diff(found.times_s) > 0.0)


def test_rows_of_several_sensors_were_measured_at_one_time() -> None:
    times_s = np.linspace(0.0, 20.0, 41).repeat(2)
    values = np.full((82, 2), np.nan)
    values[::2, 0] = values[1::2, 1] = 1.0
    found = spread(times_s, values)
    assert not found.findings
    assert np.array_equal(found.times_s, times_s)


@pytest.mark.parametrize("start_s", [0.0, 1000.0])
@pytest.mark.parametrize("rate_hz", [1.0, 3.0, 50.0])
def test_two_recordings_in_one_file_are_no_counter_that_wraps(start_s: float, rate_hz: float) -> None:
    one_s = start_s + np.linspace(0.0, 60.0, round(60.0 * rate_hz) + 1)
    assert not unwrapped(np.concatenate((one_s, one_s))).findings


def test_a_counter_wraps_in_the_pause_between_two_bursts() -> None:
    true_s = (4294.9 + 0.01 * np.arange(40)[:, None] + 0.00025 * np.arange(4)).ravel()
    found = unwrapped(np.mod(true_s, 2.0**32 * 1e-6))
    assert found.times_s == pytest.approx(true_s)
