"""Ground and wheels compared: what a rotation on the spot leaves of the camera's swing is no travel."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.ground_motion.estimator import NO_MOTION
from controllers.ground_motion.flow import GroundFlow
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.wheel_comparison import ComparedPair, WheelComparison
from tests.controllers.ftrace.rigs import geometry


@pytest.mark.parametrize(("turn_rad", "is_reported"), [(0.02, False), (0.0, True)])
def test_ground_against_the_wheels_contradicts_the_rig_only_in_travel(
    turn_rad: float, is_reported: bool
) -> None:
    ground = GroundPatch(replace(geometry(), wheel_width_m=0.0))
    flow = GroundFlow(ground, DEFAULTS.flow)
    wheels = WheelComparison(ground, flow, RigTolerance(), DEFAULTS, rotates_about_origin=True)
    pair = ComparedPair(
        motion=replace(NO_MOTION, forward_m=-0.0005, forward_sd_m=0.0001, left_sd_m=0.0001),
        pitch_rad=0.0,
        gyro_pitch_rad=0.0,
        wheel_m=np.array([0.0001, 0.0]),
        turn_rad=turn_rad,
        has_gyro=True,
        duration_s=0.1,
        period_m=0.0,
    )
    for _ in range(20):
        wheels.doubt(pair)
    assert ("against the wheels" in (wheels.fault.text if wheels.fault else "")) is is_reported
