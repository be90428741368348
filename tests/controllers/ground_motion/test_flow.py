import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from controllers.ground_motion.flow import Followed, GroundFlow
from controllers.ground_motion.ground_patch import RESOLUTION_M, GroundPatch
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.structure import FineStructure
from drivers.samples import Image
from tests.controllers.ftrace.rigs import geometry

FREE = (0.006, 0.006, 0.02)
"""Deviations of angles without a gyro."""


def texture(shape: tuple[int, int]) -> Image:
    noise = np.random.default_rng(1).standard_normal(shape)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.asarray(np.clip(128 + 60 * smooth / smooth.std(), 0, 255), np.uint8)


def moved(ground: GroundPatch, forward_m: float, left_m: float, turn_rad: float) -> tuple[Image, Image]:
    """Return the ground before and after the contact moved: turned first, then gone on."""
    rows, columns = ground.shape
    wide = texture((rows + 200, columns + 200))
    y, x = np.indices(ground.shape).astype(np.float64)
    behind, left = (y + 0.5) * RESOLUTION_M, (x - ground.centre) * RESOLUTION_M
    # Where a pixel of the later patch was in the earlier: turned back by the turn, then shifted.
    ahead, aside = forward_m - behind, left_m + left
    then_ahead = math.cos(turn_rad) * ahead - math.sin(turn_rad) * aside
    then_left = math.sin(turn_rad) * ahead + math.cos(turn_rad) * aside
    rows_then = -then_ahead / RESOLUTION_M - 0.5 + 100
    columns_then = then_left / RESOLUTION_M + ground.centre + 100
    after = cv2.remap(wide, columns_then.astype(np.float32), rows_then.astype(np.float32), cv2.INTER_LINEAR)
    before = wide[100 : 100 + rows, 100 : 100 + columns]
    return before, np.asarray(after, np.uint8)


def follow(ground: GroundPatch, before: Image, after: Image, turn_rad: float = 0.0) -> Followed:
    starts_m = np.array([[0.016, 0.0], [0.008, 0.0], [0.0, 0.0]])
    flow = GroundFlow(ground, DEFAULTS.flow)
    return flow.follow(before, after, starts_m, (0.0, 0.0, turn_rad), FREE, 0.024)


@pytest.mark.parametrize(
    ("forward_m", "left_m", "turn_deg"),
    [(0.016, 0.0, 0.0), (0.014, 0.003, 0.0), (0.016, -0.002, 0.5), (0.012, 0.001, -0.8)],
)
def test_motion_of_the_contact(forward_m: float, left_m: float, turn_deg: float) -> None:
    ground = GroundPatch(geometry())
    before, after = moved(ground, forward_m, left_m, math.radians(turn_deg))

    motion = follow(ground, before, after, math.radians(turn_deg)).moving

    assert motion is not None
    assert motion.forward_m == pytest.approx(forward_m, abs=4e-4)
    assert motion.left_m == pytest.approx(left_m, abs=4e-4)
    assert math.degrees(motion.turn_rad) == pytest.approx(turn_deg, abs=0.1)
    assert motion.share > 0.8


def test_ground_that_stands_in_the_picture_is_told_apart() -> None:
    ground = GroundPatch(geometry())
    picture = texture(ground.shape)

    found = follow(ground, picture, picture)

    assert found.moving is None or found.moving.moved_pixels < 0.5
    assert found.fixed is not None
    assert found.fixed.forward_m == pytest.approx(0.0, abs=1e-4)
    assert found.fixed.share > 0.9


def test_other_ground_is_not_followed() -> None:
    ground = GroundPatch(geometry())
    before = texture(ground.shape)
    after = np.asarray(before[::-1, ::-1].copy(), np.uint8)

    found = follow(ground, before, after)

    assert found.moving is None or found.moving.points < 18
    assert found.fixed is None or found.fixed.points < 18


def test_shadows_that_pass_over_the_ground_do_not_change_the_motion() -> None:
    """Half of the ground is under a hard shadow, which moves against the ground."""
    ground = GroundPatch(geometry())
    structure = FineStructure(ground, DEFAULTS.structure)
    pictures = []
    for picture, first in zip(moved(ground, 0.014, 0.003, 0.0), (20, 12), strict=True):
        light = np.ones(ground.shape, np.float32)
        light[:, first : first + ground.shape[1] // 2] = 0.35
        log_grey = np.log(light * (picture / 4 + 100) + 12).astype(np.float32)
        pictures.append(structure.picture(structure.of(log_grey)))

    motion = follow(ground, pictures[0], pictures[1]).moving

    assert motion is not None
    assert motion.forward_m == pytest.approx(0.014, abs=4e-4)
    assert motion.left_m == pytest.approx(0.003, abs=4e-4)


def test_points_of_a_small_view_are_closer_together() -> None:
    wide, small = (
        GroundFlow(GroundPatch(replace(geometry(), behind_m=behind_m, lateral_m=half_m)), DEFAULTS.flow)
        for behind_m, half_m in ((0.8, 0.4), (0.36, 0.14))
    )
    assert len(wide.points_m()) > DEFAULTS.flow.view_points
    assert len(small.points_m()) > 2 * DEFAULTS.validity.least_moving
