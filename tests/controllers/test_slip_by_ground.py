"""Slip between frames of a camera that measures the motion over the ground."""

import cmath
import math

import pytest

from controllers.estimation.ground.travel import GroundPair
from controllers.ground_motion.motion import GroundMotion
from controllers.slip.effort.slip_by_fixes import SlipAtForce
from controllers.slip.effort.slip_by_ground import SlipByGround

STEP_NS = 100_000_000


def pairs(
    count: int, moved: complex, *, step_m: complex = 0.02, sd_m: float = 0.0005, first: int = 0
) -> list[GroundPair]:
    return [
        GroundPair(
            rolled_m=step_m,
            ground_m=step_m * moved,
            turn_rad=0.0,
            motion=GroundMotion(
                from_ns=STEP_NS * index,
                to_ns=STEP_NS * (index + 1),
                point_m=(0.0, 0.0),
                foot_m=(0.0, 0.0),
                forward_m=(step_m * moved).real,
                forward_sd_m=sd_m,
                left_m=(step_m * moved).imag,
                left_sd_m=0.0,
                turn_rad=0.0,
                turn_sd_rad=0.01,
                scale_sd=0.01,
                direction_sd_rad=0.0,
                invalid_because="",
            ),
        )
        for index in range(first, first + count)
    ]


def found(given: list[GroundPair]) -> list[SlipAtForce]:
    by_ground = SlipByGround()
    return [slip for pair in given if (slip := by_ground.take(pair)) is not None]


def test_pairs_are_joined_until_their_travel_is_long_enough() -> None:
    (slip,) = found(pairs(15, cmath.rect(0.7, 0.1)))
    assert slip.slip == pytest.approx(0.3)
    assert slip.drift_rad == pytest.approx(0.1)
    assert slip.travel_m == pytest.approx(0.16)
    assert (slip.from_ns, slip.to_ns) == (0, 8 * STEP_NS)
    assert slip.slip_sd == pytest.approx(math.hypot(0.0005 * 8**0.5 / 0.16, 0.007))


def test_noise_needs_a_longer_travel() -> None:
    assert found(pairs(15, 0.7, sd_m=0.004)) == []


def test_a_gap_and_a_pair_that_contradicts_the_wheels_begin_anew() -> None:
    assert found([*pairs(7, 0.7), *pairs(7, 0.7, first=8)]) == []
    assert found([*pairs(7, 0.7), *pairs(1, 5.0, first=7), *pairs(7, 0.7, first=8)]) == []


def test_a_rover_that_stands_has_no_drift() -> None:
    (slip,) = found(pairs(8, 0.0))
    assert (slip.slip, slip.drift_rad) == (1.0, None)
