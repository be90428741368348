"""The turn back and forth in place that judges scale and sign of the gyro."""

import math

import pytest

from controllers.slip.effort.gyro_in_place import NOT_TURNED, OPPOSITE, TOO_SMALL, GyroInPlace
from controllers.slip.effort.parameters import EFFORT

ARM_M, CYCLE_S = 0.125, 0.02
FOLLOWER_RAD_S = 0.123


def turn(scale: float, *, follows: float = 1.0) -> tuple[GyroInPlace, list[float]]:
    """Return the watch after its turn, and the commanded yaw rates; wheels and gyro follow at once."""
    watch = GyroInPlace(ARM_M)
    rates: list[float] = []
    now_s = 100.0
    while (rate_rad_s := watch.yaw_rate_rad_s(now_s, FOLLOWER_RAD_S)) is not None:
        rates.append(rate_rad_s)
        wheels_rad_s = follows * rate_rad_s
        watch.take(CYCLE_S, wheels_rad_s, scale * wheels_rad_s)
        now_s += CYCLE_S
    return watch, rates


def test_the_turn_is_small_begins_and_ends_at_rest_and_leaves_the_heading_to_the_follower() -> None:
    watch, rates = turn(1.0)
    settling = [rate for rate in rates if rate == FOLLOWER_RAD_S]
    turning = [rate for rate in rates if rate != FOLLOWER_RAD_S]
    angles = [CYCLE_S * sum(turning[:end]) for end in range(len(turning) + 1)]
    assert len(settling) * CYCLE_S == pytest.approx(EFFORT.gyro_in_place.settle_s, abs=2 * CYCLE_S)
    assert math.degrees(max(angles)) == pytest.approx(8.5, abs=1.0)
    assert math.degrees(min(angles)) == pytest.approx(-8.5, abs=1.0)
    assert angles[-1] == pytest.approx(0.0, abs=0.002)
    assert abs(turning[0]) + abs(turning[-1]) < 0.01
    assert max(map(abs, turning)) * ARM_M == pytest.approx(EFFORT.gyro_in_place.rim_m_s, rel=0.01)
    assert watch.yaw_rate_rad_s(200.0, FOLLOWER_RAD_S) is None


@pytest.mark.parametrize(
    ("scale", "reason"),
    [
        (1.0, ""),
        (0.62, ""),
        (2.0, ""),
        (0.5, TOO_SMALL.format(share=0.5)),
        (-1.0, OPPOSITE),
    ],
)
def test_scale_and_sign_are_judged(scale: float, reason: str) -> None:
    watch, _ = turn(scale)
    assert watch.reason == reason


def test_wheels_that_do_not_turn_judge_nothing() -> None:
    watch, _ = turn(0.5, follows=0.1)
    assert watch.reason == NOT_TURNED


def test_before_and_after_its_turn_it_takes_nothing() -> None:
    watch = GyroInPlace(ARM_M)
    watch.take(100.0, 1.0, 0.1)
    assert (watch.is_turning, watch.reason) == (False, NOT_TURNED)
    done, _ = turn(1.0)
    done.take(100.0, 1.0, 0.1)
    assert (done.is_turning, done.reason) == (False, "")


def test_wheels_near_the_centre_turn_slower_so_that_the_angle_stays_small() -> None:
    watch, angle_rad, now_s = GyroInPlace(0.04), 0.0, 0.0
    angles = [0.0]
    while (rate_rad_s := watch.yaw_rate_rad_s(now_s, 0.0)) is not None:
        angle_rad += rate_rad_s * CYCLE_S
        angles.append(angle_rad)
        now_s += CYCLE_S
    assert max(map(abs, angles)) == pytest.approx(math.radians(10.0), rel=0.01)


def test_a_turn_that_a_stop_interrupts_begins_anew() -> None:
    watch = GyroInPlace(ARM_M)
    for cycle in range(60):
        rate_rad_s = watch.yaw_rate_rad_s(100.0 + CYCLE_S * cycle, FOLLOWER_RAD_S)
        assert rate_rad_s is not None
        watch.take(CYCLE_S, rate_rad_s, 0.5 * rate_rad_s)
    now_s = 110.0
    assert watch.yaw_rate_rad_s(now_s, FOLLOWER_RAD_S) == 0.0
    while (rate_rad_s := watch.yaw_rate_rad_s(now_s, FOLLOWER_RAD_S)) is not None:
        watch.take(CYCLE_S, rate_rad_s, rate_rad_s)
        now_s += CYCLE_S
    assert now_s == pytest.approx(
        110.0 + EFFORT.gyro_in_place.period_s + EFFORT.gyro_in_place.settle_s, abs=2 * CYCLE_S
    )
    assert watch.reason == ""
