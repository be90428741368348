"""Doubts: repeated refusals and wheels that do not follow, alone and in the control loop."""

import math

from controllers.doubts import FOLLOW_S, REFUSALS_IN_A_ROW, FollowMonitor, RefusalCounter
from controllers.estimation.guarded_filter import Innovation
from drivers.clock import nanoseconds


def innovation(name: str, *, accepted: bool) -> Innovation:
    return Innovation(name=name, residual=1.0, variance=1.0, nis=1.0, accepted=accepted)


def test_refusals_in_a_row_raise_a_doubt_and_one_acceptance_ends_it() -> None:
    counter = RefusalCounter()
    for _ in range(REFUSALS_IN_A_ROW - 1):
        counter.note([innovation("compass", accepted=False), innovation("imu", accepted=True)])
    assert counter.doubt == ""
    counter.note([innovation("compass", accepted=False)])
    assert counter.doubt == "compass: contradicts the estimate, refused 20 times in a row"
    counter.note([innovation("compass", accepted=True)])
    assert counter.doubt == ""


def test_refusals_with_acceptances_between_raise_none() -> None:
    counter = RefusalCounter()
    for index in range(10 * REFUSALS_IN_A_ROW):
        counter.note([innovation("compass", accepted=index % REFUSALS_IN_A_ROW == 0)])
        assert counter.doubt == ""


def doubt_after(
    monitor: FollowMonitor, duration_s: float, commanded: tuple[float, ...], measured: tuple[float, ...]
) -> str:
    doubt = ""
    for now_ns in range(0, nanoseconds(duration_s), nanoseconds(0.02)):
        doubt = monitor.find_doubt(now_ns, commanded, measured)
    return doubt


def test_a_standing_wheel_is_named_after_a_second_and_not_before() -> None:
    standing = ((3.0, -3.0), (2.8, 0.0))
    assert doubt_after(FollowMonitor(2, 10.0), FOLLOW_S, *standing) == ""
    doubt = doubt_after(FollowMonitor(2, 10.0), FOLLOW_S + 0.1, *standing)
    assert doubt == "wheel 1: told to turn with -3.00 rad/s and stands"


def test_slow_set_points_and_slow_followers_are_no_doubt() -> None:
    assert doubt_after(FollowMonitor(1, 10.0), 5.0, (0.9,), (0.0,)) == ""
    assert doubt_after(FollowMonitor(1, 10.0), 5.0, (3.0,), (0.4,)) == ""


def test_a_wheel_that_starts_late_clears_its_account() -> None:
    monitor = FollowMonitor(1, 10.0)
    half = nanoseconds(0.9 * FOLLOW_S)
    assert monitor.find_doubt(0, (3.0,), (0.0,)) == ""
    assert monitor.find_doubt(half, (3.0,), (2.0,)) == ""
    assert monitor.find_doubt(2 * half, (3.0,), (0.0,)) == ""
    assert math.isclose(half, 0.9e9)
