"""Ground that stands, and ground that moves behind what is fixed in the picture; no estimator takes part."""

import cv2
import numpy as np
import pytest

from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.standing_proof import StandingProof

PIXEL_M = 0.004
SHAPE = (120, 100)
STEP_M = 5 * PIXEL_M


def texture(seed: int, rows: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.asarray(cv2.GaussianBlur(rng.normal(0.0, 1.0, (rows, SHAPE[1])), (0, 0), 1.5), np.float32)


GROUND, FIXED = texture(1, 600), texture(2, SHAPE[0])


def frame(number: int, *, moves: bool, share: float, seed: int) -> np.ndarray:
    """Return a picture: what is fixed, this share of ground, and noise."""
    row = 400 - 5 * number * moves
    noise = np.random.default_rng(seed).normal(0.0, 0.1, SHAPE)
    return np.asarray(FIXED + share * GROUND[row : row + SHAPE[0]] + noise, np.float32)


def reasons(*, moves: bool, share: float = 0.3, seen_m: float = 0.3) -> list[str]:
    """Return what is said of twenty frames that seem to stand while the wheels roll."""
    proof = StandingProof(PIXEL_M, DEFAULTS.standing)
    proof.begin(frame(0, moves=moves, share=share, seed=0))
    wheel_m = np.array([STEP_M, 0.0])
    if seen_m:
        seen = np.array([seen_m, 0.0])
        assert not proof.why_not(frame(0, moves=moves, share=share, seed=0), seen, seen, is_fixed=False)
        proof.begin_pair()
    said = []
    for number in range(1, 20):
        picture = frame(number, moves=moves, share=share, seed=number)
        said.append(proof.why_not(picture, wheel_m, np.zeros(2), is_fixed=True))
        proof.begin_pair()
    return said


def test_ground_that_stands_is_proven_after_five_frames() -> None:
    said = reasons(moves=False)
    assert all("too few frames" in reason for reason in said[:3])
    assert said[4:] == [""] * len(said[4:])


@pytest.mark.parametrize("share", [1.0, 0.3, 0.2])
def test_ground_that_moves_behind_a_pattern_is_found(share: float) -> None:
    assert all("moves behind" in reason for reason in reasons(moves=True, share=share)[4:])


@pytest.mark.parametrize("moves", [False, True])
def test_before_the_ground_was_seen_to_move_nothing_is_proven(moves: bool) -> None:
    assert all("no motion confirmed" in reason for reason in reasons(moves=moves, seen_m=0.0))


def test_wheels_that_stand_need_no_proof() -> None:
    proof = StandingProof(PIXEL_M, DEFAULTS.standing)
    proof.begin(frame(0, moves=False, share=0.3, seed=0))
    for seed in range(1, 20):
        picture = frame(0, moves=False, share=0.3, seed=seed)
        assert not proof.why_not(picture, np.zeros(2), np.zeros(2), is_fixed=True)
        proof.begin_pair()
