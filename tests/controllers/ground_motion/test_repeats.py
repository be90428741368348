"""Frames that are sent again differ less from the last one than frames did before."""

import pytest

from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.repeats import RepeatWatch


def watch_after(differences: list[float]) -> RepeatWatch:
    watch = RepeatWatch(DEFAULTS.repeats)
    for grey in differences:
        assert not watch.is_repeated(grey, may_wait=True)
    return watch


@pytest.mark.parametrize(("grey", "is_repeated"), [(0.3, True), (2.9, True), (3.1, False), (14.0, False)])
def test_a_frame_with_less_than_a_third_of_the_difference_is_repeated(grey: float, is_repeated: bool) -> None:
    watch = watch_after([10.0] * 8)
    assert watch.is_repeated(grey, may_wait=True) is is_repeated


def test_the_same_frame_is_repeated_as_often_as_it_comes() -> None:
    watch = RepeatWatch(DEFAULTS.repeats)
    assert all(watch.is_repeated(0.0, may_wait=False) for _ in range(20))


def test_ground_that_stands_is_not_repeated_for_long() -> None:
    """Four frames of noise, and then this is the difference of new frames."""
    watch = watch_after([10.0] * 8)
    assert [watch.is_repeated(1.2, may_wait=True) for _ in range(20)] == [True] * 4 + [False] * 16


def test_frames_that_are_no_longer_awaited_are_undecided_before_they_are_of_ground_that_stands() -> None:
    watch, undecided = watch_after([10.0] * 8), []
    for _ in range(20):
        watch.is_repeated(1.2, may_wait=True)
        undecided.append(watch.is_undecided)
    assert undecided == [False] * 4 + [True] * 5 + [False] * 11


def test_a_pair_that_must_not_become_longer_is_not_left_open() -> None:
    watch = watch_after([10.0] * 8)
    assert not watch.is_repeated(0.3, may_wait=False)
