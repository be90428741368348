"""The simulated camera as one that measures the motion of the ground: exact motion, and what disturbs it."""

import itertools
import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drivers.camera.settings import CameraSettings
from drivers.clock import nanoseconds
from drivers.link import CameraImage
from drivers.samples import Image
from sim_backends.devices.camera import make_emulator
from sim_backends.rear_scene.emulated_scene import SINKING_RAD, EmulatedScene, make_rig
from sim_backends.rear_scene.scene import Pose
from sim_backends.rear_scene.settings import CameraEmulatorSettings, CanopySettings, DirtSettings
from sim_backends.world.faults import ChanceFault, grey_lower_half, schedule_faults
from sim_backends.world.plant import Truth
from sim_backends.world.world import World
from tests.cases import first_often
from tests.sim_backends.test_camera import StraightPlant, truth_at

Floats = NDArray[np.float64]

WIDTH, HEIGHT = 320, 240
QUIET: dict[str, Any] = {
    "type": "camera",
    "noise_grey": 0,
    "stones_per_m2": 0,
    "ground": "coarse_sand",
    "exposure_s": 0,
    "rock_deg": 0,
}
FOUR_WHEELS = CameraEmulatorSettings(**QUIET, shadow_of="nothing", leaves_traces=False)
ROBOTINO = CameraEmulatorSettings(
    **QUIET,
    leaves_traces=False,
    shadow_of="nothing",
    wheel_x_m=-0.2,
    wheel_y_m=0.0,
    behind_m=0.0,
    height_m=0.45,
    rut_depth_m=0.001,
)


def scene(emulator: CameraEmulatorSettings, seed: int = 3) -> EmulatedScene:
    return EmulatedScene(emulator, WIDTH, HEIGHT, 10.0, np.random.default_rng(seed), 0)


def changed(emulator: CameraEmulatorSettings, **values: object) -> CameraEmulatorSettings:
    return CameraEmulatorSettings.model_validate(emulator.model_dump() | values)


def grey(image: Image) -> Image:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def camera_in_world(emulator: CameraEmulatorSettings, pose: Pose) -> tuple[Floats, Floats]:
    """Return rotation and position of the camera, computed with SciPy from the true pose."""
    rig = make_rig(emulator, WIDTH, HEIGHT, 10.0)
    roll, pitch = np.array(pose.rock_rad) + pose.vibration.rock_rad(np.zeros(1))[0]
    body = Rotation.from_euler("ZYX", [pose.yaw_rad, pitch, roll]).as_matrix()
    return body @ rig.vehicle_from_camera, pose.position_m + body @ rig.camera_m


def missed_px(emulator: CameraEmulatorSettings, images: list[Image], poses: list[Pose]) -> Floats:
    """Return by how much the second image differs from the first one moved as the poses say, per window."""
    rig = make_rig(emulator, WIDTH, HEIGHT, 10.0)
    columns, rows = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1)
    plain = cv2.undistortPoints(pixels[:, None], rig.camera_matrix, rig.distortion)[:, 0]
    (turn, lens), (later_turn, later_lens) = (camera_in_world(emulator, pose) for pose in poses)
    rays = np.insert(np.asarray(plain, np.float64), 2, 1.0, axis=1) @ turn.T
    ground = lens - rays * (lens[2] / rays[:, 2:])
    seen = (ground - later_lens) @ later_turn
    later, _ = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), rig.camera_matrix, rig.distortion)
    grid = later.reshape(HEIGHT, WIDTH, 2).astype(np.float32)
    moved = cv2.remap(grey(images[1]), grid[..., 0], grid[..., 1], cv2.INTER_CUBIC)
    points = np.mgrid[24 : WIDTH - 24 : 16, 24 : HEIGHT - 24 : 16].reshape(2, -1).T.astype(np.float32)
    inside = np.asarray((grid > 24).all(axis=2) & (grid < (WIDTH - 25, HEIGHT - 25)).all(axis=2))
    points = points[inside[points[:, 1].astype(int), points[:, 0].astype(int)]]
    assert len(points) > 50
    found, is_found, _ = cv2.calcOpticalFlowPyrLK(
        grey(images[0]), moved, points[:, None], points[:, None].copy(), winSize=(31, 31), maxLevel=0
    )
    assert is_found.mean() > 0.9
    return np.asarray((found[:, 0] - points)[is_found[:, 0] > 0], np.float64)


def two_frames(
    emulator: CameraEmulatorSettings, first: Truth, second: Truth
) -> tuple[list[Image], list[Pose]]:
    seen = scene(emulator)
    images, poses = [], []
    for truth in (first, second):
        images.append(seen.render(truth).copy())
        assert seen.shown is not None
        poses.append(seen.shown)
    return images, poses


@pytest.mark.parametrize("emulator", [FOUR_WHEELS, ROBOTINO], ids=["four wheels", "robotino"])
@pytest.mark.parametrize(
    "moved",
    [(0.016, 0.0, 0.0), (-0.016, 0.0, 0.0), (0.0, 0.015, 0.0), (0.0, 0.0, 0.05), (0.01, -0.008, -0.04)],
    ids=["ahead", "back", "sideways", "on the spot", "all"],
)
def test_the_image_moves_exactly_as_the_true_pose(
    emulator: CameraEmulatorSettings, moved: tuple[float, float, float]
) -> None:
    x_m, y_m, turn_rad = moved
    yaw_rad = 0.7
    end = np.array([1.2, -0.4]) + Rotation.from_euler("Z", yaw_rad).as_matrix()[:2, :2] @ (x_m, y_m)
    before, after = truth_at(1.2, -0.4, yaw_rad), truth_at(float(end[0]), float(end[1]), yaw_rad + turn_rad)
    images, poses = two_frames(emulator, before, replace(after, t_ns=10**8))
    misses = missed_px(emulator, images, poses)
    assert np.abs(np.median(misses, axis=0)).max() < 0.05
    assert np.percentile(np.hypot(*misses.T), 95) < 0.25
    # A quarter of a millimetre more is noticed.
    wrong = replace(poses[1], position_m=poses[1].position_m + np.array([0.00025, 0.0, 0.0]))
    assert np.abs(np.median(missed_px(emulator, images, [poses[0], wrong]), axis=0)).max() > 0.05


def test_a_rover_that_slips_sinks_and_its_camera_with_it() -> None:
    emulator = changed(ROBOTINO, sinkage_per_slip_m=0.015)
    slips = replace(truth_at(), wheel_position_rad=(0.0, 0.0, 0.0), slip=(0.8, 0.8, 0.8))
    later = replace(slips, t_ns=10**9, wheel_position_rad=(4.0, -4.0, 4.0))
    images, poses = two_frames(emulator, slips, later)
    depths = [-pose.position_m[2] for pose in poses]
    assert depths == pytest.approx([0.001, 0.001 + 0.012 * (1 - math.exp(-4.0 / SINKING_RAD))])
    assert np.hypot(*missed_px(emulator, images, poses).T).max() < 0.4
    # 10 mm of 0.45 m are seen: the ground comes nearer.
    above = replace(poses[1], position_m=poses[0].position_m)
    assert np.hypot(*missed_px(emulator, images, [poses[0], above]).T).max() > 1.0


def test_a_rover_at_rest_or_without_slip_does_not_sink() -> None:
    seen = scene(changed(ROBOTINO, sinkage_per_slip_m=0.015))
    for step in range(5):
        rests = replace(truth_at(), wheel_position_rad=(1.0,), slip=(0.9,), t_ns=step * 10**8)
        seen.render(rests)
        assert seen.shown is not None
        assert seen.shown.sinkage_m == 0.001
    seen.render(replace(rests, wheel_position_rad=(9.0,), slip=(0.0,)))
    assert seen.shown is not None
    assert seen.shown.sinkage_m == 0.001


def test_a_rover_without_traces_leaves_the_ground_as_it_is() -> None:
    driven, fresh = scene(ROBOTINO), scene(ROBOTINO)
    for step in range(12):
        image = driven.render(truth_at(0.05 * step))
    assert np.array_equal(image, fresh.render(truth_at(0.55)))


@pytest.mark.parametrize("line", first_often([0, 60, HEIGHT - 1]))
def test_a_rolling_shutter_shows_each_line_at_its_own_time(line: int) -> None:
    speed_m_s, rate_rad_s, readout_s = 0.5, 0.6, 0.03
    shaken = {"vibration_deg": 0.3, "vibration_hz": 20}

    def at(later_s: float, t_ns: int) -> Truth:
        # The rover turns about its origin, which moves along x: the heading is 0 in the middle of the image.
        truth = truth_at(1.0 + speed_m_s * later_s, 0.0, rate_rad_s * later_s)
        return replace(truth, t_ns=t_ns, velocity_x_m_s=speed_m_s, yaw_rate_rad_s=rate_rad_s)

    rolling = scene(changed(ROBOTINO, readout_s=readout_s, blur_px=0.3, **shaken))
    still = scene(changed(ROBOTINO, blur_px=0.3, **shaken))
    middle_ns = 50_000_000
    later_s = readout_s * (line / (HEIGHT - 1) - 0.5)
    whole = rolling.render(at(0.0, middle_ns)).astype(int)
    then = still.render(at(later_s, middle_ns + nanoseconds(later_s))).astype(int)
    now = scene(changed(ROBOTINO, blur_px=0.3, **shaken)).render(at(0.0, middle_ns)).astype(int)
    # The blur mixes neighbouring lines, which differ a little in time.
    assert np.abs(whole[line] - then[line]).mean() < 1.0
    assert np.abs(whole[line] - now[line]).mean() > 2.0


def test_a_vibration_moves_the_image_as_the_true_pose_says() -> None:
    emulator = changed(ROBOTINO, vibration_deg=0.4, vibration_hz=30)
    frames = [
        two_frames(emulator, truth_at(), replace(truth_at(), t_ns=1_000_000 * later)) for later in (5, 12, 19)
    ]
    for images, poses in frames:
        assert np.hypot(*missed_px(emulator, images, poses).T).max() < 0.4
    tilts = np.degrees([poses[1].vibration.rock_rad(np.zeros(1))[0] for _, poses in frames])
    assert np.ptp(tilts, axis=0).min() > 0.1
    assert np.abs(tilts).max() <= 0.4


def test_the_vibration_blurs() -> None:
    def sharpness(vibration_deg: float) -> float:
        emulator = changed(ROBOTINO, vibration_deg=vibration_deg, vibration_hz=30, exposure_s=0.01)
        images = [scene(emulator, seed).render(truth_at()) for seed in range(3)]
        return float(np.mean([cv2.Laplacian(grey(image), cv2.CV_64F).std() for image in images]))

    assert sharpness(1.0) < 0.8 * sharpness(0.0)


def shaded(emulator: CameraEmulatorSettings, truth: Truth, **values: object) -> Floats:
    """Return brightness over that of the same scene without these values."""
    with_it, without = (
        scene(changed(emulator, **extra)).render(truth).astype(float) for extra in (values, {})
    )
    return np.asarray((with_it / np.maximum(without, 1)).mean(axis=2), np.float64)


def test_a_canopy_shades_its_share_of_the_ground() -> None:
    canopy = {"cover": 0.3, "size_m": 0.05}
    covered, clear = scene(changed(ROBOTINO, canopy=canopy)), scene(ROBOTINO)
    shares = []
    for step in range(6):
        far = truth_at(0.8 * step, 0.6 * step)
        shares.append(np.mean(covered.render(far) < 0.8 * clear.render(far).astype(float)))
    assert 0.2 < np.mean(shares) < 0.4
    far = truth_at()
    weak = shaded(ROBOTINO, far, canopy=canopy | {"strength": 0.3})
    strong = shaded(ROBOTINO, far, canopy=canopy)
    assert strong.min() < weak.min() - 0.2


@pytest.mark.parametrize(("speed_m_s", "direction_deg"), first_often([(0.4, 90.0), (0.0, 0.0), (0.4, 0.0)]))
def test_shadows_of_a_canopy_pass_with_their_speed(speed_m_s: float, direction_deg: float) -> None:
    canopy = {"cover": 0.4, "size_m": 0.05, "speed_m_s": speed_m_s, "direction_deg": direction_deg}
    rig = make_rig(ROBOTINO, WIDTH, HEIGHT, 10.0)
    x_m, y_m = np.meshgrid(-0.3 - 0.0025 * np.arange(96), 0.12 - 0.0025 * np.arange(96), indexing="ij")
    pixels = rig.project(np.stack([x_m, y_m, np.full_like(x_m, 0.001)], axis=-1).reshape(-1, 3))
    grid = pixels.reshape(96, 96, 2).astype(np.float32)

    def from_above(t_ns: int) -> Floats:
        ratio = shaded(ROBOTINO, replace(truth_at(), t_ns=t_ns), canopy=canopy).astype(np.float32)
        return np.asarray(cv2.remap(ratio, grid[..., 0], grid[..., 1], cv2.INTER_LINEAR), np.float64)

    before, after = from_above(10**8), from_above(2 * 10**8)
    ahead, left = Rotation.from_euler("Z", direction_deg, degrees=True).apply([0.1 * speed_m_s, 0, 0])[:2]
    # Rows go backwards, columns to the right.
    rows, columns = round(ahead / 0.0025), round(left / 0.0025)
    moved = np.abs(before[rows:, columns:] - after[: 96 - rows, : 96 - columns])
    assert moved.mean() < 0.02
    assert speed_m_s == 0 or np.abs(before - after).mean() > 0.04


def test_dirt_stands_still_in_the_image() -> None:
    dirt = {"specks": 40, "opacity": 0.9, "radius_px": 4}
    here, there = (shaded(ROBOTINO, truth_at(x_m), dirt=dirt) for x_m in (0.0, 0.4))
    assert 0.02 < np.mean(here < 0.8) < 0.5
    assert 0.05 < here.min() < 0.4
    assert np.abs(here - there).max() < 0.05


def test_a_motion_blur_leaves_dirt_sharp() -> None:
    dirt = {"specks": 40, "opacity": 0.9, "radius_px": 4}
    fast = replace(truth_at(), velocity_x_m_s=1.0)
    ratio = shaded(changed(ROBOTINO, exposure_s=0.02), fast, dirt=dirt)
    assert np.abs(ratio - shaded(ROBOTINO, fast, dirt=dirt)).max() < 0.05


def test_dark_flat_and_blurred_images() -> None:
    plain = scene(ROBOTINO).render(truth_at()).astype(float)
    dark = scene(changed(ROBOTINO, gain=0.1)).render(truth_at()).astype(float)
    assert dark.mean() == pytest.approx(plain.mean() * 0.1**0.6, rel=0.05)
    flat = scene(changed(ROBOTINO, contrast=0.25)).render(truth_at()).astype(float)
    assert flat.std() == pytest.approx(0.25 * plain.std(), rel=0.1)
    assert flat.mean() - 127.5 == pytest.approx(0.25 * (plain.mean() - 127.5), abs=1.0)
    blurred = scene(changed(ROBOTINO, blur_px=3)).render(truth_at())
    sigma_px = math.sqrt(3**2 - 0.6**2)
    inside = np.s_[12:-12, 12:-12]
    expected = cv2.GaussianBlur(plain, (0, 0), sigma_px)[inside]
    assert np.abs(blurred[inside] - expected).mean() < 1.0


def test_the_exposure_swings() -> None:
    seen = scene(changed(ROBOTINO, gain_swing=0.2))
    means = [seen.render(replace(truth_at(), t_ns=step * 10**9)).mean() for step in range(40)]
    assert np.log(means).std() == pytest.approx(0.6 * 0.2, rel=0.5)


@pytest.mark.parametrize("rover", ["four_wheels", "robotino"])
def test_the_shadow_of_the_rover_goes_with_it(rover: str) -> None:
    emulator = FOUR_WHEELS if rover == "four_wheels" else ROBOTINO
    low_sun = {"sun_azimuth_deg": 20.0, "sun_elevation_deg": 35.0}

    def shadow(truth: Truth) -> NDArray[np.bool_]:
        return shaded(changed(emulator, **low_sun), truth, shadow_of=rover) < 0.8

    here, ahead, turned = shadow(truth_at()), shadow(truth_at(0.5)), shadow(truth_at(0.0, 0.0, math.pi))
    assert here.mean() > 0.03
    assert np.mean(here != ahead) < 0.1 * here.mean()
    assert turned.mean() < 0.2 * here.mean()


DEVICE = CameraSettings(
    type="camera", source="v4l2", path="/dev/video0", width=WIDTH, height=HEIGHT, frame_rate_hz=10
)


def frames(emulator: CameraEmulatorSettings, until_s: float, drop: float = 0.0) -> list[CameraImage]:
    plant = StraightPlant(velocity_x_m_s=0.1)
    device = make_emulator("camera", DEVICE, emulator, plant, np.random.default_rng(4), 0)
    if drop:
        lost = ChanceFault(type="drop", device="camera", start_s=0, duration_s=1e3, probability=drop)
        schedule_faults(device, [lost], grey_lower_half, np.random.default_rng(1), 0)
    World(plant, {}, {"camera": device}).advance(nanoseconds(until_s))
    return [received.payload for received in device.to_host.take(nanoseconds(until_s))]


def test_repeated_frames_show_the_image_before_at_a_new_time() -> None:
    taken = frames(changed(ROBOTINO, repeat_share=0.3), 8.0)
    repeated = [np.array_equal(a.image, b.image) for a, b in itertools.pairwise(taken)]
    assert 0.15 < np.mean(repeated) < 0.45
    stamps = [each.t_capture_ns for each in taken if each.t_capture_ns is not None]
    assert set(np.diff(stamps)) == {100_000_000}


def test_lost_frames_leave_gaps() -> None:
    stamps = [each.t_capture_ns for each in frames(ROBOTINO, 8.0, drop=0.3) if each.t_capture_ns is not None]
    assert set(np.diff(stamps)) >= {100_000_000, 200_000_000}
    assert 40 < len(stamps) < 70


def test_a_frame_shows_the_middle_of_its_exposure() -> None:
    exposure_s, readout_s = 0.04, 0.02
    (late,) = frames(changed(ROBOTINO, exposure_s=exposure_s, readout_s=readout_s), 0.2)[-1:]
    assert late.t_capture_ns is not None
    middle_s = late.t_capture_ns / 1e9 + (exposure_s + readout_s) / 2
    there = replace(truth_at(0.1 * middle_s), t_ns=nanoseconds(middle_s))
    again = EmulatedScene(
        changed(ROBOTINO, exposure_s=exposure_s, readout_s=readout_s),
        WIDTH,
        HEIGHT,
        10.0,
        np.random.default_rng(4),
        0,
    )
    assert np.abs(again.render(there).astype(int) - late.image).max() <= 1


def test_wrong_disturbances_are_refused() -> None:
    with pytest.raises(ValueError, match="cover"):
        CanopySettings(cover=1.0)
    with pytest.raises(ValueError, match="opacity"):
        DirtSettings(specks=3, opacity=1.5)
