"""Wrong times of recorded rows: counters that wrap, clocks that are coarser than the rows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rover_hil.drives.arrays import Array
from rover_hil.drives.clocks import (
    WRAPS,
    back_fault,
    counted_anew,
    set_ahead,
    spread,
    unit_fault,
    unset_rows,
    unwrapped,
)


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


ROWS = np.linspace(0.0, 3.98, 200)


@pytest.mark.parametrize(
    ("times_s", "unit", "words"),
    [
        (1000.0 * ROWS, "s", "20 s, which is no recording of a rover; it is 0.02 s in ms"),
        (ROWS / 1000.0, "ms", "2e-05 s, which is no recording of a rover; it is 0.02 s in s"),
        (ROWS / 86400.0, "s", "0.02 s in days"),
        (1000.0 * ROWS, "us", "it is 0.02 s in ns"),
    ],
)
def test_a_wrong_unit_shows_in_the_time_from_row_to_row(times_s: Array, unit: str, words: str) -> None:
    assert words in unit_fault(times_s, unit)


@pytest.mark.parametrize("period_s", [0.001, 0.02, 1.0, 2.5])
def test_rows_of_a_rover_have_a_right_unit(period_s: float) -> None:
    assert unit_fault(np.linspace(0.0, 99.0 * period_s, 100), "s") == ""


def test_times_that_count_from_the_row_before_are_added_up() -> None:
    steps_s: Array = 0.02 + 0.002 * np.random.default_rng(1).uniform(-1.0, 1.0, 300)
    clock = counted_anew(steps_s)
    assert clock.times_s == pytest.approx(np.cumsum(steps_s))
    assert clock.findings[0][1] == 300
    assert counted_anew(ROWS).findings == ()
    assert counted_anew(1.7e9 + np.concatenate((ROWS, ROWS))).findings == ()


def test_rows_of_time_0_are_unset_among_rows_that_rise() -> None:
    times_s: Array = 5.0 + ROWS
    times_s[[40, 41, 90]] = 0.0
    assert np.flatnonzero(unset_rows(times_s)).tolist() == [40, 41, 90]
    assert not unset_rows(ROWS).any()
    assert not unset_rows(np.concatenate((5.0 + ROWS, [0.0], ROWS))).any()


def test_two_clocks_that_alternate_are_named() -> None:
    both: Array = np.column_stack((100.0 + ROWS, 140.0 + ROWS)).ravel()
    assert "two clocks, about 39.98 s apart" in back_fault(both)
    assert back_fault(np.concatenate((ROWS, ROWS))) == ""
    assert back_fault(np.random.default_rng(2).uniform(0.0, 5.0, 300)) == ""


def test_a_clock_that_was_set_ahead_is_set_back_where_the_wheels_show_it() -> None:
    angles = np.column_stack((5.0 * ROWS, 4.0 * ROWS))
    jumped_s: Array = ROWS + np.where(np.arange(200) > 100, 3600.0, 0.0)
    clock = set_ahead(jumped_s, angles)
    assert clock.times_s == pytest.approx(ROWS)
    assert len(clock.findings) == 1


def test_missing_rows_speeds_and_a_stop_are_no_clock_that_was_set_ahead() -> None:
    angles = np.column_stack((5.0 * ROWS, 4.0 * ROWS))
    missing = np.r_[0:60, 140:200]
    assert set_ahead(ROWS[missing], angles[missing]).findings == ()
    jumped_s: Array = ROWS + np.where(np.arange(200) > 100, 5.0, 0.0)
    speeds = 2.0 + 0.01 * np.random.default_rng(3).standard_normal((200, 2))
    assert set_ahead(jumped_s, speeds).findings == ()
    assert set_ahead(jumped_s, np.ones((200, 2))).findings == ()


def test_bursts_of_unlike_size_lie_on_a_line() -> None:
    rng = np.random.default_rng(4)
    ends = np.unique(np.append(np.cumsum(rng.integers(1, 5, 200)), 300))
    ends = ends[ends <= 300]
    times_s = 0.02 * ends[np.searchsorted(ends, np.arange(300) + 1)]
    clock = spread(times_s, np.arange(300.0)[:, np.newaxis])
    assert np.diff(clock.times_s) == pytest.approx(0.02, rel=0.05)
    assert len(clock.findings) == 1
    irregular_s = np.sort(rng.choice(np.arange(0.0, 60.0, 0.5), 300))
    assert spread(irregular_s, np.arange(300.0)[:, np.newaxis]).findings == ()
