"""The effects of a rolling shutter, computed from the rig, are those that rendered frames show."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.motion import GroundMotion
from controllers.ground_motion.prior import MotionPrior
from controllers.ground_motion.rolling_shutter import FREE_SD_RAD, rolling_shutter
from rover_hil.config import load_config
from sim_backends.rear_scene.emulated_scene import EmulatedScene
from sim_backends.world.plant import Truth
from tests.sim_backends.test_camera import truth_at
from tests.sim_backends.test_ground_camera import ROBOTINO, changed

READOUT_S = 0.03
SPEED_M_S, RATE_RAD_S, STEP_M = 0.4, 0.6, 0.02
SETTINGS = load_config("robotino-camera").ground_motion
assert SETTINGS is not None
GROUND = GroundPatch(SETTINGS.rig.geometry())


def measured(before: Truth, after: Truth, readout_s: float) -> GroundMotion:
    """Return the motion between two frames."""
    estimator = GroundMotionEstimator(GroundView(GROUND))
    size = GROUND.rig.width, GROUND.rig.height
    seen = EmulatedScene(changed(ROBOTINO, readout_s=readout_s), *size, 10.0, np.random.default_rng(3), 0)
    motion = None
    for t_ns, truth in ((0, before), (100_000_000, after)):
        prior = MotionPrior(forward_m=STEP_M, left_m=0.0, turn_rad=(0.0, 0.0, 0.0), turn_sd_rad=FREE_SD_RAD)
        motion = estimator.step(t_ns, seen.render(replace(truth, t_ns=t_ns)), prior)
    assert motion is not None
    assert motion.is_valid
    return motion


def test_turns_are_seen_later_by_the_share_of_the_readout_that_the_rig_gives() -> None:
    """The rover turns at the second frame and not at the first: all of the shear is new. Which points
    are seen in both frames changes the share a little.
    """
    rests = truth_at(1.0)
    turns = replace(truth_at(1.0 + STEP_M), yaw_rate_rad_s=RATE_RAD_S)
    shear_rad = measured(rests, turns, READOUT_S).turn_rad - measured(rests, turns, 0.0).turn_rad
    expected = rolling_shutter(GROUND).turn_delay
    assert -shear_rad / (RATE_RAD_S * READOUT_S) == pytest.approx(expected, rel=0.25)
    assert expected > 0.4


def test_the_way_ahead_is_stretched_by_the_share_that_the_rig_gives() -> None:
    """At the same speed in both frames; the camera looks back, so ground is seen on an earlier line next."""
    before, after = (replace(truth_at(x_m), velocity_x_m_s=SPEED_M_S) for x_m in (1.0, 1.0 + STEP_M))
    rolling, whole = (measured(before, after, readout_s) for readout_s in (READOUT_S, 0.0))
    stretch = rolling.forward_m / whole.forward_m - 1
    expected = rolling_shutter(GROUND).stretch_per_m * SPEED_M_S * READOUT_S
    assert stretch == pytest.approx(expected, abs=0.006)
    assert expected < -0.015
