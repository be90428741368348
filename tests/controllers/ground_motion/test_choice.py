"""Which motion is that of the ground, where points of it seem to stand and to move at once."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.ground_motion.choice import choose
from controllers.ground_motion.flow import Followed, PatchMotion, Tracks
from controllers.ground_motion.parameters import ValidityParameters

NUMBERS = ValidityParameters()
POINTS = 100


def motion(moved_pixels: float, follows: range) -> PatchMotion:
    mask = np.zeros(POINTS, np.bool_)
    mask[list(follows)] = True
    places = np.zeros((POINTS, 2))
    return PatchMotion(
        forward_m=0.002 * moved_pixels,
        left_m=0.0,
        turn_rad=0.0,
        tilt_rad=(0.0, 0.0),
        forward_sd_m=1e-4,
        left_sd_m=1e-4,
        turn_sd_rad=1e-3,
        points=len(follows),
        share=len(follows) / POINTS,
        moved_pixels=moved_pixels,
        moved_sd_pixels=0.01,
        tracks=Tracks(places, places, np.ones(POINTS, np.bool_), mask),
    )


STANDS = motion(0.1, range(90))


def test_few_points_of_ground_that_stands_which_fit_a_period_of_its_pattern_too_are_no_motion() -> None:
    found, reason = choose(Followed(moving=motion(6.0, range(20)), fixed=STANDS), 0.0, NUMBERS)
    assert (found, reason) == (STANDS, "")


def test_few_points_of_ground_behind_many_specks_are_its_motion() -> None:
    moving = motion(6.0, range(80, 100))
    found, _ = choose(Followed(moving=moving, fixed=STANDS), 0.0, NUMBERS)
    assert found is moving


def test_ground_that_fits_rest_and_a_motion_alike_is_ambiguous() -> None:
    found, _ = choose(Followed(moving=motion(6.0, range(70)), fixed=STANDS), 0.0, NUMBERS)
    assert found is not None
    assert (found.moved_pixels, found.ambiguity) == (6.0, 1.0)


@pytest.mark.parametrize("lacking", ["moving", "fixed"])
def test_motions_without_tracks_share_no_points(lacking: str) -> None:
    pair = {"moving": motion(6.0, range(20)), "fixed": STANDS}
    pair[lacking] = replace(pair[lacking], tracks=None)
    found, _ = choose(Followed(**pair), 0.0, NUMBERS)
    assert found is pair["moving"]
