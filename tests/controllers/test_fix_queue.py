"""Fixes wait for the motion up to their picture, and the way back to it."""

import math
from dataclasses import astuple, replace

import pytest

from controllers.estimation.filter.motion_history import Step
from drivers.samples import PoseFixSample
from tests.controllers.floor_fixes import FIX, PositionQueue
from tests.controllers.simulated import MS

STEP = Step(x_m=0.1, y_m=0.0, turn_rad=0.0, duration_s=0.1, position_m2=1e-4, yaw_rad2=1e-6)


def fix_at(t_ms: int) -> PoseFixSample:
    return replace(FIX, t_ns=(t_ms + 40) * MS, t_capture_ns=t_ms * MS)


def queue(*fixes: PoseFixSample) -> PositionQueue:
    fix_queue = PositionQueue()
    for fix in fixes:
        fix_queue.add(fix, fix.t_ns)
    return fix_queue


def test_a_fix_waits_for_the_motion_up_to_its_picture() -> None:
    fix_queue = queue(fix_at(1150))
    fix_queue.move(1100 * MS, STEP)
    assert fix_queue.take() == []
    fix_queue.move(1200 * MS, STEP)
    ((fix, way_back),) = fix_queue.take()
    assert fix == fix_at(1150)
    assert way_back is not None
    assert astuple(way_back)[:6] == pytest.approx((-0.05, 0.0, 0.0, 0.5e-4, 0.5e-6, 0.0))
    assert fix_queue.take() == []


def test_the_way_back_is_in_the_present_body_frame() -> None:
    fix_queue = queue(fix_at(1100))
    fix_queue.move(1100 * MS, STEP)
    # One step ahead, then a quarter turn on the spot: the rover was to the left of where it now looks.
    fix_queue.move(1200 * MS, STEP)
    fix_queue.move(1300 * MS, replace(STEP, x_m=0.0, turn_rad=-math.pi / 2))
    ((_, way_back),) = fix_queue.take()
    assert way_back is not None
    assert (way_back.x_m, way_back.y_m) == pytest.approx((0.0, -0.1))
    assert way_back.turned_rad == pytest.approx(-math.pi / 2)
    assert way_back.position_m2 == pytest.approx(2e-4)


def test_a_fix_from_before_the_remembered_motion_has_no_way_back() -> None:
    fix_queue = queue(fix_at(999))
    for step in range(40):
        fix_queue.move((1100 + 100 * step) * MS, STEP)
    ((_, way_back),) = fix_queue.take()
    assert way_back is None
    fix_queue.add(fix_at(3100), 5100 * MS)
    assert fix_queue.take()[0][1] is not None
    fix_queue.add(fix_at(5000 - 2001), 5100 * MS)  # older than the one before
    assert fix_queue.take() == []


def test_a_gap_in_the_motion_forgets_what_was_before() -> None:
    fix_queue = queue(fix_at(1050))
    fix_queue.move(1100 * MS, STEP)
    fix_queue.move(1500 * MS, STEP)
    ((_, way_back),) = fix_queue.take()
    assert way_back is None


def test_fixes_of_other_devices_repeated_ones_and_floods_do_no_harm() -> None:
    fix_queue = queue(replace(fix_at(1050), device="other"), fix_at(1060), fix_at(1060), fix_at(1050))
    fix_queue.move(1100 * MS, STEP)
    assert [fix for fix, _ in fix_queue.take()] == [fix_at(1060)]
    for t_ms in range(2000, 3000):
        fix_queue.add(fix_at(t_ms), (t_ms + 40) * MS)
    fix_queue.move(1200 * MS, STEP)
    assert fix_queue.take() == []
    for step in range(19):
        fix_queue.move((1300 + 100 * step) * MS, STEP)
    assert 0 < len(fix_queue.take()) < 20


def test_a_picture_from_the_future_counts_as_taken_at_its_arrival() -> None:
    fix_queue = PositionQueue()
    fix_queue.add(fix_at(9000), 1050 * MS)
    fix_queue.move(1100 * MS, STEP)
    assert len(fix_queue.take()) == 1
