"""Rigs without a wheel, and what errors of a rig do."""

import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from controllers.ftrace.estimator import TraceEstimator
from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.flow import GroundFlow
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.prior import MotionPrior, turned
from controllers.ground_motion.rig import RigFile
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.tolerance import effects_of, pitched, scale_of, travel_factor
from drivers.errors import ConfigError
from drivers.samples import Image
from tests.controllers.ftrace.rigs import geometry
from tests.sim_backends.rear_drives import rig

AHEAD = ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))
"""A level camera that looks ahead."""


def file_of(height_m: float, down_deg: float, *, ahead: bool) -> RigFile:
    """Return the rig of a camera without a wheel, that looks ahead or back, and down."""
    table = json.loads(json.dumps(rig((0.0,) * 5).as_json()))
    rotation = pitched(math.radians(down_deg)) @ np.array(AHEAD)
    if not ahead:
        rotation = np.diag([-1.0, -1.0, 1.0]) @ rotation
    table |= {
        "wheel": None,
        "ground_view_m": None,
        "other_wheels": [],
        "R_vehicle_camera": rotation.tolist(),
        "t_vehicle_camera": [0.0, 0.0, height_m],
    }
    return RigFile.model_validate_json(json.dumps(table))


def view(ground: GroundPatch, forward_m: float) -> Image:
    """Return what the camera sees of textured ground after a travel: each pixel's ray meets the plane."""
    noise = np.random.default_rng(5).standard_normal((900, 900))
    texture = cv2.GaussianBlur(noise, (0, 0), 1.5)
    texture = np.clip(128 + 40 * texture / texture.std(), 0, 255).astype(np.float32)
    camera = ground.rig
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)])
    rays = camera.rotation @ np.linalg.solve(camera.camera_matrix, pixels)
    away = camera.position_m[2] / np.maximum(-rays[2], 1e-6)
    x, y = (camera.position_m[:, None] + rays * away)[:2] + np.array([[forward_m], [0.0]])
    shown = [
        ((place / ground.pixel_m + 450) % 898).reshape(columns.shape).astype(np.float32) for place in (x, y)
    ]
    return np.asarray(cv2.remap(texture, shown[0], shown[1], cv2.INTER_LINEAR), np.uint8)


@pytest.mark.parametrize(
    ("height_m", "down_deg", "ahead"), [(0.25, 50.0, False), (0.8, 60.0, False), (1.6, 15.0, True)]
)
def test_camera_without_a_wheel_measures(height_m: float, down_deg: float, *, ahead: bool) -> None:
    """Travel is that of the vehicle's origin; it scales with the height."""
    ground = GroundPatch(file_of(height_m, down_deg, ahead=ahead).geometry())
    estimator = GroundMotionEstimator(GroundView(ground))
    turn, turn_sd = turned(None, None, 0.1, DEFAULTS.turn)
    step_m = 0.03 * height_m
    total_m, valid = 0.0, 0
    for frame in range(8):
        prior = MotionPrior(forward_m=step_m, left_m=0.0, turn_rad=turn, turn_sd_rad=turn_sd)
        motion = estimator.step(frame * 10**8, view(ground, frame * step_m), prior)
        if motion is not None:
            assert motion.point_m == (0.0, 0.0)
            total_m, valid = total_m + motion.forward_m, valid + motion.is_valid

    assert valid == 7
    assert total_m == pytest.approx(7 * step_m, rel=0.02)


def test_wheel_and_view_belong_together() -> None:
    table = json.loads(json.dumps(rig((0.0,) * 5).as_json())) | {"wheel": None}

    with pytest.raises(ValidationError, match="give both, or null for both"):
        RigFile.model_validate_json(json.dumps(table))


def test_rig_that_sees_no_ground_is_refused() -> None:
    with pytest.raises(ConfigError, match="sees no ground"):
        GroundPatch(file_of(0.8, -40.0, ahead=True).geometry())


def test_trace_needs_a_wheel() -> None:
    with pytest.raises(ConfigError, match="watches no wheel"):
        TraceEstimator(file_of(0.8, 60.0, ahead=False).geometry())


def test_one_per_cent_of_height_is_one_per_cent_of_travel() -> None:
    rear = geometry()
    ground = GroundPatch(rear)
    flow = GroundFlow(ground, DEFAULTS.flow)
    higher = replace(rear, position_m=rear.position_m * (1.0, 1.0, 1.01))

    assert travel_factor(rear, ground, flow) == pytest.approx(1.0, abs=1e-4)
    assert travel_factor(higher, ground, flow) == pytest.approx(1 / 1.01, abs=5e-4)


def test_deviation_of_the_scale_is_the_root_of_the_sum_of_squares() -> None:
    ground = GroundPatch(geometry())
    flow = GroundFlow(ground, DEFAULTS.flow)
    height_m = float(ground.rig.position_m[2])
    none = {"height_sd_m": 0.0, "pitch_sd_deg": 0.0, "focal_length_sd": 0.0, "sinkage_sd_m": 0.0}
    parts = [
        scale_of(ground, flow, RigTolerance.model_validate(none | {name: value}))[1]
        for name, value in {
            "height_sd_m": 0.005, "pitch_sd_deg": 0.2, "focal_length_sd": 0.005, "sinkage_sd_m": 0.01
        }.items()
    ]  # fmt: skip

    assert parts[0] == pytest.approx(0.005 / height_m, rel=1e-3)
    assert scale_of(ground, flow, RigTolerance())[1] == pytest.approx(math.hypot(*parts), rel=1e-3)
    assert scale_of(ground, flow, RigTolerance())[1] * height_m / 0.8 == pytest.approx(0.015, abs=0.002)
    assert scale_of(ground, flow, RigTolerance(sinkage_m=0.01))[0] == pytest.approx(1 - 0.01 / height_m)


def test_ground_that_falls_away_behind_looks_like_a_change_of_pitch() -> None:
    """A point at the height z seems to move by 1 + z / height of the camera, over its motion."""
    ground = GroundPatch(geometry())
    flow = GroundFlow(ground, DEFAULTS.flow)
    points_m = ground.to_vehicle(*flow.points_m().T)
    away, height_m = (points_m - ground.rig.position_m)[:, :2], float(ground.rig.position_m[2])
    x_m, y_m = points_m[:, 0], points_m[:, 1]
    zero, one = np.zeros_like(x_m), np.ones_like(x_m)
    ahead = np.stack([-one, zero, y_m, -away[:, 0] * y_m / height_m, away[:, 0] * x_m / height_m], axis=1)
    left = np.stack([zero, -one, -x_m, -away[:, 1] * y_m / height_m, away[:, 1] * x_m / height_m], axis=1)
    seen = np.concatenate([0.5 * x_m**2 / height_m, zero])
    expected = np.linalg.lstsq(np.concatenate([ahead, left]), seen, rcond=None)[0][4]

    assert expected > 0.1
    assert effects_of(ground, flow, RigTolerance()).pitch_per_bend == pytest.approx(expected, rel=0.15)
