"""The camera on a simulated rover renders what the renderer of drives does, and the ground moves rightly."""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest

from drivers.clock import nanoseconds
from drivers.link import CameraImage
from sim_backends.world.line import NEVER_NS, Line, serial_bits
from sim_backends.world.plant import Truth
from sim_backends.world.world import EmulatedDevice, World
from tests.nature.ambiguous_ground.live_camera import DELAY_S, LiveScene, along_ground, mount, prepare_live
from tests.nature.ambiguous_ground.picture import Frame
from tests.nature.ambiguous_ground.recipe import FPS, Recipe, pictures

FRAMES = 10
CENTRE = 159.5, 119.5
HALF = 40
"""Half the side of the part of the picture in which the motion is measured, px."""
STILL = Truth(
    t_ns=0,
    x_m=0.3,
    y_m=-0.2,
    yaw_rad=0.4,
    roll_rad=0.0,
    pitch_rad=0.0,
    velocity_x_m_s=0.0,
    velocity_y_m_s=0.0,
    yaw_rate_rad_s=0.0,
    wheel_position_rad=(0.0,),
    wheel_speed_rad_s=(0.0,),
    motor_current_a=(0.0,),
    slip=(0.0,),
    battery_v=24.0,
    bumper_pressed=False,
)


class Parked:
    """A rover that stands."""

    wheel_count = 1
    t_ns = 0

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        pass

    def advance(self, t_ns: int) -> None:
        self.t_ns = t_ns

    def truth(self) -> Truth:
        return replace(STILL, t_ns=self.t_ns)


class Unused:
    """An emulator whose place another one takes."""

    next_event_ns = NEVER_NS

    def act(self, t_ns: int) -> None:
        raise AssertionError

    def receive(self, t_ns: int, payload: bytes) -> None:
        raise AssertionError


def live(case: str, draw: int = 3) -> Recipe:
    return prepare_live(case, draw, FRAMES, FPS, 0.012)


def after(truth: Truth, forward_m: float, left_m: float, turn_rad: float) -> Truth:
    """The state after a step in the rover's axes, whose middle heading it is along."""
    middle = truth.yaw_rad + 0.5 * turn_rad
    c, s = math.cos(middle), math.sin(middle)
    x_m, y_m = truth.x_m + c * forward_m - s * left_m, truth.y_m + s * forward_m + c * left_m
    return replace(truth, x_m=x_m, y_m=y_m, yaw_rad=truth.yaw_rad + turn_rad)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["clean", "motion_blur", "rain", "exposure", "mirrored", "tiles_long"])
def test_it_renders_what_the_renderer_of_drives_does(case: str) -> None:
    forward, left, turn = 0.012, 0.003, 0.01
    drive, scene = live(case), LiveScene(live(case))
    truth = replace(STILL, velocity_x_m_s=forward * FPS, velocity_y_m_s=left * FPS, yaw_rate_rad_s=turn * FPS)
    steps = [truth]
    while len(steps) < FRAMES:
        steps.append(after(steps[-1], forward, left, turn))
    for frame, each in enumerate(steps):
        drive.motion.x[frame], drive.motion.y[frame], drive.motion.psi[frame] = (
            each.x_m,
            each.y_m,
            each.yaw_rad,
        )
    for expected, each in zip(pictures(drive)[:-1], steps, strict=False):
        off = np.abs(scene.render(each).astype(float) - expected)
        assert off.max() <= 1.0  # of rounding
        assert off.mean() < 0.01


def shift(before: Frame, now: Frame) -> tuple[float, float]:
    """How far the middle of the picture has moved, right and down, px."""
    rows, columns = slice(120 - HALF, 120 + HALF), slice(160 - HALF, 160 + HALF)
    parts = [picture[rows, columns].astype(np.float32) for picture in (before, now)]
    window = cv2.createHanningWindow((2 * HALF, 2 * HALF), cv2.CV_32F)
    moved, _ = cv2.phaseCorrelate(parts[0], parts[1], window)
    return float(moved[0]), float(moved[1])


@pytest.mark.parametrize(
    ("step", "sign"),
    [
        (
            (0.008, 0.0, 0.0),
            (0, -1),
        ),  # ahead: the ground recedes, up in the picture of a camera that looks back
        ((0.0, 0.008, 0.0), (-1, 0)),  # to the left, which is to the right in the picture
        ((-0.006, -0.006, 0.0), (1, 1)),
        ((0.0, 0.0, 0.02), (1, 0)),  # left turn: the rear swings to the right
    ],
)
def test_the_ground_moves_against_the_rover(step: tuple[float, float, float], sign: tuple[int, int]) -> None:
    recipe = live("clean", 4)
    recipe.noise = 0.0
    scene, camera = LiveScene(recipe), recipe.camera
    moved = shift(scene.render(STILL), scene.render(after(STILL, *step)))
    u, v = (np.array([each]) for each in CENTRE)
    point = camera.on_plane(u, v)[0]
    forward, left, turn = step
    c, s = math.cos(0.5 * turn), math.sin(0.5 * turn)
    dx, dy = point[0] - (c * forward - s * left), point[1] - (s * forward + c * left)
    c, s = math.cos(turn), math.sin(turn)
    seen = camera.project(np.array([[c * dx + s * dy, -s * dx + c * dy, 0.0]]))[0]
    expected = seen - np.array(CENTRE)
    assert moved == pytest.approx(tuple(expected), abs=0.35)
    for along, way in zip(moved, sign, strict=True):
        assert way * along >= 0.0
        assert not way or abs(along) > 1.0


def test_a_standing_rover_sees_the_same_but_for_noise() -> None:
    scene = LiveScene(live("clean"))
    first, second = (scene.render(STILL).astype(float) for _ in range(2))
    assert (first - second).std() == pytest.approx(math.sqrt(2.0) * scene.recipe.noise, rel=0.1)
    moved = scene.render(after(STILL, 0.01, 0.0, 0.0)).astype(float)
    assert (moved - second).std() > 3.0 * scene.recipe.noise


def test_on_a_slope_it_moves_along_the_ground() -> None:
    pitch, length = math.radians(-12.0), 0.01
    uphill = replace(STILL, yaw_rad=0.0, pitch_rad=pitch)
    ahead = replace(uphill, x_m=uphill.x_m + length * math.cos(pitch))
    assert along_ground(uphill, ahead) == pytest.approx((length, 0.0, 0.0))
    turned = replace(uphill, yaw_rad=0.1)
    assert along_ground(uphill, turned)[2] == pytest.approx(0.1 * math.cos(pitch))


def test_ground_bends_as_the_rover_tilts_on_its_way() -> None:
    scene = LiveScene(prepare_live("clean", 1, 200, FPS, 0.02))
    for frame in range(120):
        way = 0.02 * frame
        scene.render(replace(STILL, yaw_rad=0.0, x_m=way, pitch_rad=0.04 * way, roll_rad=-0.02 * way))
    assert scene.recipe.view.curvature == pytest.approx(0.04, rel=0.02)
    assert scene.recipe.view.twist == pytest.approx(-0.02, rel=0.02)


def test_the_way_is_that_of_the_rover() -> None:
    scene, truth = LiveScene(live("clean")), STILL
    steps = [(0.01, 0.002, 0.05), (0.02, -0.01, -0.1), (0.0, 0.0, 0.3)]
    scene.render(truth)
    for step in steps:
        truth = after(truth, *step)
        scene.render(truth)
    np.testing.assert_allclose(scene.track()[-1, 1:], (truth.x_m, truth.y_m, truth.yaw_rad), atol=1e-12)


def test_frames_arrive_late_with_the_time_of_their_exposure() -> None:
    to_host: Line[CameraImage] = Line(lambda image: 1.0, 1e6)
    camera = EmulatedDevice("camera", Unused(), to_host, Line(serial_bits, 1e6))
    world = World(Parked(), {}, {"camera": camera})
    mount(world, "camera", LiveScene(live("clean")), nanoseconds(0.03))
    world.advance(nanoseconds(0.5))
    received = camera.to_host.take(nanoseconds(0.5))
    stamps = [each.payload.t_capture_ns for each in received]
    assert stamps == [nanoseconds(0.03 + k / FPS) for k in range(5)]
    assert [each.t_ns - nanoseconds(DELAY_S) for each in received] == stamps
