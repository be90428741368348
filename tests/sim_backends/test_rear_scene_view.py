"""What the rear scene draws: geometry, light and ruts, measured in its pictures."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim_backends.rear_scene.ground_map import GroundSettings, Rut, Sun, Terrain
from sim_backends.rear_scene.rig import Rig
from sim_backends.rear_scene.scene import RearScene, blur_kernel, rocking
from tests.rear_scene.motion import Motion, drive
from tests.rear_scene.truth import centre_line
from tests.sim_backends.rear_drives import (
    B_M,
    HALF_TRACK_M,
    HIGH_SUN,
    NO_NOISE,
    PAINT,
    PLAIN_GROUND,
    drive_scene,
    grey,
    plan,
    pose_at,
    rig,
)

pytestmark = pytest.mark.nightly  # a truth generator, which no change of the program touches

NOTHING = ()


def make_scene(
    of: Rig, rut: Rut = PAINT, sun: Sun = HIGH_SUN, ground: GroundSettings = PLAIN_GROUND, seed: int = 1
) -> RearScene:
    return RearScene(of, ground, sun, rut, NO_NOISE, np.random.default_rng(seed), body=NOTHING)


def on_floor(of: Rig, motion: Motion, step: int, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where rays through pixels meet the plane z = 0 of the vehicle frame."""
    rays = cv2.undistortPoints(pixels[:, None, :], of.camera_matrix, of.distortion)[:, 0, :]
    rock = rocking(*motion.rock_rad[step])
    directions = np.insert(np.asarray(rays), 2, 1.0, axis=1) @ (rock @ of.vehicle_from_camera).T
    lens = rock @ of.camera_m
    return np.asarray(lens + directions * (-lens[2] / directions[:, 2:]))


@pytest.mark.parametrize(
    ("drift", "turn", "rock"),
    [(0.0, 0.0, (0.0, 0.0)), (9.0, 0.0, (1.0, -1.5)), (-5.0, 2.0, (-1.0, 0.5))],
)
def test_the_trace_is_drawn_where_its_centre_line_is_projected(
    drift: float, turn: float, rock: tuple[float, float]
) -> None:
    of = replace(rig(), other_wheels=())
    base = plan(16.0, drift_deg=drift, yaw_rate_dps=turn, rock_deg=rock)
    motion = drive(replace(of, other_wheels=rig().other_wheels), Terrain(), base, PAINT.depth_m)
    motion = replace(motion, softness=motion.softness[:, -1:])
    scene = make_scene(of)
    drive_scene(scene, motion, 1590, stride=4)
    image = grey(scene.render(motion.pose(1590)))
    outline = of.wheel_outline(rocking(*motion.rock_rad[1590]))
    dark = (image < 0.6 * np.median(image)).astype(np.uint8)
    if outline is not None:
        cv2.fillConvexPoly(dark, np.round(outline).astype(np.int32), 0)
        dark[round(outline[:, 1].min()) - 4 :] = 0
    rows, columns = np.nonzero(dark)
    assert len(rows) > 10_000
    floor = on_floor(of, motion, 1590, np.stack([columns, rows], axis=1).astype(float))
    points, _ = centre_line(of, motion, 1590)
    heading = math.radians(drift)
    errors_px = []
    for x_m in np.arange(floor[:, 0].min() + 0.08, floor[:, 0].max() - 0.04, 0.02):
        strip = floor[np.abs(floor[:, 0] - x_m) < 0.004]
        expected = np.interp(x_m, points[::-1, 0], points[::-1, 1])
        drawn = 0.5 * (np.percentile(strip[:, 1], 1) + np.percentile(strip[:, 1], 99))
        both = of.project(
            np.array([[x_m, drawn, 0.0], [x_m, expected, 0.0]]) @ rocking(*motion.rock_rad[1590])
        )
        errors_px.append((both[0, 0] - both[1, 0]) * math.cos(heading))
    assert len(errors_px) > 15
    # The stripe's edges are ragged by a millimetre; its middle must not be off.
    assert np.abs(np.mean(errors_px)) < 0.3
    assert np.sqrt(np.mean(np.square(errors_px))) < 1.0


METRES_PER_PIXEL = 0.002
FIRST_X_M = -B_M - 0.17


def from_above(of: Rig, image: NDArray[np.uint8], height_m: float = 0.0) -> NDArray[np.float64]:
    """Return the picture seen from straight above: a row per x backwards, a column per y to the right."""
    x_m = FIRST_X_M - METRES_PER_PIXEL * np.arange(200)
    y_m = HALF_TRACK_M + 0.25 - METRES_PER_PIXEL * np.arange(250)
    grid = np.stack([*np.meshgrid(x_m, y_m, indexing="ij"), np.full((200, 250), height_m)], axis=-1)
    pixels = of.project(grid.reshape(-1, 3)).reshape(200, 250, 2).astype(np.float32)
    return np.asarray(cv2.remap(grey(image), pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR), np.float64)


@pytest.mark.parametrize("kind", ["fine_sand", "gravel"])
@pytest.mark.parametrize(
    ("yaw", "moved"), [(0.0, (0.016, 0.0)), (2.0, (-0.010, 0.022)), (-40.0, (0.0, -0.014))]
)
def test_the_ground_stands_still_in_the_world(kind: str, yaw: float, moved: tuple[float, float]) -> None:
    of = rig()
    ground = replace(PLAIN_GROUND, kind=kind)  # type: ignore[arg-type]
    scene = make_scene(of, ground=ground, sun=Sun(azimuth_deg=40))
    before = from_above(of, scene.render(pose_at(-8.3, 5.1, yaw, PAINT.depth_m)), PAINT.depth_m)
    x_m = -8.3 + moved[0] * math.cos(yaw) - moved[1] * math.sin(yaw)
    y_m = 5.1 + moved[0] * math.sin(yaw) + moved[1] * math.cos(yaw)
    after = from_above(of, scene.render(pose_at(x_m, y_m, yaw, PAINT.depth_m)), PAINT.depth_m)
    window = cv2.createHanningWindow((250, 200), cv2.CV_64F)
    (right, back), response = cv2.phaseCorrelate(before, after, window)
    assert response > 0.2
    # What the rover leaves behind moves back, and to the right when the rover moves left.
    assert (back * METRES_PER_PIXEL, right * METRES_PER_PIXEL) == pytest.approx(moved, abs=4e-4)


def test_a_turn_of_the_rover_turns_the_ground() -> None:
    of = rig()
    scene = make_scene(of, sun=Sun(azimuth_deg=40))
    before = from_above(of, scene.render(pose_at(0.0, 0.0, 0.0, PAINT.depth_m)), PAINT.depth_m)
    after = from_above(of, scene.render(pose_at(0.0, 0.0, 0.08, PAINT.depth_m)), PAINT.depth_m)
    # Rows go back from x = FIRST_X_M, columns right from the contact + 0.25.
    rows, columns = np.mgrid[0:200, 0:250].astype(np.float64)
    x_m, y_m = FIRST_X_M - METRES_PER_PIXEL * rows, HALF_TRACK_M + 0.25 - METRES_PER_PIXEL * columns
    cosine, sine = math.cos(0.08), math.sin(0.08)
    old_x, old_y = cosine * x_m - sine * y_m, sine * x_m + cosine * y_m
    map_row = (FIRST_X_M - old_x) / METRES_PER_PIXEL
    map_column = (HALF_TRACK_M + 0.25 - old_y) / METRES_PER_PIXEL
    predicted = cv2.remap(before, map_column.astype(np.float32), map_row.astype(np.float32), cv2.INTER_LINEAR)
    inside = (map_row > 1) & (map_row < 198) & (map_column > 1) & (map_column < 248)
    assert inside.mean() > 0.5
    pairs = [cv2.GaussianBlur(np.asarray(picture), (0, 0), 1.5) for picture in (predicted, after, before)]
    assert np.corrcoef(pairs[0][inside], pairs[1][inside])[0, 1] > 0.85
    assert np.corrcoef(pairs[2][inside], pairs[1][inside])[0, 1] < 0.5


def rut_picture(sun: Sun, rut: Rut, slip: float = 0.0, stride: int = 5) -> NDArray[np.float64]:
    """Return a straight rut and its surroundings from above, the wheel heading along the world's x."""
    of = rig()
    base = plan(14.0, slip=slip, start_yaw_rad=0.0)
    motion = drive(of, Terrain(), base, rut.depth_m)
    scene = make_scene(of, rut=rut, sun=sun)
    drive_scene(scene, motion, 1390, stride)
    return from_above(of, scene.render(motion.pose(1390)))


def test_the_wall_that_faces_the_sun_is_bright_and_the_one_that_hides_it_dark() -> None:
    rut = Rut(depth_m=0.016, berm_m=0.0, lug_m=0.0, tone=1.0)
    for azimuth, sign in ((90.0, 1), (-90.0, -1)):
        rows = rut_picture(Sun(azimuth_deg=azimuth, elevation_deg=40), rut).mean(axis=0)
        left, right = rows[125 - 30 : 125 - 18].mean(), rows[125 + 18 : 125 + 30].mean()
        # With the sun on the left its own wall lies in shadow.
        assert sign * (right - left) > 15


def test_a_wall_throws_its_shadow_onto_the_floor_as_far_as_the_sun_is_low() -> None:
    rut = Rut(depth_m=0.016, berm_m=0.0, lug_m=0.0, tone=1.0)
    for elevation_deg in (20.0, 30.0):
        rows = rut_picture(Sun(azimuth_deg=90, elevation_deg=elevation_deg), rut).mean(axis=0)
        lit = np.median(rows[125 + 5 : 125 + 15])
        dark = np.flatnonzero(rows[90:145] < 0.75 * lit) + 90
        # Columns go right from 0.25 m left of the wheel's middle, whose edge is 0.055 m left.
        reach_m = 0.055 - (0.25 - METRES_PER_PIXEL * dark.max())
        # Half the light is back where the sun stands 0.08, in the tangent, above the edge.
        expected_m = rut.depth_m / (math.tan(math.radians(elevation_deg)) + 0.08)
        assert reach_m == pytest.approx(expected_m, abs=0.006)


def test_lugs_leave_a_mark_every_pitch_that_slip_shortens() -> None:
    rut = Rut(depth_m=0.014, lug_m=0.005)
    for slip, stride in ((0.0, 5), (0.3, 5), (0.3, 90)):
        picture = rut_picture(Sun(azimuth_deg=0, elevation_deg=35), rut, slip, stride)
        floor = picture[:, 125 - 12 : 125 + 12].mean(axis=1)
        waves = floor - floor.mean()
        likeness = np.correlate(waves, waves, "full")[199:]
        spacing_m = METRES_PER_PIXEL * (8 + np.argmax(likeness[8:24]))
        pitch_m = 2 * math.pi * 0.092 / 18 * (1 - slip)
        assert spacing_m == pytest.approx(pitch_m, abs=0.0015)


def test_a_wheel_that_drifts_pushes_up_the_ground_on_the_side_it_drifts_to() -> None:
    rut = Rut(depth_m=0.014, berm_m=0.006)
    of = rig()
    rise = {}
    for drift in (0.0, 15.0, -15.0):
        motion = drive(of, Terrain(), plan(8.0, drift_deg=drift, start_yaw_rad=0.0), rut.depth_m)
        scene = make_scene(of, rut=rut)
        drive_scene(scene, motion, 700)
        maps = scene.ground.maps
        c = motion.contact_m[600]
        across = c[:2] + np.arange(-0.12, 0.12, 0.0015)[:, None] * np.array([0.0, 1.0])
        index = np.floor(across / maps.texel_m).astype(int) % maps.height.shape[0]
        profile = maps.height[index[:, 0], index[:, 1]]
        assert profile[75:85].mean() == pytest.approx(-0.014, abs=0.004)
        rise[drift] = profile[:40].max(), profile[-40:].max()
    assert rise[15.0][1] > 1.3 * rise[15.0][0]
    assert rise[-15.0][0] > 1.3 * rise[-15.0][1]
    assert rise[0.0][0] == pytest.approx(rise[0.0][1], abs=0.003)


def test_the_shadow_of_the_rover_stands_still_in_the_picture_and_is_where_the_sun_says() -> None:
    of = rig()
    plate = (-0.9, -0.6, HALF_TRACK_M - 0.1, HALF_TRACK_M + 0.1, 0.3, 0.301)
    sun = Sun(azimuth_deg=90.0, elevation_deg=60.0)
    lit, shaded = (
        RearScene(of, PLAIN_GROUND, sun, PAINT, NO_NOISE, np.random.default_rng(1), body=body)
        for body in ((), (plate,))
    )
    for x_m in (0.0, 0.05):
        pose = pose_at(x_m, 0.0, 0.0, PAINT.depth_m)
        dark = from_above(of, lit.render(pose)) - from_above(of, shaded.render(pose)) > 10
        rows, columns = np.nonzero(dark)
        y_m = HALF_TRACK_M + 0.25 - METRES_PER_PIXEL * columns
        # The sun stands on the left: the shadow falls to the right by height / tan(elevation).
        offset_m = 0.3 / math.tan(math.radians(60))
        assert y_m.max() == pytest.approx(HALF_TRACK_M + 0.1 - offset_m, abs=0.012)
        x_dark = FIRST_X_M - METRES_PER_PIXEL * rows
        assert x_dark.max() == pytest.approx(-0.6, abs=0.012)


def test_the_shadow_of_the_rover_falls_deeper_where_the_ground_is_deeper() -> None:
    of, depth_m = rig(), 0.02
    plate = (-0.2, 0.6, HALF_TRACK_M - 0.3, HALF_TRACK_M + 0.3, 0.3, 0.301)
    rut = Rut(depth_m=depth_m, berm_m=0.0, lug_m=0.0, wall_per_depth=0.5)
    motion = drive(of, Terrain(), plan(14.0, start_yaw_rad=0.0), depth_m)
    pictures = []
    for body in ((), (plate,)):
        sun = Sun(azimuth_deg=0, elevation_deg=40)
        scene = RearScene(of, PLAIN_GROUND, sun, rut, NO_NOISE, np.random.default_rng(1), body=body)
        drive_scene(scene, motion, 1390)
        image = scene.render(motion.pose(1390))
        pictures.append((from_above(of, image), from_above(of, image, depth_m)))
    changes = [lit - shaded for lit, shaded in zip(*pictures, strict=True)]
    floor, surface = (change > 0.5 * np.percentile(change, 90) for change in changes)
    for dark, columns, height_m in ((floor, slice(110, 140), 0.0), (surface, slice(20, 60), depth_m)):
        last_m = FIRST_X_M - METRES_PER_PIXEL * np.flatnonzero(dark[:, columns].mean(axis=1) > 0.5).max()
        expected_m = -0.2 - (0.3 - height_m) / math.tan(math.radians(40))
        assert last_m == pytest.approx(expected_m, abs=0.008)


def test_a_stone_throws_its_shadow_away_from_the_sun() -> None:
    of = rig()
    stones = replace(PLAIN_GROUND, stones_per_m2=30.0, stone_m=0.02)
    light = [
        make_scene(of, ground=stones, sun=Sun(azimuth_deg=azimuth, elevation_deg=35), seed=4)
        for azimuth in (90.0, -90.0)
    ]
    pictures = [from_above(of, scene.render(pose_at(depth_m=PAINT.depth_m))) for scene in light]
    dark = [picture < 0.65 * np.median(picture) for picture in pictures]
    assert all(shadow.sum() > 100 for shadow in dark)
    # With the sun on the left shadows lie farther to the right (columns go right) than with it on the right.
    blobs = [cv2.connectedComponentsWithStats(shadow.astype(np.uint8))[3][1:] for shadow in dark]
    nearest = [blobs[1][np.argmin(np.linalg.norm(blobs[1] - blob, axis=1))] - blob for blob in blobs[0]]
    assert np.median(nearest, axis=0)[0] < -3


def test_a_far_pole_darkens_a_band_of_the_world() -> None:
    of = rig()
    band = Sun(azimuth_deg=30, elevation_deg=50, bands=((0.0, -B_M - 0.3, 0.04, 0.005),))
    scene, plain = make_scene(of, sun=band), make_scene(of, sun=replace(band, bands=()))
    pose = pose_at(depth_m=PAINT.depth_m)
    change = from_above(of, plain.render(pose)) - from_above(of, scene.render(pose))
    dark_m = FIRST_X_M - METRES_PER_PIXEL * np.flatnonzero(change.mean(axis=1) > 20)
    assert (dark_m.min(), dark_m.max()) == pytest.approx((-B_M - 0.34, -B_M - 0.26), abs=0.012)


def test_exposure_scales_the_light() -> None:
    scene = make_scene(rig())
    pose = pose_at(depth_m=PAINT.depth_m)
    means = [grey(scene.render(pose, gain))[:200].mean() for gain in (0.0, 0.5, 1.0, 6.0)]
    assert means[0] == 0
    assert means[1] / means[2] == pytest.approx(0.5**NO_NOISE.gamma, rel=0.03)
    assert means[3] > 250


def test_noise_has_its_size_and_differs_from_frame_to_frame() -> None:
    lens = replace(NO_NOISE, noise_grey=4.0)
    scene = RearScene(rig(), PLAIN_GROUND, HIGH_SUN, PAINT, lens, np.random.default_rng(2))
    first, second = (scene.render(pose_at(depth_m=PAINT.depth_m))[:200].astype(float) for _ in range(2))
    assert (first - second).std() == pytest.approx(4 * math.sqrt(2), rel=0.1)


def test_motion_blur_spreads_a_point_over_its_way() -> None:
    kernel = blur_kernel(np.array([6.0, 0.0]), 0.8)
    half = kernel.shape[0] // 2
    rows, columns = np.mgrid[-half : half + 1, -half : half + 1]
    assert kernel.sum() == pytest.approx(1)
    assert (kernel * rows**2).sum() == pytest.approx(0.8**2, rel=0.05)
    assert (kernel * columns**2).sum() == pytest.approx(0.8**2 + 6.0**2 / 12, rel=0.3)


def test_fast_motion_blurs_across_its_direction() -> None:
    of = rig()
    lens = replace(NO_NOISE, exposure_s=0.05)
    scene = RearScene(of, PLAIN_GROUND, Sun(), PAINT, lens, np.random.default_rng(2))
    still = pose_at(depth_m=PAINT.depth_m)
    sharp = grey(scene.render(still))
    blurred = grey(scene.render(replace(still, velocity_m_s=(0.3, 0.0))))
    down, across = (
        np.abs(np.diff(blurred, axis=k)).mean() / np.abs(np.diff(sharp, axis=k)).mean() for k in (0, 1)
    )
    assert down < 0.75 * across


def test_the_map_is_the_same_whichever_way_one_came() -> None:
    direct, around = make_scene(rig(), seed=7), make_scene(rig(), seed=7)
    for x_m in (4.0, 8.0, -3.0):
        around.render(pose_at(x_m, 1.0, 0.5, PAINT.depth_m))
    pose = pose_at(20.0, -7.0, 1.0, PAINT.depth_m)
    assert np.abs(grey(direct.render(pose)) - grey(around.render(pose))).max() <= 1


def test_rocking_carries_the_camera_with_the_body() -> None:
    of = rig()
    body = Rotation.from_euler("YX", [1.0, -0.7], degrees=True)
    leaning = replace(
        of, camera_m=body.apply(of.camera_m), vehicle_from_camera=body.as_matrix() @ of.vehicle_from_camera
    )
    points = np.array([[-0.7, 0.2, 0.0], [-0.5, 0.4, 0.01]])
    rock = rocking(math.radians(-0.7), math.radians(1.0))
    assert of.project(points @ rock) == pytest.approx(leaning.project(points))
    assert of.project(points @ rock)[0, 1] > of.project(points)[0, 1] + 3


def test_looking_changes_nothing() -> None:
    of, rut = rig(), Rut(depth_m=0.016)
    motion = drive(of, Terrain(), plan(10.0, drift_deg=6.0, yaw_rate_dps=1.0), rut.depth_m)
    often, once = (make_scene(of, rut=rut, sun=Sun(azimuth_deg=100, elevation_deg=35)) for _ in range(2))
    for first in range(0, 890, 80):
        for step in range(first, first + 80, 5):
            often.drive(motion.pose(step))
            once.drive(motion.pose(step))
        often.render(motion.pose(first + 75))
    last = motion.pose(960)
    difference = np.abs(grey(often.render(last)) - grey(once.render(last)))
    assert difference.max() <= 3
    assert grey(once.render(last)).std() > 10
