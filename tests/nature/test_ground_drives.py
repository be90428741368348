"""Rendered drives over ground: the truth is that of the pictures; light and prints obey their geometry."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.nature import ground_drives
from tests.nature.ground_drives import SCENES, Renderer, render
from tests.nature.ground_drives.camera import HEIGHT, WIDTH, draw_rig
from tests.nature.ground_drives.draw import World, draw_world
from tests.nature.ground_drives.ground import Ground, Terrain
from tests.nature.ground_drives.light import Box, ShadowPlane, Sun, self_shadow, shade
from tests.nature.ground_drives.noise import Points
from tests.nature.ground_drives.rut import Pass, Strength, Tread, print_pass

pytestmark = pytest.mark.nightly  # a truth generator, which no change of the program touches

FOLDER = Path(ground_drives.__file__).parent
TREAD = Tread(width_m=0.11, pitch_m=0.024)
STRENGTH = Strength(
    depth_m=0.012, berm_m=0.005, grouser_m=0.004, tone=-0.3, berm_tone=0.0, smooth=0.8, lumps_m=0.0005
)


def _flat(rows: int = 300, columns: int = 400, cell_m: float = 0.002) -> Ground:
    return Ground(
        cell_m,
        (0.0, 0.0),
        np.zeros((rows, columns), np.float32),
        np.full((rows, columns, 3), 0.3, np.float32),
    )


def _sun(elevation_deg: float, azimuth_deg: float) -> Sun:
    elevation, azimuth = np.radians((elevation_deg, azimuth_deg))
    return Sun(float(elevation), float(azimuth), np.ones(3), np.full(3, 0.2), 0.0, 0.0)


def _straight_pass(slip: float = 0.0, slip_angle_rad: float = 0.0) -> Pass:
    x = np.arange(0.1, 0.7, 0.001)
    zero = np.zeros(len(x))
    return Pass(np.column_stack((x, zero + 0.3)), zero, zero - slip_angle_rad, x / (1.0 - slip), zero + 1.0)


def _blank(world: World) -> World:
    """Return the drive over flat grey ground, without tilt, clouds and moving shadows."""
    motion, still = world.motion, np.zeros_like(world.motion.x)
    ground = replace(
        world.ground,
        height=np.zeros_like(world.ground.height),
        albedo=np.full_like(world.ground.albedo, 0.3),
    )
    return replace(
        world,
        ground=ground,
        motion=replace(motion, roll_rad=still, pitch_rad=still, level_m=still, heading_rad=still),
        terrain=Terrain(np.zeros((0, 4))),
        shadows=replace(world.shadows, passing=(), foliage=()),
        cloud=np.ones_like(world.cloud),
    )


def test_the_same_seed_gives_the_same_files_and_another_seed_others(tmp_path: Path) -> None:
    for name, seed in (("first", 4), ("again", 4), ("other", 5)):
        render("own_hard_shadow", seed, 3, tmp_path / name)
    files = sorted(p.relative_to(tmp_path / "first") for p in (tmp_path / "first").rglob("*.*"))
    assert len(files) == 6
    for file in files:
        content = (tmp_path / "first" / file).read_bytes()
        assert (tmp_path / "again" / file).read_bytes() == content
        assert (tmp_path / "other" / file).read_bytes() != content


def test_files_have_the_columns_and_keys_of_the_format(tmp_path: Path) -> None:
    render("own_easy", 1, 2, tmp_path)
    with (tmp_path / "telemetry.csv").open(encoding="utf-8") as file:
        head = next(csv.reader(file))
    assert head == [
        "frame",
        "t",
        "wheel_speed_mps",
        "compass_deg",
        "gyro_roll_dps",
        "gyro_pitch_dps",
        "gyro_yaw_dps",
    ]
    with (tmp_path / "truth.csv").open(encoding="utf-8") as file:
        head = next(csv.reader(file))
    expected = "frame t present visible_len_m theta_t_deg d_t_m theta_chord_deg beta_deg slip x y psi_deg"
    assert head == expected.split()
    rig = json.loads((tmp_path / "rig.json").read_text("utf-8"))
    assert rig["schema"] == "rear-camera-rig/1"
    rotation = np.asarray(rig["R_vehicle_camera"])
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    picture = cv2.imread(str(tmp_path / "frames" / "000001.jpg"))
    assert picture is not None
    assert picture.shape == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_shows_what_its_name_says(scene: str) -> None:
    renderer = Renderer(scene, 11, 20)
    frame = next(renderer.frames())
    assert 25 < float(frame.picture.mean()) < 245
    assert float(frame.picture.std()) > 4
    last = renderer.truth(float(renderer.world.times_s[-1]))
    if scene.startswith("bare_"):
        assert not frame.printing
        assert (last.present, last.visible_len_m) == (0, 0.0)
    elif scene != "own_appears":
        assert frame.printing
        assert last.visible_len_m > 0.0


@pytest.mark.parametrize("scene", ["own_curved", "own_mounds", "own_appears"])
def test_points_of_the_wheel_path_are_seen_at_the_pixels_of_the_truth(scene: str) -> None:
    world = draw_world(scene, 3, 40)
    flat = replace(world.ground, height=np.zeros_like(world.ground.height))
    renderer = Renderer(scene, 3, 40, replace(world, ground=flat))
    time_s = float(world.times_s[-1])
    local, seen = renderer.visible_trace(time_s)
    assert seen.any()
    pixel = world.rig.pixels(local)[0][seen]
    x, y, z = renderer.seen_ground(time_s)
    count = len(local)
    path = world.motion.contact(world.rig.contact)[:count][seen]
    column, row = np.round(pixel).astype(int).T
    # Half a pixel is 0.6 mm on the ground.
    assert np.abs(x[row, column] - path[:, 0]).max() < 0.0025
    assert np.abs(y[row, column] - path[:, 1]).max() < 0.0025
    assert np.abs(z[row, column] - world.terrain.height_m(path[:, 0], path[:, 1])).max() < 0.001


def test_visible_length_is_the_length_of_path_on_ground_that_some_pixel_sees() -> None:
    renderer = Renderer("own_curved", 6, 60)
    world = renderer.world
    for number in (5, 30, 59):
        time_s = float(world.times_s[number])
        truth = renderer.truth(time_s)
        x, y, _ = renderer.seen_ground(time_s)
        # The border of the picture on the ground, as a polygon.
        ground = np.dstack((x, y))
        border = np.concatenate((ground[0], ground[:, -1], ground[-1, ::-1], ground[::-1, 0]))
        path = world.motion.contact(world.rig.contact)
        path = path[world.motion.time_s <= time_s].astype(np.float32)
        inside = np.asarray(
            [cv2.pointPolygonTest(border, (float(p[0]), float(p[1])), False) > 0 for p in path]
        )
        length = float(np.hypot(*np.diff(path, axis=0).T)[inside[1:]].sum())
        assert truth.visible_len_m == pytest.approx(length, abs=0.012)
        assert truth.present == (truth.visible_len_m >= 0.2)
        assert np.isnan(truth.theta_chord_deg) == (not truth.present)


def test_truth_angles_are_those_of_the_driven_path() -> None:
    renderer = Renderer("own_curved", 2, 30)
    before, now, after = (renderer.truth(4.0 + step) for step in (-0.05, 0.0, 0.05))
    contact = np.asarray(renderer.rig.contact)

    def wheel(x: float, y: float, psi_deg: float) -> Points:
        psi = np.radians(psi_deg)
        turn = np.asarray(((np.cos(psi), -np.sin(psi)), (np.sin(psi), np.cos(psi))))
        return np.asarray(turn @ contact + (x, y), np.float64)

    moved = wheel(after.x, after.y, after.psi_deg) - wheel(before.x, before.y, before.psi_deg)
    direction = np.degrees(np.arctan2(moved[1], moved[0])) - now.psi_deg
    assert now.theta_t_deg == pytest.approx(direction, abs=0.05)
    body = np.degrees(np.arctan2(after.y - before.y, after.x - before.x)) - now.psi_deg
    assert now.beta_deg == pytest.approx(body, abs=0.05)
    theta = np.radians(now.theta_t_deg)
    along = np.asarray((np.cos(theta), np.sin(theta)))
    foot = contact - along * float(contact @ along)
    assert abs(now.d_t_m) == pytest.approx(float(np.hypot(*foot)), abs=1e-9)


def test_sensors_measure_the_motion() -> None:
    renderer = Renderer("own_curved", 8, 40)
    times = renderer.world.times_s
    truths = [renderer.truth(float(time_s)) for time_s in times]
    turned = np.trapezoid([row.gyro_yaw_dps for row in renderer.measured], times)
    duration = float(times[-1])
    assert turned == pytest.approx(truths[-1].psi_deg - truths[0].psi_deg, abs=0.3 * duration)
    measured = np.asarray([row.wheel_speed_mps for row in renderer.measured])
    way = np.hypot(*np.diff([(truth.x, truth.y) for truth in truths], axis=0).T)
    slip = float(np.mean([truth.slip for truth in truths]))
    beta = np.radians(np.mean([truth.beta_deg for truth in truths]))
    expected = float(way.sum()) / duration * np.cos(beta) / (1.0 - slip)
    assert float(measured.mean()) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("scene", ["own_jpeg60_blur", "own_mounds", "own_curved"])
def test_the_camera_never_sees_ground_that_the_observed_wheel_has_not_passed(scene: str) -> None:
    # All prints are pressed before the first frame: this is the reason why that is no error.
    for seed in range(2):
        renderer = Renderer(scene, seed, 10)
        for time_s in renderer.world.times_s[::4]:
            x, y, _ = renderer.seen_ground(float(time_s))
            x0, y0, heading = renderer.pose(float(time_s))
            ahead = np.cos(heading) * (x - x0) + np.sin(heading) * (y - y0)
            assert float(ahead.max()) < renderer.rig.contact[0] - 0.5 * TREAD.contact_m


def test_a_print_is_centred_on_the_path_as_wide_as_the_wheel_and_wider_when_it_slides() -> None:
    widths = []
    for angle in (0.0, 0.3):
        edges = []
        for seed in range(4):
            ground = _flat()
            print_pass(
                np.random.default_rng(seed), ground, _straight_pass(slip_angle_rad=angle), TREAD, STRENGTH
            )
            depth = -ground.height[:, 100:300].mean(axis=1)
            edges.append(0.002 * np.flatnonzero(depth > 0.5 * depth.max())[[0, -1]])
        low, high = np.mean(edges, axis=0)
        # Soil that falls in from the higher berm moves the middle by 1 to 2 mm when the wheel slides.
        assert 0.5 * (low + high) == pytest.approx(0.3, abs=0.0025)
        widths.append(float(high - low))
    assert widths[0] == pytest.approx(0.11, abs=0.008)
    assert widths[1] > widths[0] + 0.005


@pytest.mark.parametrize("slip", [0.0, 0.3])
def test_bars_stand_closer_on_the_ground_when_the_wheel_slips(slip: float) -> None:
    ground = _flat()
    print_pass(np.random.default_rng(1), ground, _straight_pass(slip), TREAD, STRENGTH)
    floor = ground.height[135:165, 60:340].mean(axis=0)
    power = np.abs(np.fft.rfft(floor - floor.mean(), 8192))[100:]
    pitch_m = 0.002 * 8192 / (100 + int(power.argmax()))
    assert pitch_m == pytest.approx(0.024 * (1.0 - slip), rel=0.03)


def test_bars_lie_along_the_axle_of_a_wheel_that_slides() -> None:
    ground = _flat()
    print_pass(np.random.default_rng(1), ground, _straight_pass(0.3, slip_angle_rad=0.3), TREAD, STRENGTH)
    pitch_m = 0.024 * 0.7
    x = 0.002 * np.arange(60, 340)
    phases = []
    for row in (140, 160):  # 0.02 m to the right and to the left of the path
        floor = ground.height[row - 2 : row + 3, 60:340].mean(axis=0)
        phases.append(np.angle(np.sum((floor - floor.mean()) * np.exp(-2j * np.pi * x / pitch_m))))
    moved = np.angle(np.exp(1j * (phases[1] - phases[0])))
    expected = np.angle(np.exp(-2j * np.pi * 0.04 * np.tan(0.3) / pitch_m))
    assert np.angle(np.exp(1j * (moved - expected))) == pytest.approx(0.0, abs=0.4)


def test_hard_ground_takes_no_print() -> None:
    ground = _flat()
    path = _straight_pass()
    print_pass(np.random.default_rng(1), ground, replace(path, softness=0.0 * path.rim_m), TREAD, STRENGTH)
    assert np.abs(ground.height).max() < 1e-6
    assert np.abs(ground.albedo - 0.3).max() < 1e-6


@pytest.mark.parametrize("elevation_deg", [20.0, 45.0])
def test_a_wall_casts_its_shadow_away_from_the_sun(elevation_deg: float) -> None:
    height = np.zeros((40, 400), np.float32)
    height[:, 200:205] = 0.06
    hidden = self_shadow(height, 0.002, _sun(elevation_deg, 0.0))[20]  # the sun stands along +x, columns
    assert hidden[206:].max() == 0.0
    length = 0.002 * float(hidden[:200].sum())
    assert length == pytest.approx(0.06 / np.tan(np.radians(elevation_deg)), abs=0.008)


def test_slopes_that_face_the_sun_are_brighter() -> None:
    ground = _flat()
    ground.height[:] = 0.1 * 0.002 * np.abs(np.arange(400) - 200)  # a valley: the right side rises to +x
    light = shade(ground, Terrain(np.zeros((0, 4))), _sun(40.0, 180.0))
    slope = np.arctan(0.1)
    assert float(light[150, 300, 0]) == pytest.approx(np.sin(np.radians(40.0) + slope), abs=0.01)
    assert float(light[150, 100, 0]) == pytest.approx(np.sin(np.radians(40.0) - slope), abs=0.01)


def test_the_shadow_of_a_part_lies_where_the_sun_puts_it() -> None:
    plane = ShadowPlane(parts=(Box((-0.4, 0.2, 0.5), (0.05, 0.05, 0.005)),))
    light = plane.transmission(_sun(45.0, 0.0), (3.0, 2.0, 0.0), np.eye(3), 0.0)
    row, column = np.nonzero(light < 0.5)
    x = plane.left_back[0] + plane.cell_m * float(column.mean())
    y = plane.left_back[1] + plane.cell_m * float(row.mean())
    assert (x, y) == pytest.approx((-0.9, 0.2), abs=0.005)


def test_the_rovers_own_shadow_stays_in_the_picture_while_the_rover_moves() -> None:
    world = _blank(draw_world("bare_shadow", 2, 40))
    bare = replace(world, shadows=replace(world.shadows, parts=()))
    renderer = Renderer("bare_shadow", 2, 40, world)
    first, second = renderer.light(0.5), renderer.light(6.0)
    assert np.abs(first - second).max() < 0.02 * float(first.max())
    # It is dark where the part of the ground that a pixel sees, in the rover's frame, lies in shadow.
    dark = first.mean(axis=2) < 0.6 * Renderer("bare_shadow", 2, 40, bare).light(0.5).mean(axis=2)
    plane, rig = world.shadows, world.rig
    expected = plane.transmission(world.sun, (0.0, 0.0, 0.0), np.eye(3), 0.0) < 0.55
    rows, columns = np.mgrid[0:HEIGHT:4, 0:WIDTH:4]
    rays = rig.rays(columns.ravel().astype(np.float64), rows.ravel().astype(np.float64))
    ground = rig.position[:2] + rays[:, :2] * (rig.position[2] / -rays[:, 2:])
    column, row = np.round((ground - plane.left_back) / plane.cell_m).astype(int).T
    assert 0.05 < float(dark.mean()) < 0.95
    assert float((expected[row, column] == dark[::4, ::4].ravel()).mean()) > 0.98


def test_the_rovers_own_shadow_turns_in_the_picture_when_the_rover_turns() -> None:
    world = draw_world("bare_shadow", 2, 10)
    masks = [world.shadows.transmission(world.sun, (0.0, 0.0, turn), np.eye(3), -1e6) for turn in (0.0, 0.2)]
    assert np.abs(masks[0] - masks[1]).mean() > 0.01


def test_ground_and_trace_move_through_the_picture_as_the_pose_says() -> None:
    world = draw_world("own_easy", 5, 40)
    world = replace(world, shadows=replace(world.shadows, parts=(), passing=(), foliage=()))
    renderer = Renderer("own_easy", 5, 40, world)
    x, y = (v[150:330:3, 200:440:3].ravel() for v in renderer.seen_ground(4.0)[:2])
    level = world.motion.at(world.motion.level_m, 4.0)
    patches = []
    for time_s in (4.0, 5.0):
        x0, y0, _ = renderer.pose(time_s)
        local = np.column_stack((x - x0, y - y0, np.zeros(len(x)) - level)) @ renderer.orientation(time_s)
        pixel, seen = renderer.rig.pixels(local)
        values = renderer.light(time_s).mean(axis=2)
        column, row = pixel.astype(np.float32).T
        patches.append((cv2.remap(values, column, row, cv2.INTER_LINEAR).ravel(), seen))
    both = patches[0][1] & patches[1][1]
    assert both.mean() > 0.5
    assert np.corrcoef(patches[0][0][both], patches[1][0][both])[0, 1] > 0.9
    # The same pixels show other ground: it is not the picture that stands still.
    first, second = (renderer.light(t).mean(axis=2)[150:330, 200:440].ravel() for t in (4.0, 5.0))
    assert np.corrcoef(first, second)[0, 1] < 0.8


def test_a_trace_that_appears_begins_and_ends_within_the_drive() -> None:
    renderer = Renderer("own_appears", 1, 120)
    lengths = [renderer.truth(float(t)).visible_len_m for t in renderer.world.times_s[::10]]
    assert lengths[0] == 0.0
    assert max(lengths) > 0.3


def test_drawn_rigs_see_the_trace_of_their_wheel() -> None:
    for seed in range(20):
        rig = draw_rig(np.random.default_rng(seed), 0.08)
        behind = np.column_stack((np.linspace(-0.9, -0.4, 51), np.full(51, rig.contact[1]), np.zeros(51)))
        assert 0.01 * rig.pixels(behind)[1].sum() > 0.2


def test_nothing_here_imports_the_product() -> None:
    for path in FOLDER.glob("*.py"):
        text = path.read_text("utf-8")
        for package in (
            "rover_hil",
            "sim_backends",
            "controllers",
            "drivers",
            "tests.nature.trace",
            "benchmarks",
        ):
            assert f"import {package}" not in text, path
            assert f"from {package}" not in text, path
