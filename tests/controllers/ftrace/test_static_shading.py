"""Shadows that are fixed in the image, separated from the moving ground."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.ftrace.parameters import DEFAULTS
from controllers.ftrace.static_shading import StaticShading
from controllers.ground_motion.flow import PatchMotion
from controllers.ground_motion.ground_patch import RESOLUTION_M, Patch

ROWS, COLUMNS, FRAMES, STEP = 140, 161, 90, 4
SHADOW = -0.5


def learned(
    shadow: Patch, *, aside: int = 0, band: float = 0.0, ahead: int = 1, held: int = 1, resting: int = 0
) -> Patch:
    """Return the light learned from ground that moves back and `aside` under a shadow fixed to the image.

    With `ahead` -1 the rover reverses. Each frame is followed by `held` - 1 like it, as from a camera that
    is that many times as fast and moves in between not at all; the last one by `resting`.
    """
    rng = np.random.default_rng(7)
    ground = rng.normal(0, 0.15, (ROWS + STEP * FRAMES, COLUMNS + abs(aside) * FRAMES)).astype(np.float32)
    first = max(-aside, 0) * FRAMES
    light = StaticShading(np.ones((ROWS, COLUMNS), np.float32), COLUMNS // 2, 0.75, DEFAULTS.shading)
    motion = PatchMotion(
        forward_m=ahead * STEP * RESOLUTION_M,
        left_m=aside * RESOLUTION_M,
        turn_rad=0.0,
        tilt_rad=(0.0, 0.0),
        forward_sd_m=0.0002,
        left_sd_m=0.0002,
        turn_sd_rad=0.001,
        points=100,
        share=1.0,
        moved_pixels=1.0,
        moved_sd_pixels=0.1,
    )
    for frame in range(FRAMES):
        top = STEP * (FRAMES - frame if ahead > 0 else frame)
        left = first + aside * frame
        seen = ground[top : top + ROWS, left : left + COLUMNS].copy()
        seen[:, 70:95] += band
        light.update(seen + shadow, motion if frame else None)
        for number in range(held - 1 + (resting if frame == FRAMES - 1 else 0)):
            light.update(seen + shadow + 0.1 * (number % 2), replace(motion, forward_m=0.0, left_m=0.0))
    return light.field


def wheel_shadow() -> Patch:
    shadow = np.zeros((ROWS, COLUMNS), np.float32)
    shadow[:50, 70:95] = SHADOW
    return shadow


@pytest.mark.parametrize("aside", [0, 1, -1])
def test_a_shadow_is_taken_out_and_the_lit_ground_beyond_it_is_left(aside: int) -> None:
    field = learned(wheel_shadow(), aside=aside)

    assert field[10:40, 75:90].mean() == pytest.approx(SHADOW, abs=0.12)
    assert np.abs(field[75:120, 75:90]).mean() < 0.06
    assert np.abs(field[:, :50]).mean() < 0.03


@pytest.mark.parametrize("aside", [2, -2])
def test_lit_ground_is_looked_for_along_the_way_not_along_the_columns(aside: int) -> None:
    """Nearly all of each column is dark, but not of the lines that the ground moves along."""
    shadow = np.zeros((ROWS, COLUMNS), np.float32)
    shadow[:120, 65:95] = SHADOW

    field = learned(shadow, aside=aside)

    assert np.sqrt(np.mean((field - shadow) ** 2)) < 0.08


@pytest.mark.parametrize("aside", [0, 1])
def test_going_back_light_is_learned_as_well(aside: int) -> None:
    field = learned(wheel_shadow(), aside=aside, ahead=-1)

    assert field[10:40, 75:90].mean() == pytest.approx(SHADOW, abs=0.12)
    assert np.abs(field[:, :50]).mean() < 0.03


def test_a_trace_is_ground_not_light() -> None:
    field = learned(np.zeros((ROWS, COLUMNS), np.float32), band=-0.4)

    assert np.abs(field[:, 75:90]).mean() < 0.06


def test_frames_at_rest_teach_nothing() -> None:
    moving = learned(wheel_shadow())

    assert np.array_equal(learned(wheel_shadow(), resting=30), moving)
    assert np.array_equal(learned(wheel_shadow(), held=20), moving)


def test_nothing_is_learned_where_the_motion_is_not_known() -> None:
    light = StaticShading(np.ones((ROWS, COLUMNS), np.float32), COLUMNS // 2, 0.75, DEFAULTS.shading)
    for _ in range(20):
        light.update(wheel_shadow(), None)

    assert not light.field.any()
