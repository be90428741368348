"""Points that never move with the ground are those of the rover."""

import numpy as np

from controllers.ground_motion.flow import Tracks
from controllers.ground_motion.moving_parts import MovingParts
from controllers.ground_motion.parameters import DEFAULTS

COUNT = 20


def tracks(follows: np.ndarray, tracked: np.ndarray | None = None) -> Tracks:
    places = np.zeros((COUNT, 2))
    return Tracks(places, places, np.ones(COUNT, bool) if tracked is None else tracked, follows)


def learned(follows: np.ndarray, pairs: int, moved_pixels: float = 5.0) -> MovingParts:
    parts = MovingParts(COUNT, DEFAULTS.moving_parts)
    for _ in range(pairs):
        parts.update(tracks(follows), moved_pixels)
    return parts


def test_points_that_never_follow_are_left_out_after_some_motion() -> None:
    follows = np.arange(COUNT) >= 5
    assert not learned(follows, 5).mask.any()
    assert learned(follows, 20).mask.tolist() == (~follows).tolist()


def test_ground_that_hardly_moves_teaches_nothing() -> None:
    assert not learned(np.arange(COUNT) >= 5, 200, moved_pixels=0.5).mask.any()


def test_most_of_the_view_is_the_ground() -> None:
    assert not learned(np.arange(COUNT) >= 11, 40).mask.any()


def test_a_point_that_follows_again_counts_again() -> None:
    parts = learned(np.arange(COUNT) >= 5, 20)
    for _ in range(3):
        parts.update(tracks(np.ones(COUNT, bool)), 5.0)
    assert not parts.mask.any()


def test_points_that_cannot_be_followed_are_not_judged() -> None:
    parts = MovingParts(COUNT, DEFAULTS.moving_parts)
    tracked = np.arange(COUNT) >= 5
    for _ in range(40):
        parts.update(tracks(tracked, tracked), 5.0)
    assert not parts.mask.any()
