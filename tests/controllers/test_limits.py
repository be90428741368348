"""The limiter: nothing beyond the limits leaves it, and nothing jumps."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.motion.limits import Limit, WheelLimiter
from controllers.motion.settings import LimitSettings

SETTINGS = LimitSettings(wheel_speed_rad_s=10.0, wheel_acceleration_rad_s2=20.0)
EXPIRY_S = 0.15
MS = 1_000_000
START_NS = 1000 * MS
STANDING = (0.0, 0.0, 0.0)

any_speed = st.floats(allow_nan=True, allow_infinity=True)
finite_speed = st.floats(-1e300, 1e300)
wheels = st.tuples(any_speed, any_speed, any_speed)
measured = st.tuples(finite_speed, finite_speed, finite_speed)
cycles = st.lists(st.tuples(st.integers(-50 * MS, 400 * MS), wheels, measured), min_size=1, max_size=20)


def make() -> WheelLimiter:
    return WheelLimiter(SETTINGS, EXPIRY_S)


def started(*speeds: float) -> WheelLimiter:
    limiter = make()
    assert limiter.limit(START_NS, speeds, speeds) == (speeds, Limit.NONE)
    return limiter


@given(cycles=cycles)
def test_no_set_point_ever_exceeds_the_limits(
    cycles: list[tuple[int, tuple[float, ...], tuple[float, ...]]],
) -> None:
    limiter, now_ns = make(), 0
    before: tuple[float, ...] | None = None
    for elapsed_ns, target, is_turning in cycles:
        now_ns += elapsed_ns
        speeds, _ = limiter.limit(now_ns, target, is_turning)
        assert all(abs(speed) <= SETTINGS.wheel_speed_rad_s for speed in speeds)
        if not all(map(math.isfinite, target)):
            assert speeds == STANDING
            before = None
            continue
        if before is not None and elapsed_ns <= 150 * MS:
            allowed = SETTINGS.wheel_acceleration_rad_s2 * max(0, elapsed_ns) / 1e9
            for new, old in zip(speeds, before, strict=True):
                assert abs(new - old) <= allowed + 1e-12
        before = speeds


def test_speed_is_scaled_by_one_factor_for_all_wheels() -> None:
    limiter = started(4.0, -8.0, 2.0)
    speeds, limit = limiter.limit(START_NS + 100 * MS, (5.5, -11.0, 2.75), STANDING)
    assert speeds == pytest.approx((5.0, -10.0, 2.5))
    assert limit is Limit.SPEED


def test_the_ramp_moves_all_wheels_by_one_share_of_their_change() -> None:
    limiter = started(1.0, 0.0, -1.0)
    speeds, limit = limiter.limit(START_NS + 20 * MS, (5.0, 2.0, -1.0), STANDING)
    assert speeds == pytest.approx((1.4, 0.2, -1.0))
    assert limit is Limit.ACCELERATION
    speeds, _ = limiter.limit(START_NS + 40 * MS, (5.0, 2.0, -1.0), STANDING)
    assert speeds == pytest.approx((1.8, 0.4, -1.0))


def test_what_is_within_the_limits_passes_unchanged() -> None:
    limiter = started(1.0, 2.0, 3.0)
    assert limiter.limit(START_NS + 20 * MS, (1.1, 2.2, 2.9), STANDING) == ((1.1, 2.2, 2.9), Limit.NONE)


def test_set_points_right_at_the_limit_pass_bit_for_bit() -> None:
    settings = LimitSettings(wheel_speed_rad_s=4.9, wheel_acceleration_rad_s2=20.0)
    fastest = (4.9, 1.3, -2.9)
    assert [speed / 4.9 * 4.9 for speed in fastest] != list(fastest)
    assert WheelLimiter(settings, EXPIRY_S).limit(0, fastest, fastest) == (fastest, Limit.NONE)


def test_a_set_point_too_few_is_an_error() -> None:
    with pytest.raises(ValueError, match="argument 2 is longer"):
        started(1.0, 2.0, 3.0).limit(START_NS + 20 * MS, (1.0, 2.0), STANDING)


def test_both_limits_at_once_report_the_ramp() -> None:
    speeds, limit = started(0.0, 0.0, 0.0).limit(START_NS + 100 * MS, (30.0, 0.0, 0.0), STANDING)
    assert speeds == pytest.approx((2.0, 0.0, 0.0))
    assert limit is Limit.ACCELERATION


def test_after_a_stop_the_ramp_starts_from_the_measured_speed() -> None:
    limiter = started(5.0, 5.0, 5.0)
    limiter.stop()
    rolling = (0.5, -0.25, 0.0)
    assert limiter.limit(START_NS + 20 * MS, (5.0, 5.0, 5.0), rolling) == (rolling, Limit.ACCELERATION)
    speeds, _ = limiter.limit(START_NS + 40 * MS, (5.0, 5.0, 5.0), STANDING)
    assert max(abs(new - old) for new, old in zip(speeds, rolling, strict=True)) == pytest.approx(0.4)


@pytest.mark.parametrize(("pause_ms", "first"), [(150, (8.0, 8.0, 8.0)), (151, (1.0, 1.0, 1.0))])
def test_after_the_set_points_expired_the_ramp_starts_from_the_measured_speed(
    pause_ms: int, first: tuple[float, ...]
) -> None:
    limiter = started(5.0, 5.0, 5.0)
    speeds, _ = limiter.limit(START_NS + pause_ms * MS, (9.0, 9.0, 9.0), (1.0, 1.0, 1.0))
    assert speeds == pytest.approx(first)


def test_a_measured_speed_beyond_the_limit_is_scaled_too() -> None:
    speeds, _ = make().limit(0, STANDING, (40.0, -20.0, 0.0))
    assert speeds == pytest.approx((10.0, -5.0, 0.0))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_target_that_is_not_finite_stops_all_wheels(bad: float) -> None:
    limiter = started(5.0, 5.0, 5.0)
    assert limiter.limit(START_NS + 20 * MS, (5.0, bad, 5.0), STANDING) == (STANDING, Limit.NOT_FINITE)
    assert limiter.limit(START_NS + 40 * MS, (5.0, 5.0, 5.0), STANDING) == (STANDING, Limit.ACCELERATION)


def test_time_that_runs_backwards_changes_nothing() -> None:
    limiter = started(5.0, 5.0, 5.0)
    assert limiter.limit(START_NS - 20 * MS, STANDING, STANDING) == ((5.0, 5.0, 5.0), Limit.ACCELERATION)
