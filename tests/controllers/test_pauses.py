"""A pause of the program is noticed by its cycles."""

import pytest

from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.pauses import PauseWatch, SilenceWatch
from drivers.clock import nanoseconds


def known(watch: PauseWatch, *times_s: float) -> list[bool]:
    return [watch.begin_cycle(nanoseconds(1.0 + time_s)) for time_s in times_s]


def test_after_a_pause_stamps_are_unknown_until_the_buffers_are_empty() -> None:
    watch, wait_s = PauseWatch(0.15), ESTIMATION.pose.backlog_s
    assert known(watch, 0.0, 0.02, 0.17) == [True, True, True]
    assert known(watch, 0.3201) == [False]
    times_s = (0.3201 + 0.1 * number for number in range(1, 20))
    assert known(watch, *times_s) == [0.1 * number >= wait_s for number in range(1, 20)]


@pytest.mark.parametrize("period_s", [0.2, 1.0])
def test_a_slow_loop_is_not_paused_by_its_own_cycles(period_s: float) -> None:
    watch = PauseWatch(0.15)
    assert all(known(watch, *(period_s * number for number in range(6))))
    assert known(watch, period_s * 7.9) == [True]
    assert known(watch, period_s * 12.9) == [False]


def test_one_short_cycle_of_a_slow_loop_does_not_make_the_others_pauses() -> None:
    watch = PauseWatch(0.15)
    known(watch, 0.0, 0.2, 0.4, 0.42)
    assert all(known(watch, *(0.42 + 0.2 * number for number in range(1, 20)))[6:])


def test_a_second_pause_right_after_the_first_is_one_too() -> None:
    watch = PauseWatch(0.15)
    assert known(watch, 0.0, 0.02, 3.0, 6.0, 6.02) == [True, True, False, False, False]


def test_after_a_silence_of_a_device_the_time_of_its_samples_is_unknown_for_a_while() -> None:
    watch, wait_s = SilenceWatch(0.15), ESTIMATION.pose.backlog_s

    def taken(*times_s: float) -> list[bool]:
        return [watch.take(nanoseconds(1.0 + time_s)) for time_s in times_s]

    assert taken(0.0, 0.0, 0.15, -0.5, 0.3) == [True] * 5
    assert taken(0.46, 0.461, 0.5) == [False] * 3
    times_s = (0.46 + 0.1 * number + 0.001 for number in range(1, 10))
    assert taken(*times_s) == [0.1 * number >= wait_s for number in range(1, 10)]


def test_times_that_run_back_again_and_again_are_no_number_without_bounds() -> None:
    watch = PauseWatch(0.15)
    times_s = [number % 2 * 0.5 for number in range(4000)]
    assert len(known(watch, *times_s)) == len(times_s)
    assert all(known(watch, *(10.0 + 0.02 * number for number in range(1, 60)))[30:])
