"""The simulated camera: geometry, motion, trace and timing of what it sees."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.camera.settings import CameraSettings
from drivers.clock import VirtualClock, nanoseconds
from drivers.errors import ConfigError
from drivers.link import CameraImage
from drivers.samples import FrameSample, Image
from sim_backends.camera import CameraEmulatorSettings, make_camera
from sim_backends.ground_scene import GroundScene, Matrix, ground_to_image
from sim_backends.ground_texture import sand_texture
from sim_backends.live_folder import LiveFolderWriter
from sim_backends.loopback import LoopbackLink
from sim_backends.plant import Truth
from sim_backends.world import EmulatedDevice, World

WIDTH, HEIGHT = 640, 480
METRES_PER_PIXEL = 0.0015
FIRST_X_M, FIRST_Y_M = -0.75, 0.03
SIDE = 256
THIN_TRACE = CameraEmulatorSettings(type="camera", trace_width_m=0.001, noise_grey=0)
WIDE_TRACE = CameraEmulatorSettings(type="camera", trace_width_m=0.1, noise_grey=0)
DEVICE = CameraSettings(
    type="camera", source="v4l2", path="/dev/video0", width=WIDTH, height=HEIGHT, frame_rate_hz=5
)
LIVE_CAMERA = CameraSettings(
    type="camera", source="live_folder", path="set by the test", width=64, height=48, frame_rate_hz=30
)


def truth_at(x_m: float = 0.0, y_m: float = 0.0, yaw_rad: float = 0.0) -> Truth:
    return Truth(
        t_ns=0,
        x_m=x_m,
        y_m=y_m,
        yaw_rad=yaw_rad,
        roll_rad=0.0,
        pitch_rad=0.0,
        velocity_x_m_s=0.0,
        velocity_y_m_s=0.0,
        yaw_rate_rad_s=0.0,
        wheel_position_rad=(),
        wheel_speed_rad_s=(),
        motor_current_a=(),
        slip=(),
        battery_v=12.0,
        bumper_pressed=False,
    )


@dataclass
class StraightPlant:
    """A rover that drives straight at a constant velocity in the world frame."""

    velocity_x_m_s: float = 0.08
    velocity_y_m_s: float = 0.0
    yaw_rad: float = 0.0
    wheel_count: int = 4
    t_ns: int = 0

    def set_wheel_speeds(self, speed_rad_s: object) -> None:
        raise AssertionError("a camera turns no wheels")

    def advance(self, t_ns: int) -> None:
        self.t_ns = max(self.t_ns, t_ns)

    def truth(self) -> Truth:
        t_s = self.t_ns / 1e9
        truth = truth_at(self.velocity_x_m_s * t_s, self.velocity_y_m_s * t_s, self.yaw_rad)
        return replace(truth, t_ns=self.t_ns)


def scene(emulator: CameraEmulatorSettings = THIN_TRACE, seed: int = 3) -> GroundScene:
    return GroundScene(emulator, WIDTH, HEIGHT, np.random.default_rng(seed))


def project(homography: Matrix, x_m: float, y_m: float) -> tuple[float, float]:
    u, v, depth = homography @ (x_m, y_m, 1.0)
    assert depth > 0
    return float(u / depth), float(v / depth)


def rectify(image: Image) -> Image:
    """Return the picture seen from straight above: a column per x, a row per y."""
    pixel_to_ground = np.array(
        [[METRES_PER_PIXEL, 0, FIRST_X_M], [0, METRES_PER_PIXEL, FIRST_Y_M], [0, 0, 1]]
    )
    to_image = ground_to_image(THIN_TRACE, WIDTH, HEIGHT) @ pixel_to_ground
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    side = (SIDE, SIDE)
    return np.asarray(cv2.warpPerspective(grey, to_image, side, flags=cv2.WARP_INVERSE_MAP), np.uint8)


def test_the_optical_axis_meets_the_ground_behind_the_wheel_in_the_middle_of_the_picture() -> None:
    emulator = CameraEmulatorSettings(type="camera", wheel_x_m=-0.3, wheel_y_m=0.2, height_m=0.5, tilt_deg=60)
    u, v = project(ground_to_image(emulator, WIDTH, HEIGHT), -0.3 - 0.5 / math.tan(math.radians(60)), 0.2)
    assert (u, v) == pytest.approx((319.5, 239.5))


def test_left_of_the_rover_is_right_in_the_picture_at_the_scale_of_a_pinhole() -> None:
    homography = ground_to_image(WIDE_TRACE, WIDTH, HEIGHT)
    x_m = WIDE_TRACE.wheel_x_m - 0.5 / math.tan(math.radians(60))
    u, _ = project(homography, x_m, WIDE_TRACE.wheel_y_m + 0.01)
    focal_px = 320 / math.tan(math.radians(30))
    depth_m = 0.5 / math.sin(math.radians(60))
    assert u - 319.5 == pytest.approx(focal_px * 0.01 / depth_m)


def test_farther_behind_is_higher_in_the_picture() -> None:
    homography = ground_to_image(WIDE_TRACE, WIDTH, HEIGHT)
    rows = [project(homography, x_m, WIDE_TRACE.wheel_y_m)[1] for x_m in (-0.4, -0.5, -0.6, -0.9)]
    assert rows == sorted(rows, reverse=True)


def test_a_camera_with_the_horizon_in_view_is_refused() -> None:
    with pytest.raises(ConfigError, match="raise its tilt_deg"):
        scene(CameraEmulatorSettings(type="camera", tilt_deg=20))


@pytest.mark.parametrize(
    ("yaw_rad", "start_m", "moved_m"),
    [
        (0.0, (0.0, 0.0), (0.016, 0.0)),
        (0.0, (0.0, 0.0), (0.0, 0.012)),
        (2.0, (1.53, -0.01), (0.016, 0.0)),
        (2.0, (1.53, -0.01), (-0.009, 0.021)),
        (-40.0, (-812.3, 77.7), (-0.009, 0.021)),
    ],
)
def test_the_ground_moves_under_the_camera_as_the_rover_does(
    yaw_rad: float, start_m: tuple[float, float], moved_m: tuple[float, float]
) -> None:
    ground = scene()
    forward_m, left_m = moved_m
    before = ground.render(truth_at(*start_m, yaw_rad))
    x_m = start_m[0] + forward_m * math.cos(yaw_rad) - left_m * math.sin(yaw_rad)
    y_m = start_m[1] + forward_m * math.sin(yaw_rad) + left_m * math.cos(yaw_rad)
    after = ground.render(truth_at(x_m, y_m, yaw_rad))
    window = cv2.createHanningWindow((SIDE, SIDE), cv2.CV_64F)
    (shift_x, shift_y), response = cv2.phaseCorrelate(
        rectify(before).astype(np.float64), rectify(after).astype(np.float64), window
    )
    assert response > 0.3
    assert (-shift_x * METRES_PER_PIXEL, -shift_y * METRES_PER_PIXEL) == pytest.approx(moved_m, abs=3e-4)


def test_the_ground_turns_under_the_camera_as_the_rover_does() -> None:
    ground = scene()
    before = ground.render(truth_at(5.0, 6.0, 0.3))
    after = ground.render(truth_at(5.03, 6.01, 0.5))

    def world_to_image(x_m: float, y_m: float, yaw_rad: float) -> Matrix:
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        world_to_body = np.array([[c, s, -c * x_m - s * y_m], [-s, c, s * x_m - c * y_m], [0, 0, 1]])
        return np.asarray(ground_to_image(THIN_TRACE, WIDTH, HEIGHT) @ world_to_body)

    expected = world_to_image(5.03, 6.01, 0.5) @ np.linalg.inv(world_to_image(5.0, 6.0, 0.3))
    predicted = cv2.warpPerspective(before, expected, (WIDTH, HEIGHT))
    overlap = cv2.warpPerspective(np.ones((HEIGHT, WIDTH), np.uint8), expected, (WIDTH, HEIGHT)) > 0
    assert overlap.mean() > 0.5
    assert np.corrcoef(predicted[overlap].ravel(), after[overlap].ravel())[0, 1] > 0.9
    assert np.corrcoef(before[overlap].ravel(), after[overlap].ravel())[0, 1] < 0.3


@pytest.mark.parametrize("sideslip_rad", [0.0, 0.15, -0.3])
def test_the_trace_leaves_the_wheel_against_the_direction_of_travel(sideslip_rad: float) -> None:
    yaw_rad = 0.7
    travelled, fresh = scene(WIDE_TRACE), scene(WIDE_TRACE)
    for step in range(100):
        distance_m = 0.01 * step
        course_rad = yaw_rad + sideslip_rad
        pose = truth_at(distance_m * math.cos(course_rad), distance_m * math.sin(course_rad), yaw_rad)
        picture = travelled.render(pose)
    darker = rectify(fresh.render(pose)).astype(int) - rectify(picture) > 25
    columns = np.flatnonzero(darker.sum(axis=0) > 20)
    rows = np.array([np.flatnonzero(darker[:, column]).mean() for column in columns])
    slope, _ = np.polyfit(columns, rows, 1)
    assert math.atan(slope) == pytest.approx(sideslip_rad, abs=0.01)
    behind_m = WIDE_TRACE.wheel_x_m - (FIRST_X_M + METRES_PER_PIXEL * columns)
    left_m = FIRST_Y_M + METRES_PER_PIXEL * rows
    assert left_m == pytest.approx(WIDE_TRACE.wheel_y_m - behind_m * math.tan(sideslip_rad), abs=0.004)
    widths_m = METRES_PER_PIXEL * darker.sum(axis=0)[columns]
    assert np.median(widths_m) == pytest.approx(WIDE_TRACE.trace_width_m, abs=0.004)


def test_a_rover_that_spins_or_reverses_over_its_trace_is_rendered() -> None:
    ground = scene(WIDE_TRACE)
    for step in range(200):
        image = ground.render(truth_at(-0.02 * step, 0.0, 0.1 * step))
    assert image.shape == (HEIGHT, WIDTH, 3)


def test_a_trace_ahead_of_the_camera_is_not_seen() -> None:
    reversing, fresh = scene(WIDE_TRACE), scene(WIDE_TRACE)
    for step in range(150):
        pose = truth_at(-0.02 * step)
        picture = reversing.render(pose)
    assert np.array_equal(picture, fresh.render(pose))


def test_noise_has_the_configured_size_and_differs_from_frame_to_frame() -> None:
    noisy = scene(CameraEmulatorSettings(type="camera", noise_grey=4))
    first, second = (noisy.render(truth_at())[..., 0].astype(int) for _ in range(2))
    assert (first - second).std() == pytest.approx(4 * math.sqrt(2), rel=0.1)


def test_sand_continues_over_its_edges() -> None:
    sand = sand_texture(256, np.random.default_rng(1)).astype(int)
    inside = np.abs(np.diff(sand, axis=0)).mean()
    assert np.abs(sand[0] - sand[-1]).mean() == pytest.approx(inside, rel=0.15)
    assert sand.mean() == pytest.approx(140, abs=2)
    assert sand.std() == pytest.approx(22, abs=2)


def run(seed: int, until_s: float) -> tuple[EmulatedDevice[CameraImage], list[tuple[int, CameraImage]]]:
    plant = StraightPlant()
    device = make_camera("camera", DEVICE, WIDE_TRACE, plant, np.random.default_rng(seed), 10**9)
    World(plant, {}, {"camera": device}).advance(10**9 + nanoseconds(until_s))
    arrived = device.to_host.take(10**9 + nanoseconds(until_s))
    return device, [(received.t_ns, received.payload) for received in arrived]


def test_frames_are_stamped_at_the_start_of_exposure_and_arrive_after_exposure_and_transfer() -> None:
    _, arrived = run(seed=1, until_s=2.0)
    stamps = [payload.t_capture_ns for _, payload in arrived]
    assert None not in stamps
    captures = np.array(stamps)
    assert 10**9 <= captures[0] < 10**9 + 200_000_000
    assert set(np.diff(captures)) == {200_000_000}
    assert {t_ns - capture for (t_ns, _), capture in zip(arrived, captures, strict=True)} == {14_000_000}
    assert len(arrived) in {9, 10}


def test_the_same_seed_gives_the_same_frames_and_another_seed_others() -> None:
    (_, first), (_, again), (_, other) = (run(seed, until_s=0.5) for seed in (1, 1, 2))
    assert all(np.array_equal(a.image, b.image) for (_, a), (_, b) in zip(first, again, strict=True))
    assert [t_ns for t_ns, _ in first] == [t_ns for t_ns, _ in again]
    assert not np.array_equal(first[0][1].image, other[0][1].image)


def test_the_driver_sees_frames_in_lockstep_and_none_while_unplugged() -> None:
    clock = VirtualClock()
    plant = StraightPlant()
    device = make_camera("camera", DEVICE, WIDE_TRACE, plant, np.random.default_rng(1), clock.now_ns())
    link = LoopbackLink(World(plant, {}, {"camera": device}), device, clock)
    with DEVICE.make_driver("camera", link, clock) as driver:
        frames = [driver.wait_next(FrameSample, 1.0) for _ in range(3)]
        assert [frame.index for frame in frames] == [0, 1, 2]
        assert all(frame.t_capture_ns is not None and frame.t_capture_ns < frame.t_ns for frame in frames)
        assert not np.array_equal(frames[0].image, frames[2].image)
        device.unplugged = True
        clock.sleep_until(clock.now_ns() + 10**9)
        assert [type(sample).__name__ for sample in driver.poll()] == ["LinkSample"]
        link.send(b"a camera hears nothing")


def test_the_live_folder_keeps_the_newest_frames_and_touches_no_others(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "frames"
    writer = LiveFolderWriter(folder, keep=3)
    (folder / "1.jpg").write_bytes(b"of somebody else")
    for t_ns in range(100, 110):
        writer.write(np.full((48, 64, 3), 50, np.uint8), t_ns)
    assert sorted(path.name for path in folder.iterdir()) == ["1.jpg", "107.jpg", "108.jpg", "109.jpg"]
    writer.close()
    assert [path.name for path in folder.iterdir()] == ["1.jpg"]


def test_the_live_folder_is_removed_with_its_frames_when_nothing_else_is_in_it(tmp_path: Path) -> None:
    writer = LiveFolderWriter(tmp_path / "frames")
    writer.write(np.full((48, 64, 3), 50, np.uint8), 100)
    writer.close()
    assert list(tmp_path.iterdir()) == []


def test_an_unfinished_frame_is_not_taken_for_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def lose_power(path: Path, target: Path) -> None:
        raise OSError("power lost")

    clock = VirtualClock(5 * 10**9)
    link = LIVE_CAMERA.model_copy(update={"path": str(tmp_path)}).make_link(clock)
    link.open(1.0)
    monkeypatch.setattr(Path, "rename", lose_power)
    with pytest.raises(OSError, match="power lost"):
        LiveFolderWriter(tmp_path).write(np.zeros((48, 64, 3), np.uint8), clock.now_ns())
    assert len(list(tmp_path.iterdir())) == 1
    assert link.receive() == []


def test_the_camera_driver_reads_what_the_live_folder_writer_writes(tmp_path: Path) -> None:
    clock = VirtualClock(5 * 10**9)
    settings = LIVE_CAMERA.model_copy(update={"path": str(tmp_path)})
    writer = LiveFolderWriter(tmp_path)
    writer.write(np.zeros((48, 64, 3), np.uint8), clock.now_ns() - 10**9)
    image = np.full((48, 64, 3), 120, np.uint8)
    image[:24] = 60
    with settings.make_driver("camera", settings.make_link(clock), clock) as driver:
        writer.write(image, clock.now_ns() - 1000)
        (frame,) = driver.poll()
    assert isinstance(frame, FrameSample)
    assert frame.t_capture_ns == clock.now_ns() - 1000
    assert np.abs(frame.image.astype(int) - image).max() <= 3
