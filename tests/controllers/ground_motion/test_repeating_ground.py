"""Ground whose pattern repeats, on pictures that are drawn here."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.ground_motion.estimator import NO_MOTION
from controllers.ground_motion.flow import GroundFlow
from controllers.ground_motion.ground_patch import GroundPatch, Patch
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.repeating_ground import REPEATS, RepeatingGround
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.wheel_comparison import ComparedPair, WheelComparison
from tests.controllers.ftrace.rigs import geometry

PERIOD_PIXELS = 6
AHEAD, ASIDE = np.array([0.02, 0.0]), np.array([0.0, 0.02])


@pytest.fixture(scope="module")
def ground() -> GroundPatch:
    return GroundPatch(geometry())


def taken(ground: GroundPatch, pattern: Patch) -> RepeatingGround:
    repeating = RepeatingGround(ground, DEFAULTS.repeating)
    repeating.take(np.asarray(pattern * ground.visible, np.float32))
    return repeating


def ribs(ground: GroundPatch, noise: float) -> Patch:
    rows, columns = ground.shape
    line = np.cos(2.0 * np.pi * np.arange(rows) / PERIOD_PIXELS)
    grain = np.random.default_rng(7).normal(0.0, noise, (rows, columns))
    return np.asarray(np.repeat(line[:, None], columns, axis=1) + grain, np.float32)


def test_ribs_across_the_motion_repeat(ground: GroundPatch) -> None:
    repeating = taken(ground, ribs(ground, 0.5))
    assert repeating.period_m(AHEAD) == pytest.approx(PERIOD_PIXELS * ground.pixel_m)
    assert repeating.period_m(None) == repeating.period_m(AHEAD)
    assert repeating.period_m(ASIDE) == 0.0


@pytest.mark.parametrize("is_aside", [False, True])
def test_the_motion_that_a_pattern_leaves_open_is_stated(ground: GroundPatch, is_aside: bool) -> None:
    rows, columns = ground.shape
    line = np.cos(2.0 * np.pi * np.arange(columns if is_aside else rows) / PERIOD_PIXELS)
    pattern = np.broadcast_to(line if is_aside else line[:, None], ground.shape)
    period_mm = 1e3 * PERIOD_PIXELS * ground.pixel_m
    assert f"pattern repeats every {period_mm:.0f} mm" in taken(ground, np.asarray(pattern)).limit
    assert taken(ground, ribs(ground, 5.0)).limit == ""


def test_random_ground_and_an_empty_picture_do_not_repeat(ground: GroundPatch) -> None:
    for pattern in (ribs(ground, 5.0), np.zeros(ground.shape, np.float32)):
        assert taken(ground, pattern).period_m(AHEAD) == 0.0


def test_furrows_along_the_motion_do_not_repeat_along_it(ground: GroundPatch) -> None:
    line = np.random.default_rng(3).normal(size=ground.shape[1])
    assert taken(ground, np.repeat(line[None], ground.shape[0], axis=0)).period_m(AHEAD) == 0.0


def test_a_frame_is_examined_where_that_is_needed(ground: GroundPatch) -> None:
    repeating = taken(ground, np.zeros(ground.shape, np.float32))
    pattern = np.asarray(ribs(ground, 0.5) * ground.visible, np.float32)
    repeating.take(pattern)
    assert repeating.period_m(AHEAD) == 0.0
    repeating.take(pattern, is_needed=True)
    assert repeating.period_m(AHEAD) > 0.0


@pytest.mark.parametrize(
    ("period_m", "wheel_m", "is_decided"),
    [(0.0, 0.01, False), (0.012, 0.01, False), (0.015, 0.01, True), (0.015, 0.03, False)],
    ids=["no period", "also back", "one motion only", "also with less slip"],
)
def test_a_pattern_is_ambiguous_where_another_motion_is_possible(
    ground: GroundPatch, period_m: float, wheel_m: float, is_decided: bool
) -> None:
    flow = GroundFlow(ground, DEFAULTS.flow)
    wheels = WheelComparison(ground, flow, RigTolerance(), DEFAULTS, rotates_about_origin=True)
    pair = ComparedPair(
        motion=replace(NO_MOTION, forward_m=0.01, ambiguity=1.0),
        pitch_rad=0.0,
        gyro_pitch_rad=0.0,
        wheel_m=np.array([wheel_m, 0.0]),
        turn_rad=0.0,
        has_gyro=False,
        duration_s=0.1,
        period_m=period_m,
    )
    assert wheels.doubt(pair) == ("" if is_decided else REPEATS)
