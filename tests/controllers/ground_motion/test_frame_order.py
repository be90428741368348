from collections.abc import Sequence

import pytest

from controllers.ground_motion.frame_order import FrameOrder, Order
from controllers.ground_motion.parameters import DEFAULTS

WHEEL_M, SD_M = 0.02, 0.0002


def judged(
    places: Sequence[int], slip: float = 0.0, *, rate_before: bool = True, may_wait: bool = True
) -> list[Order]:
    """Return what becomes of pictures, given by the time at which they were taken, in wheel steps."""
    order, began, along_m = FrameOrder(DEFAULTS.order), 0, (1.0 - slip) * WHEEL_M
    if rate_before:
        order.use(along_m, WHEEL_M)
    results: list[Order] = []
    for number, place in enumerate(places[1:], 1):
        moved_m, wheel_m = along_m * (place - places[began]), WHEEL_M * (number - began)
        results.append(order.judge(moved_m, wheel_m, SD_M))
        if results[-1] is not Order.UNDECIDED or not may_wait:
            began = number
            order.begin()
        if results[-1] is Order.RIGHT:
            order.use(moved_m, wheel_m)
    return results


RIGHT, UNDECIDED, WRONG = Order.RIGHT, Order.UNDECIDED, Order.WRONG


@pytest.mark.parametrize("slip", [0.0, 0.3, 0.6])
@pytest.mark.parametrize(
    ("places", "expected"),
    [
        ([0, 1, 2, 3], [RIGHT, RIGHT, RIGHT]),
        ([0, 1, 3, 2, 4, 5], [RIGHT, UNDECIDED, UNDECIDED, RIGHT, RIGHT]),
        ([1, 0, 3, 2, 5, 4], [UNDECIDED, RIGHT, UNDECIDED, RIGHT, UNDECIDED]),
        ([1, 0, 2, 3, 4], [UNDECIDED, WRONG, RIGHT, RIGHT]),
        ([0, 1, 3, 2, 5, 4, 6], [RIGHT, UNDECIDED, UNDECIDED, UNDECIDED, UNDECIDED, RIGHT]),
    ],
)
def test_frames_that_have_changed_places_give_no_wrong_travel(
    slip: float, places: list[int], expected: list[Order]
) -> None:
    assert judged(places, slip) == expected


def test_swapped_frames_are_recognised_before_any_pair() -> None:
    expected = [UNDECIDED, WRONG, UNDECIDED, RIGHT, UNDECIDED, RIGHT]
    assert judged([1, 0, 3, 2, 5, 4, 7], rate_before=False) == expected


def test_where_a_pair_cannot_stay_open_only_frames_in_order_are_used() -> None:
    """The wheels roll so far that every frame begins a pair."""
    swapped = judged([1, 0, 3, 2, 5, 4, 7, 6], rate_before=False, may_wait=False)
    assert set(swapped) == {UNDECIDED}
    later = judged([1, 0, 3, 2, 4, 5, 6, 7], rate_before=False, may_wait=False)
    assert later == [UNDECIDED] * 5 + [RIGHT, RIGHT]


def test_a_later_frame_followed_by_frames_in_order_is_not_used() -> None:
    assert judged([1, 0, 2, 3, 5, 4, 6], rate_before=False)[1:3] == [WRONG, RIGHT]


def test_a_rover_that_slides_back_is_measured_from_the_second_frame_on() -> None:
    assert judged([0, 1, 2, 1, 0, -1, -2])[2:4] == [UNDECIDED, RIGHT]


def test_a_rover_that_gets_free_is_measured_from_the_second_frame_on() -> None:
    order = FrameOrder(DEFAULTS.order)
    order.use(0.0, WHEEL_M)
    assert order.judge(WHEEL_M, WHEEL_M, SD_M) is UNDECIDED
    assert order.judge(2 * WHEEL_M, 2 * WHEEL_M, SD_M) is RIGHT


def test_frames_of_wheels_that_stand_are_not_judged() -> None:
    assert FrameOrder(DEFAULTS.order).judge(-0.01, 0.0, SD_M) is RIGHT
