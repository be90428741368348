"""Which travels of the ground contradict the rig of a camera, and how much travel is then doubted."""

import pytest

from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.rig_watch import RigWatch

WHEEL_M = 0.01
SD_M = 2e-4


def watch(*stretches: tuple[float, complex]) -> list[str]:
    """Return what contradicts the rig after each pair; stretches are travel of the wheels, ground over it."""
    rig_watch, found = RigWatch(0.015, DEFAULTS.rig_watch), []
    for wheels_m, ratio in stretches:
        for _ in range(round(wheels_m / WHEEL_M)):
            rig_watch.update(WHEEL_M, ratio * WHEEL_M, SD_M)
            found.append("" if rig_watch.fault is None else rig_watch.fault.text)
    return found


@pytest.mark.parametrize("ratio", [1.08, 1.0, 0.5, 0.02, 0.0, -0.04, 0.7 + 0.5j, 0.3 - 0.6j])
def test_slip_and_sliding_contradict_no_rig(ratio: complex) -> None:
    assert not any(watch((3.0, ratio)))


@pytest.mark.parametrize(
    ("ratio", "words"),
    # A rover that slips by 0.8, seen upside down, seems to slide back by a fifth.
    [(-1.0, "upside down"), (-0.2, "upside down"), (1j, "not turned"), (1.5, "focal length")],
)
def test_a_wrong_rig_is_contradicted_from_the_first_centimetre(ratio: complex, words: str) -> None:
    assert all(words in reason for reason in watch((0.5, ratio))[1:])


@pytest.mark.parametrize("ratio", [-1.0, -1.0 + 1j, 1j])
def test_a_rover_that_slides_after_it_has_driven_on_contradicts_no_rig(ratio: complex) -> None:
    assert not any(watch((1.01, 0.9), (2.0, ratio)))
    assert any(watch((0.5, 0.9), (2.0, ratio)))


def unfollowed(*stretches: tuple[float, complex | None]) -> RigWatch:
    """Return the watch after stretches: travel of the wheels, and ground over it; None where not followed."""
    rig_watch = RigWatch(0.015, DEFAULTS.rig_watch)
    for wheels_m, ratio in stretches:
        for _ in range(round(wheels_m / WHEEL_M)):
            if ratio is None:
                rig_watch.miss(WHEEL_M)
            else:
                rig_watch.update(WHEEL_M, ratio * WHEEL_M, SD_M)
    return rig_watch


@pytest.mark.parametrize(
    ("stretches", "is_reported"),
    [
        ([(0.4, None)], False),
        ([(0.6, None)], True),
        ([(0.3, None), (0.1, 0.4), (0.4, None)], True),
        ([(0.4, None), (0.3, 0.9), (0.3, None)], False),
        ([(1.1, 0.9), (3.0, None)], False),
    ],
)
def test_ground_that_is_hardly_ever_followed_contradicts_the_rig(
    stretches: list[tuple[float, complex | None]], is_reported: bool
) -> None:
    assert ("not followed" in unfollowed(*stretches).text) is is_reported


def test_pairs_of_a_camera_that_hardly_ever_follows_the_ground_are_not_used() -> None:
    rig_watch = unfollowed((0.02, 0.4), (0.6, None), (0.02, 0.4))
    assert "not followed" in rig_watch.text
    assert rig_watch.fault is not None
    # The estimate went on with the slip of the last pairs.
    assert rig_watch.fault.bound.position_m == pytest.approx(0.6 * (0.02 + 0.6), rel=0.05)


@pytest.mark.parametrize(
    ("travel_m", "ratio", "bound_m"), [(0.2, 0.9, None), (0.2, 0.1, 0.18), (0.2, 0.0, 0.2), (1.2, 0.1, None)]
)
def test_until_the_ground_moves_along_the_wheels_may_be_right(
    travel_m: float, ratio: float, bound_m: float | None
) -> None:
    fault = unfollowed((travel_m, ratio)).fault
    assert (None if fault is None else fault.bound.position_m) == (bound_m and pytest.approx(bound_m))


def test_ground_that_outruns_the_wheels_is_told_at_any_time() -> None:
    found = watch((5.0, 0.975), (0.5, 1.5))
    assert not any(found[:500])
    assert "1.1" in found[-1] or "1.2" in found[-1]


def test_a_jerk_contradicts_no_rig() -> None:
    assert not any(watch((1.0, 1.0), (0.05, 2.0), (1.0, 1.0)))


def test_a_rover_that_rolls_back_at_first_is_measured_once_it_drives_on() -> None:
    found = watch((0.2, -1.0), (2.0, 0.9))
    assert found[19]
    assert not any(found[-150:])


def test_slip_does_not_hide_at_once_that_the_ground_outran_the_wheels() -> None:
    rig_watch = RigWatch(0.015, DEFAULTS.rig_watch)
    reported = []
    for ratio, travel_m in ((1.3, 0.5), (0.7, 0.8), (0.7, 1.0)):
        for _ in range(round(travel_m / WHEEL_M)):
            rig_watch.update(WHEEL_M, complex(ratio * WHEEL_M), SD_M)
        reported.append(bool(rig_watch.text))
    assert reported == [True, True, False]


def test_the_share_of_the_travel_that_outran_the_wheels_is_doubted_once() -> None:
    rig_watch = RigWatch(0.015, DEFAULTS.rig_watch)
    told_m = []
    for ratio in [0.975] * 200 + [1.5] * 500 + [1.0] * 600:
        rig_watch.update(WHEEL_M, complex(ratio * WHEEL_M), SD_M)
        told_m.append(0.0 if rig_watch.fault is None else rig_watch.fault.bound.position_m)
    assert told_m[199] == 0.0
    # A third of what was measured, and a little that was used before it was reported.
    assert told_m[699] == pytest.approx((1.95 + 0.4) / 3.0, rel=0.1)
    assert told_m[-1] == 0.0
