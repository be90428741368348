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
from sim_backends.devices.camera import make_emulator
from sim_backends.rear_scene.emulated_scene import EmulatedScene, make_rig
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from sim_backends.world.live_folder import LiveFolderWriter
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.plant import Truth
from sim_backends.world.world import EmulatedDevice, World

WIDTH, HEIGHT = 640, 480
METRES_PER_PIXEL = 0.0015
FIRST_X_M, FIRST_Y_M = -0.50, 0.42
ROWS, COLUMNS = 200, 256
SETTINGS = CameraEmulatorSettings(type="camera", noise_grey=0, rock_deg=0, stones_per_m2=0)
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


def scene(emulator: CameraEmulatorSettings = SETTINGS, seed: int = 3) -> EmulatedScene:
    return EmulatedScene(emulator, WIDTH, HEIGHT, 5.0, np.random.default_rng(seed), 0)


def rectify(image: Image, emulator: CameraEmulatorSettings = SETTINGS) -> Image:
    """Return the picture seen from straight above: a row per x backwards, a column per y to the right."""
    x_m = FIRST_X_M - METRES_PER_PIXEL * np.arange(ROWS)
    y_m = FIRST_Y_M - METRES_PER_PIXEL * np.arange(COLUMNS)
    surface_m = np.full((ROWS, COLUMNS), emulator.rut_depth_m)
    ground = np.stack([*np.meshgrid(x_m, y_m, indexing="ij"), surface_m], axis=-1).reshape(-1, 3)
    pixels = (
        make_rig(emulator, WIDTH, HEIGHT, 5.0).project(ground).reshape(ROWS, COLUMNS, 2).astype(np.float32)
    )
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(cv2.remap(grey, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR), np.uint8)


def test_the_optical_axis_meets_the_floor_behind_the_wheel_in_the_middle_of_the_picture() -> None:
    emulator = CameraEmulatorSettings(
        type="camera", wheel_x_m=-0.3, wheel_y_m=0.2, height_m=0.5, tilt_deg=60, behind_m=0.1
    )
    rig = make_rig(emulator, WIDTH, HEIGHT, 5.0)
    met = np.array([[-0.4 - 0.5 / math.tan(math.radians(60)), 0.2, 0.0]])
    assert rig.project(met)[0] == pytest.approx((319.5, 239.5))
    # Left of the rover is right in the picture, farther behind is higher, at the scale of a pinhole.
    left, behind = rig.project(np.concatenate([met, met]) + np.array([[0, 0.01, 0], [-0.01, 0, 0]]))
    focal_px, depth_m = 320 / math.tan(math.radians(30)), 0.5 / math.sin(math.radians(60))
    assert left - 319.5 == pytest.approx([focal_px * 0.01 / depth_m, -80], abs=0.1)
    assert behind[1] < 239.5


@pytest.mark.parametrize("wrong", [{"tilt_deg": 20}, {"height_m": 1.4}])
def test_a_camera_that_sees_too_far_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="raise its tilt_deg"):
        scene(SETTINGS.model_copy(update=wrong))


def test_a_lens_that_folds_its_picture_is_refused() -> None:
    with pytest.raises(ConfigError, match="smaller coefficients"):
        scene(SETTINGS.model_copy(update={"distortion": (-0.5, 0.0, 0.0, 0.0, 0.0)}))


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
    # Left of the wheel's trace, which the rover makes as it moves.
    old, new = (rectify(image)[:, :70].astype(np.float64) for image in (before, after))
    window = cv2.createHanningWindow((70, ROWS), cv2.CV_64F)
    (shift_right, shift_back), response = cv2.phaseCorrelate(old, new, window)
    assert response > 0.2
    assert (shift_back * METRES_PER_PIXEL, shift_right * METRES_PER_PIXEL) == pytest.approx(moved_m, abs=8e-4)


@pytest.mark.parametrize(
    "sideslip_rad", [-0.15, *(pytest.param(angle, marks=pytest.mark.nightly) for angle in (0.0, 0.15))]
)
def test_the_trace_leaves_the_wheel_against_the_direction_of_travel(sideslip_rad: float) -> None:
    # The wall on the sun's side is dark. The front wheel's trace lies on the other side of the rear one's.
    side = -1 if sideslip_rad < 0 else 1
    low_sun = SETTINGS.model_copy(update={"sun_azimuth_deg": 90.0 * side, "sun_elevation_deg": 40.0})
    travelled, fresh = scene(low_sun), scene(low_sun)
    for step in range(25):
        distance_m = 0.04 * step
        pose = truth_at(distance_m * math.cos(sideslip_rad), distance_m * math.sin(sideslip_rad))
        picture = travelled.render(pose)
    darker = rectify(fresh.render(pose)).astype(int) - rectify(picture) > 25
    rows = np.flatnonzero(darker.sum(axis=1) > 3)
    assert len(rows) > 100
    outermost = [np.flatnonzero(darker[row])[0 if side > 0 else -1] for row in rows]
    wall_m = FIRST_Y_M - METRES_PER_PIXEL * np.array(outermost)
    behind_m = SETTINGS.wheel_x_m - (FIRST_X_M - METRES_PER_PIXEL * rows)
    slope, offset_m = np.polyfit(behind_m, wall_m, 1)
    assert math.atan(-slope) == pytest.approx(sideslip_rad, abs=0.02)
    assert offset_m == pytest.approx(SETTINGS.wheel_y_m + side * SETTINGS.trace_width_m / 2, abs=0.02)


def test_a_rover_that_spins_or_reverses_over_its_trace_is_rendered() -> None:
    ground = scene()
    for step in range(20):
        image = ground.render(truth_at(-0.1 * step, 0.0, 0.2 * step))
    assert image.shape == (HEIGHT, WIDTH, 3)


def test_a_slow_camera_sees_the_traces_that_a_fast_one_sees() -> None:
    def pose(share: float) -> Truth:
        return truth_at(0.6 * share, 0.1 * share, 0.5 * share)

    fast, slow = scene(), scene()
    for step in range(21):
        often = fast.render(pose(step / 20))
    slow.render(pose(0.0))
    seldom = slow.render(pose(1.0))
    assert np.mean(np.abs(often.astype(float) - seldom) > 25) < 0.006
    assert np.mean(np.abs(often.astype(float) - scene().render(pose(1.0))) > 25) > 0.02


def test_a_trace_ahead_of_the_camera_is_not_seen() -> None:
    # Reversing, the wheels make their traces where the camera has been.
    alone = SETTINGS.model_copy(update={"wheel_x_m": 0.0, "behind_m": 0.32})
    reversing, fresh = scene(alone), scene(alone)
    for step in range(30):
        pose = truth_at(-0.04 * step)
        picture = reversing.render(pose)
    assert np.array_equal(picture[:300], fresh.render(pose)[:300])


def test_noise_has_the_configured_size_and_differs_from_frame_to_frame() -> None:
    noisy = scene(SETTINGS.model_copy(update={"noise_grey": 4.0}))
    first, second = (noisy.render(truth_at())[..., 0].astype(int) for _ in range(2))
    assert (first - second).std() == pytest.approx(4 * math.sqrt(2), rel=0.1)


def run(seed: int, until_s: float) -> tuple[EmulatedDevice[CameraImage], list[tuple[int, CameraImage]]]:
    plant = StraightPlant()
    device = make_emulator("camera", DEVICE, SETTINGS, plant, np.random.default_rng(seed), 10**9)
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
    device = make_emulator("camera", DEVICE, SETTINGS, plant, np.random.default_rng(1), clock.now_ns())
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
