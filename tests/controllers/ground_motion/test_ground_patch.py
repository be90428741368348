import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.ground_motion.ground_patch import RESOLUTION_M, GroundPatch, project
from drivers.errors import ConfigError
from sim_backends.rear_scene.rig import looking_back
from tests.controllers.ftrace.rigs import geometry

PLACES = st.floats(-0.5, 0.7)


STEERED = {steer_deg: GroundPatch(geometry(steer_deg=steer_deg)) for steer_deg in (-25.0, 0.0, 10.0)}


@given(back=PLACES, left=PLACES, steer_deg=st.sampled_from(sorted(STEERED)))
@settings(deadline=None)
def test_wheel_axes_and_back(back: float, left: float, steer_deg: float) -> None:
    ground = STEERED[steer_deg]

    there = ground.to_vehicle(np.array([back]), np.array([left]))

    assert np.allclose(ground.to_patch(there), [[back, left]])
    assert there[0, 2] == 0.0


def test_a_wheel_steered_left_looks_along_its_own_axis() -> None:
    rig = geometry(steer_deg=30.0)
    behind = GroundPatch(rig).to_vehicle(np.array([0.4]), np.array([0.0]))[0] - rig.contact_m

    assert math.degrees(math.atan2(-behind[1], -behind[0])) == pytest.approx(30.0)


@pytest.mark.parametrize(
    "distortion", [(0.0,) * 5, (-0.2, 0.03, 5e-4, -4e-4, 0.004), (0.05, 0.0, 0.0, 0.0, 0.0)]
)
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_a_point_on_the_ground_is_found_at_its_place(distortion: tuple[float, ...], scale: float) -> None:
    rig = geometry(distortion=distortion, scale=scale)
    ground = GroundPatch(rig)
    for back, left in ((0.2, 0.0), (0.35, -0.15), (0.5, 0.1)):
        image = np.full((rig.height, rig.width), 40, np.uint8)
        pixels, _ = project(rig, ground.to_vehicle(np.array([[back]]), np.array([[left]])).reshape(-1, 3))
        # An eighth of a pixel at a time, so that the dot's middle is where the point is.
        centre = (round(pixels[0, 0] * 8), round(pixels[0, 1] * 8))
        cv2.circle(image, centre, round(5 * scale * 8), 255, -1, cv2.LINE_AA, 3)
        seen = ground.rectify(image).astype(float) - 40 * (ground.visible > 0)
        seen[~ground.visible] = 0
        rows, columns = np.indices(seen.shape)
        found_back = (seen * rows).sum() / seen.sum() * RESOLUTION_M + RESOLUTION_M / 2
        found_left = ((seen * columns).sum() / seen.sum() - ground.centre) * RESOLUTION_M
        assert found_back == pytest.approx(back, abs=0.0015)
        assert found_left == pytest.approx(left, abs=0.0015)


def test_projection_agrees_with_a_pinhole_written_by_hand() -> None:
    rig = geometry(distortion=(0.0,) * 5)
    points = np.array([[-0.6, 0.2, 0.0], [-0.8, 0.0, 0.05]])

    pixels, ahead = project(rig, points)

    local = (rig.rotation.T @ (points - rig.position_m).T).T
    by_hand = (rig.camera_matrix @ (local / local[:, 2:]).T).T[:, :2]
    assert ahead.all()
    assert np.allclose(pixels, by_hand)


def test_points_behind_the_camera_are_not_ahead() -> None:
    assert not project(geometry(), np.array([[2.0, 0.0, 0.0]]))[1].any()


def test_a_large_wheel_hides_more_ground_than_a_small_one() -> None:
    large, small = (GroundPatch(replace(geometry(), wheel_radius_m=radius_m)) for radius_m in (0.15, 0.03))

    assert (small.visible & ~large.visible)[:, large.centre].sum() > 5
    assert not (large.visible & ~small.visible).any()


@pytest.mark.parametrize(
    "rotation",
    [np.eye(3) * 1.1, np.diag([1.0, 1.0, -1.0]), np.zeros((3, 3))],
    ids=["scaled", "mirrored", "zero"],
)
def test_a_matrix_that_is_no_rotation(rotation: np.ndarray) -> None:
    with pytest.raises(ConfigError, match="not a rotation"):
        GroundPatch(replace(geometry(), rotation=rotation))


def test_a_camera_that_looks_at_the_sky() -> None:
    with pytest.raises(ConfigError, match="R_vehicle_camera"):
        GroundPatch(replace(geometry(), rotation=looking_back(-40.0)))


def test_a_camera_under_the_ground() -> None:
    with pytest.raises(ConfigError, match="t_vehicle_camera"):
        GroundPatch(replace(geometry(), position_m=np.array([-0.4, 0.2, -0.5])))
