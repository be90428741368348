"""The simulated overhead camera: where the marker appears, when pictures come, and what blurs them."""

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.clock import VirtualClock, nanoseconds
from drivers.errors import ConfigError
from drivers.link import CameraImage, Received
from drivers.overhead_camera.markers import MarkerFinder, centre_of
from drivers.overhead_camera.settings import OverheadCameraSettings
from drivers.samples import PoseFixSample
from sim_backends.devices.overhead_camera import make_emulator
from sim_backends.overhead_scene.scene import OverheadScene, PinholeCamera
from sim_backends.overhead_scene.settings import OverheadCameraEmulatorSettings
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.plant import Truth
from sim_backends.world.world import EmulatedDevice, World
from tests.sim_backends.test_camera import StraightPlant, truth_at

START_NS = 1_000_000_000


def device(**changes: object) -> OverheadCameraSettings:
    table: dict[str, object] = {
        "type": "overhead_camera",
        "source": "live_folder",
        "path": "frames",
        "marker_id": 7,
        "marker_size_m": 0.12,
        "marker_height_m": 0.22,
        "calibration": "simulated",
    }
    return OverheadCameraSettings.model_validate({**table, **changes})


def emulator(**changes: object) -> OverheadCameraEmulatorSettings:
    return OverheadCameraEmulatorSettings.model_validate({"type": "overhead_camera", **changes})


DEFAULT = emulator()
EXACT = emulator(marker_height_error_m=0, marker_yaw_error_deg=0)


def scene(settings: OverheadCameraEmulatorSettings = DEFAULT, **changes: float) -> OverheadScene:
    return OverheadScene(device(), settings.model_copy(update=changes), np.random.default_rng(4))


def fix_of(camera: OverheadScene, truth: Truth) -> PoseFixSample:
    (result,) = device().make_codec("overhead").decode(Received(9, CameraImage(camera.render(truth), 5)))
    assert isinstance(result, PoseFixSample), result
    return result


def test_points_appear_where_opencv_projects_them() -> None:
    settings = emulator(turn_deg=30, tilt_x_deg=5, tilt_y_deg=-3, horizontal_view_deg=50)
    camera = PinholeCamera(settings, 640, 480)
    focal_px = 320 / math.tan(math.radians(25))
    matrix = np.array([[focal_px, 0, 319.5], [0, focal_px, 239.5], [0, 0, 1]])
    # The camera's axes, from the angles: it leans 5 deg to its right and 3 deg to its lower edge.
    ahead = np.array([math.tan(math.radians(5)), -math.tan(math.radians(-3)), 1.0])
    down_frame = cv2.Rodrigues(np.array([0.0, 0.0, math.radians(30)]))[0] @ np.diag([1.0, -1.0, -1.0])
    ahead_m = down_frame @ ahead / np.linalg.norm(ahead)
    right_m = down_frame[:, 0] - (down_frame[:, 0] @ ahead_m) * ahead_m
    right_m /= np.linalg.norm(right_m)
    rotation = np.array([right_m, np.cross(ahead_m, right_m), ahead_m])
    translation = -rotation @ np.array([settings.camera_x_m, settings.camera_y_m, settings.height_m])
    points = np.array([(0.0, 0.0, 0.0), (0.9, 0.1, 0.3), (0.2, 0.6, 0.1)])
    expected, _ = cv2.projectPoints(points, cv2.Rodrigues(rotation)[0], translation, matrix, np.zeros(4))
    assert camera.project(points) == pytest.approx(np.asarray(expected).reshape(-1, 2), abs=1e-9)


def test_the_picture_is_not_mirrored_and_its_scale_is_that_of_the_height() -> None:
    camera = PinholeCamera(emulator(tilt_x_deg=0, tilt_y_deg=0), 640, 480)
    foot, right, up = camera.project(np.array([(0.45, 0.2, 0.0), (0.55, 0.2, 0.0), (0.45, 0.3, 0.0)]))
    scale_px = 0.1 * 320 / (2.5 * math.tan(math.radians(18)))
    assert foot == pytest.approx((319.5, 239.5))
    assert right - foot == pytest.approx((scale_px, 0.0), abs=1e-9)
    assert up - foot == pytest.approx((0.0, -scale_px), abs=1e-9)


def test_the_marker_is_drawn_at_the_projection_of_its_true_place() -> None:
    camera = PinholeCamera(emulator(), 640, 480)
    for yaw_rad in (0.0, 1.0, -2.5):
        picture = scene(marker_height_error_m=0.05).render(truth_at(0.7, 0.4, yaw_rad))
        (marker,) = MarkerFinder("DICT_4X4_50").find(picture)
        expected = camera.project(np.array([(0.7, 0.4, 0.27)]))[0]
        assert centre_of(marker.corners_px) == pytest.approx(tuple(expected), abs=0.15)
        left, right = marker.corners_px[:2]
        along = math.atan2(-(right[1] - left[1]), right[0] - left[0])
        assert math.remainder(along - yaw_rad - math.radians(0.1), math.tau) == pytest.approx(0, abs=0.03)


def test_the_mounting_moves_the_marker_on_the_rover() -> None:
    mounted = device(marker_x_m=0.1, marker_y_m=0.03, marker_yaw_deg=180)
    truth = truth_at(0.5, 0.2, 1.2)
    picture = OverheadScene(mounted, EXACT, np.random.default_rng(1)).render(truth)
    (result,) = mounted.make_codec("overhead").decode(Received(9, CameraImage(picture, 5)))
    assert isinstance(result, PoseFixSample)
    assert (result.x_m, result.y_m, result.yaw_rad) == pytest.approx((0.5, 0.2, 1.2), abs=3e-3)
    place = centre_of(MarkerFinder("DICT_4X4_50").find(picture)[0].corners_px)
    x_m = 0.5 + 0.1 * math.cos(1.2) - 0.03 * math.sin(1.2)
    y_m = 0.2 + 0.1 * math.sin(1.2) + 0.03 * math.cos(1.2)
    expected = PinholeCamera(emulator(), 640, 480).project(np.array([(x_m, y_m, 0.22)]))[0]
    assert place == pytest.approx(tuple(expected), abs=0.15)


def test_the_shipped_calibration_fits_the_default_camera() -> None:
    camera = scene(EXACT)
    rng = np.random.default_rng(8)
    for x_m, y_m, yaw_rad in rng.uniform((0.0, 0.0, -math.pi), (0.9, 0.4, math.pi), (20, 3)):
        fix = fix_of(camera, truth_at(x_m, y_m, yaw_rad))
        assert (fix.x_m, fix.y_m) == pytest.approx((x_m, y_m), abs=2e-3)
        assert math.remainder(fix.yaw_rad - yaw_rad, math.tau) == pytest.approx(0, abs=math.radians(0.6))


def test_a_marker_higher_than_believed_seems_farther_out() -> None:
    high = fix_of(scene(marker_height_error_m=0.1, marker_yaw_error_deg=0), truth_at(0.95, 0.2))
    # 0.5 m from the foot of the lens, 2.28 m below it; 0.1 m too high.
    assert high.x_m - 0.95 == pytest.approx(0.5 * 0.1 / 2.18, abs=3e-3)


def test_motion_during_the_exposure_blurs_along_the_way() -> None:
    still, fast = (
        scene(EXACT, noise_grey=0, exposure_s=0.04).render(replace(truth_at(0.5, 0.2), velocity_x_m_s=v))
        for v in (0.0, 0.3)
    )
    window = (slice(190, 260), slice(280, 390))

    def sharpness(picture: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], axis: int) -> float:
        steps = np.diff(picture[window][..., 0].astype(float), axis=axis)
        return float((steps**2).mean())

    assert sharpness(fast, axis=1) < 0.6 * sharpness(still, axis=1)
    assert sharpness(fast, axis=0) > 0.8 * sharpness(still, axis=0)
    fix = fix_of(scene(EXACT, exposure_s=0.01), replace(truth_at(0.5, 0.2), velocity_x_m_s=0.3))
    assert fix.x_m == pytest.approx(0.5, abs=2e-3)


def test_noise_is_as_configured_and_differs_from_picture_to_picture() -> None:
    camera = scene(noise_grey=5)
    first, second = camera.render(truth_at()), camera.render(truth_at())
    difference = first[..., 0].astype(float) - second[..., 0]
    assert difference.std() == pytest.approx(5 * math.sqrt(2), rel=0.05)
    assert (first[..., 0] == first[..., 2]).all()


@pytest.mark.parametrize("place", [(-2.0, 0.2), (3.0, 0.2), (0.5, -3.0), (0.5, 3.0), (-0.4, 0.2)])
def test_a_rover_out_of_view_or_half_in_it_shows_no_marker(place: tuple[float, float]) -> None:
    picture = scene().render(truth_at(*place))
    assert picture.shape == (480, 640, 3)
    assert MarkerFinder("DICT_4X4_50").find(picture) == []


def simulated(
    settings: OverheadCameraEmulatorSettings = DEFAULT, seed: int = 0
) -> tuple[EmulatedDevice[CameraImage], World]:
    plant = StraightPlant(velocity_x_m_s=0.1, wheel_count=3)
    rng = np.random.default_rng(seed)
    camera = make_emulator("overhead", device(), settings, plant, rng, START_NS)
    return camera, World(plant, {}, {"overhead": camera})


def pictures(
    settings: OverheadCameraEmulatorSettings = DEFAULT, seed: int = 0, duration_s: float = 20.0
) -> list[Received[CameraImage]]:
    camera, world = simulated(settings, seed)
    world.advance(START_NS + nanoseconds(duration_s))
    return camera.to_host.take(START_NS + nanoseconds(duration_s))


def test_pictures_come_at_their_rate_and_are_late_by_exposure_and_transfer() -> None:
    arrived = pictures(emulator(exposure_s=0.02, transfer_min_s=0.01, transfer_max_s=0.04))
    stamps = [item.payload.t_capture_ns or 0 for item in arrived]
    assert set(np.diff(stamps)) == {500_000_000}
    assert START_NS - 10_000_000 <= stamps[0] < START_NS + 500_000_000
    ages_s = [(item.t_ns - stamp) / 1e9 for item, stamp in zip(arrived, stamps, strict=True)]
    assert 0.03 <= min(ages_s) < 0.04
    assert 0.05 < max(ages_s) <= 0.06


def test_the_picture_shows_the_middle_of_the_exposure() -> None:
    (first, *_) = pictures(EXACT.model_copy(update={"exposure_s": 0.1}))
    (fix,) = device().make_codec("overhead").decode(first)
    assert isinstance(fix, PoseFixSample)
    middle_s = (fix.t_capture_ns + 50_000_000) / 1e9
    assert fix.x_m == pytest.approx(0.1 * middle_s, abs=1.5e-3)


def test_the_same_seed_gives_the_same_pictures() -> None:
    first, again, other = (pictures(seed=seed, duration_s=1.2) for seed in (1, 1, 2))
    assert [item.t_ns for item in first] == [item.t_ns for item in again]
    assert all((a.payload.image == b.payload.image).all() for a, b in zip(first, again, strict=True))
    assert [item.t_ns for item in first] != [item.t_ns for item in other]


def test_the_driver_hears_a_pose_from_every_picture() -> None:
    camera, world = simulated()
    clock = VirtualClock(START_NS)
    driver = device().make_driver("overhead", LoopbackLink(world, camera, clock), clock)
    driver.connect()
    clock.sleep_until(START_NS + nanoseconds(5.0))
    samples = driver.poll()
    assert len(samples) == 10
    assert all(isinstance(sample, PoseFixSample) for sample in samples)
    assert driver.health().rejected == {}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"transfer_min_s": 0.06}, "transfer_min_s is greater"),
        ({"height_m": 0.5, "marker_height_error_m": 0.1}, "above the marker"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(changes: dict[str, object], words: str) -> None:
    low = device(marker_height_m=0.45)
    plant = StraightPlant()
    with pytest.raises(ConfigError, match=words):
        make_emulator("overhead", low, emulator(**changes), plant, np.random.default_rng(0), START_NS)


def test_the_shipped_calibration_is_a_file_of_the_package() -> None:
    (path,) = device().data_files()["calibration"]
    assert Path(path).name == "simulated.toml"
