"""The continuous angle of a wheel: speeds where there are no positions, wraps, and what is unknown."""

import math

import pytest

from controllers.estimation.wheels.angle import Angle, WheelAngle

MS = 1_000_000
LIMIT_RAD_S = 12.0
SILENT_S = 0.3


def make(wrap_rad: float | None = None) -> WheelAngle:
    return WheelAngle(LIMIT_RAD_S, SILENT_S, wrap_rad)


def test_speeds_are_integrated_by_the_trapezoid_rule() -> None:
    wheel = make()
    first = wheel.take(0, None, 1.0)
    second = wheel.take(100 * MS, math.nan, 3.0)
    assert first is not None
    assert not first.is_new_base
    assert second is not None
    assert second.angle_rad == pytest.approx(0.2)
    assert not second.is_new_base
    # The speed may have changed at the beginning or at the end: 0.3 or 0.1 rad.
    assert second.error_rad == pytest.approx(0.1)


def test_a_gap_of_the_speeds_is_a_new_base() -> None:
    wheel = make()
    wheel.take(0, None, 2.0)
    after = wheel.take(400 * MS, None, 2.0)
    assert after is not None
    assert after.is_new_base
    assert after.angle_rad == 0.0


def test_positions_lead_where_both_exist() -> None:
    wheel = make()
    for i in range(20):
        angle = wheel.take(i * 50 * MS, 0.1 * i, 9.0)
        assert angle is not None
        assert angle.angle_rad == pytest.approx(0.1 * i)
        assert wheel.take(i * 50 * MS + 10 * MS, None, 9.0) is None


def drive_with_a_gap(
    wheel: WheelAngle, *, scale: float = 1.0, restart_rad: float = 0.0, from_rad: float = 0.0
) -> Angle:
    """Return the angle after a gap of 1.1 s in which only speeds come; the wheel turns by 4 rad in all."""
    found = None
    for i in range(17):
        shown_rad = (from_rad + 0.25 * i) % math.tau - (restart_rad if i > 5 else 0.0)
        angle = wheel.take(i * 100 * MS, None if 5 < i < 16 else shown_rad, 2.5 * scale)
        found = angle or found
    assert found is not None
    return found


@pytest.mark.parametrize("wrap_rad", [None, 100.0, math.inf])
def test_speeds_take_over_when_positions_end_and_positions_when_they_return(wrap_rad: float | None) -> None:
    angle = drive_with_a_gap(make(wrap_rad))
    assert angle.angle_rad == pytest.approx(4.0)
    assert not angle.is_new_base
    assert angle.error_rad == 0.0


@pytest.mark.parametrize("wrap_rad", [None, 100.0])
def test_a_position_that_returns_and_disagrees_with_the_speeds_is_a_new_base(wrap_rad: float | None) -> None:
    angle = drive_with_a_gap(make(wrap_rad), scale=0.5)
    assert angle.is_new_base
    assert abs(angle.angle_rad - 4.0) <= angle.error_rad + 1e-9


def test_a_counter_that_has_restarted_in_a_gap_is_a_new_base_as_uncertain_as_a_wheel_can_be() -> None:
    angle = drive_with_a_gap(make(), restart_rad=500.0)
    assert angle.is_new_base
    assert angle.angle_rad == pytest.approx(4.0)
    assert angle.error_rad == pytest.approx(2.75 + 1.5 * LIMIT_RAD_S * 1.1)


def test_a_position_that_never_wraps_leads_over_speeds_that_disagree() -> None:
    angle = drive_with_a_gap(make(math.inf), scale=0.5)
    assert angle.angle_rad == pytest.approx(4.0)
    assert not angle.is_new_base
    assert angle.error_rad == pytest.approx(1.375, abs=0.2)


def test_a_wrap_in_a_gap_is_counted_where_the_speeds_agree() -> None:
    angle = drive_with_a_gap(make(), from_rad=4.0)
    assert not angle.is_new_base
    assert angle.angle_rad == pytest.approx(8.0)


@pytest.mark.parametrize("low_rad", [-math.pi, 0.0])
@pytest.mark.parametrize("turns", [1, 2, 3, 4])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_wrap_of_one_to_four_turns_is_counted(low_rad: float, turns: int, direction: float) -> None:
    wheel, range_rad = make(), turns * math.tau
    for i in range(200):
        true_rad = 1.0 + direction * 0.4 * i
        angle = wheel.take(i * 100 * MS, (true_rad - low_rad) % range_rad + low_rad, None)
        assert angle is not None
        assert not angle.is_new_base
        assert angle.angle_rad == pytest.approx(true_rad)


def test_a_counter_that_begins_anew_is_no_wrap() -> None:
    wheel = make()
    for i in range(12):
        wheel.take(i * 100 * MS, 0.4 * i, None)
    angle = wheel.take(1200 * MS, 0.0, None)
    assert angle is not None
    assert angle.angle_rad == 0.0  # a jump, which the odometry takes for a new base


def test_an_angle_beyond_two_turns_does_not_wrap() -> None:
    wheel = make()
    for i in range(40):
        wheel.take(i * 100 * MS, 0.4 * i, None)
    angle = wheel.take(4000 * MS, 16.0 - 2 * math.tau, None)
    assert angle is not None
    assert angle.angle_rad == pytest.approx(16.0 - 2 * math.tau)


def test_a_step_that_may_be_a_wrap_or_a_motion_is_a_new_base() -> None:
    wheel = make()
    for i in range(3):
        wheel.take(i * 500 * MS, 2.0 * i % math.tau, None)
    # 4 to 6 rad, or wrapped; the next is 6 + 2 = 8 rad, which is 1.72: a step of -4.28 rad in half a second.
    wheel.take(1500 * MS, 6.0, None)
    angle = wheel.take(2000 * MS, 8.0 - math.tau, None)
    assert angle is not None
    assert angle.is_new_base


@pytest.mark.parametrize(("elapsed_ms", "is_new_base"), [(100, False), (400, False), (600, True)])
def test_turns_of_a_known_range_are_unknown_where_the_wheel_may_have_made_more(
    elapsed_ms: int, is_new_base: bool
) -> None:
    wheel = make(wrap_rad=math.tau)
    wheel.take(0, 0.0, None)
    # Counted as 0.4 rad; 0.4 rad less one turn needs 5.9 rad, half a second at the limit.
    angle = wheel.take(elapsed_ms * MS, 0.4, None)
    assert angle is not None
    assert angle.is_new_base == is_new_base


@pytest.mark.parametrize(
    ("position", "speed"), [(None, None), (math.nan, math.nan), (math.inf, None), (None, 1e9)]
)
def test_a_sample_without_a_usable_number_adds_nothing(position: float | None, speed: float | None) -> None:
    assert make().take(0, position, speed) is None


def test_old_samples_add_nothing() -> None:
    wheel = make()
    wheel.take(100 * MS, 1.0, 2.0)
    assert wheel.take(100 * MS, 2.0, None) is None
    assert wheel.take(50 * MS, 2.0, 3.0) is None
    assert wheel.take(50 * MS, None, 3.0) is None


def test_a_speed_beside_a_position_that_stays_is_a_contradiction() -> None:
    wheel, found = make(), []
    # A drive at rest may report a coarse step; without positions the speeds are all there is.
    for t_ms, position, speed in ((0, 1.0, 0.1), (100, 1.0, 4.0), (1000, None, 4.0)):
        wheel.take(t_ms * MS, position, speed)
        found.append(wheel.contradicts_rest)
    assert found == [False, True, False]


def test_a_speed_that_is_no_longer_reported_contradicts_no_rest() -> None:
    wheel = make()
    for i in range(20):
        wheel.take(i * 100 * MS, 0.3 * i, 3.0)
    for i in range(20, 60):
        wheel.take(i * 100 * MS, 0.3 * 20, None)
    assert not wheel.contradicts_rest


def test_a_reset_forgets_positions_and_speeds() -> None:
    wheel = make()
    wheel.take(0, 5.0, 2.0)
    wheel.reset()
    angle = wheel.take(50 * MS, 0.0, None)
    assert angle is not None
    assert angle.angle_rad == 0.0
