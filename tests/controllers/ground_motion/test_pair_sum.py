"""The motion over the ground is measured once for all that look at the frames."""

import math

import numpy as np
import pytest

from controllers.ground_motion.ground_view import GroundView, SeenGround
from controllers.ground_motion.pair_sum import PairSum
from controllers.ground_motion.prior import MotionPrior
from drivers.samples import Image
from tests.controllers.ground_motion.test_estimator import GROUND, STEP_NS, WHEEL_M, patch_at, wide_ground

PRIOR = MotionPrior(
    forward_m=WHEEL_M, left_m=0.0, turn_rad=(0.0, 0.0, 0.0), turn_sd_rad=(1e-3, 1e-3, 1e-3), has_gyro=True
)


def grounds(pairs: PairSum, travels_m: list[float]) -> list[SeenGround]:
    """Return views of one ground after these travels; NaN for a frame that shows other ground."""
    known, other = wide_ground(), wide_ground(9)
    patches = [patch_at(other, 0.1) if math.isnan(m) else patch_at(known, m) for m in travels_m]
    return [_seen(pairs, patch) for patch in patches]


def _seen(pairs: PairSum, patch: Image) -> SeenGround:
    log_grey = pairs.view.structure.log_grey(patch)
    return SeenGround(patch, log_grey, pairs.view.structure.of(log_grey))


@pytest.fixture
def pairs() -> PairSum:
    return PairSum(GroundView(GROUND))


def test_the_sum_is_the_motion_since_it_was_last_taken(pairs: PairSum) -> None:
    frames = grounds(pairs, [WHEEL_M * number for number in range(6)])
    taken = []
    for number, ground in enumerate(frames):
        pairs.measure(number * STEP_NS, ground, PRIOR)
        if number in {0, 1, 4, 5}:
            taken.append(pairs.take(ground))

    assert taken[0] is None
    moved_m = [motion.forward_m for motion in taken if motion is not None]
    assert np.allclose(moved_m, [WHEEL_M, 3 * WHEEL_M, WHEEL_M], atol=0.0005)


def test_a_motion_with_a_part_that_is_not_known_is_not_known(pairs: PairSum) -> None:
    frames = grounds(pairs, [0.0, WHEEL_M, 2 * WHEEL_M, math.nan, 4 * WHEEL_M, 5 * WHEEL_M])
    for number, ground in enumerate(frames):
        pairs.measure(number * STEP_NS, ground, PRIOR)
        if number == 1:
            assert pairs.take(ground) is None
    assert pairs.take(frames[-1]) is None


def test_the_motion_up_to_a_frame_that_was_not_measured_is_not_known(pairs: PairSum) -> None:
    frames = grounds(pairs, [WHEEL_M * number for number in range(4)])
    for number, ground in enumerate(frames[:2]):
        pairs.measure(number * STEP_NS, ground, PRIOR)
        pairs.take(ground)

    assert pairs.take(frames[2]) is None
    pairs.measure(3 * STEP_NS, frames[3], PRIOR)
    assert pairs.take(frames[3]) is None
