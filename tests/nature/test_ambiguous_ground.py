import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.nature.ambiguous_ground.bodies import Wheel
from tests.nature.ambiguous_ground.camera import WHEEL_CONTACT, Camera
from tests.nature.ambiguous_ground.cases import CASES, prepare
from tests.nature.ambiguous_ground.drive_files import write
from tests.nature.ambiguous_ground.ground import Cloth, GroundView, sub_pixels
from tests.nature.ambiguous_ground.motion import Motion, Pose, integrate
from tests.nature.ambiguous_ground.optics import Specks
from tests.nature.ambiguous_ground.picture import Frame, Picture
from tests.nature.ambiguous_ground.recipe import pictures
from tests.nature.ambiguous_ground.relief import ReliefView, mounds
from tests.nature.ambiguous_ground.stream import Repeats, Swapped, mirrored

CAMERA = Camera(300.0, (159.5, 119.5), (0.0, 0.0), 50.0, 0.0, 0.0, (-0.3, 0.1, 0.5))


def marker_view(x: float, y: float) -> GroundView:
    """A ground of 2 m, black but for a soft marker at this point of the world."""
    v, u = np.mgrid[0:1000, 0:1000].astype(np.float32)
    column, row = (x + 1.0) / 0.002, (y + 1.0) / 0.002
    texture = np.exp(-((u - column) ** 2 + (v - row) ** 2) / (2 * 3.0**2)).astype(np.float32)
    return GroundView(CAMERA, Cloth(texture, 0.002, 0.0, (500.0, 500.0)))


def centre(picture: Picture) -> tuple[float, float]:
    v, u = np.mgrid[0:240, 0:320]
    weight = picture.astype(np.float64)
    return float((u * weight).sum() / weight.sum()), float((v * weight).sum() / weight.sum())


def by_hand(x: float, y: float, z: float = 0.0) -> tuple[float, float]:
    """The pixel of a point of the ground in the vehicle frame, for a camera that looks straight back."""
    back, left, down = -0.3 - x, y - 0.1, 0.5 - z
    c, s = np.cos(np.radians(50.0)), np.sin(np.radians(50.0))
    depth = back * c + down * s
    return 159.5 + 300.0 * left / depth, 119.5 + 300.0 * (down * c - back * s) / depth


@pytest.fixture(scope="module")
def drive() -> Motion:
    n = 12
    slip = np.linspace(0.1, 0.5, n)
    theta, turn = np.radians(np.linspace(-3.0, 4.0, n)), np.full(n, np.radians(1.5))
    return integrate(10.0, np.full(n, 0.03), slip, theta, turn, 0.2)


@pytest.mark.parametrize(("x", "y"), [(-0.72, 0.1), (-0.9, 0.25), (-0.6, -0.03)])
def test_marker_lands_where_a_pinhole_sees_it(x: float, y: float) -> None:
    seen = centre(marker_view(x, y).see(Pose(0.0, 0.0, 0.0)))
    assert seen == pytest.approx(by_hand(x, y), abs=0.15)


def test_marker_on_ground_that_curves_lies_below_the_plane_and_twisted_ground_beside_it() -> None:
    view = marker_view(-0.72, 0.1)
    view.curvature, view.twist = 0.04, 0.02
    height = -0.5 * 0.04 * 0.72**2 - 0.02 * 0.72 * 0.1
    seen = centre(view.see(Pose(0.0, 0.0, 0.0)))
    assert seen == pytest.approx(by_hand(-0.72, 0.1, height), abs=0.3)
    assert seen != pytest.approx(by_hand(-0.72, 0.1), abs=1.0)


def test_marker_moves_as_truth_says(drive: Motion) -> None:
    view = marker_view(-0.6, -0.1)
    for i in range(12):
        x, y, psi = drive.x[i], drive.y[i], drive.psi[i]
        dx, dy = -0.6 - x, -0.1 - y
        around = np.cos(psi) * dx + np.sin(psi) * dy, -np.sin(psi) * dx + np.cos(psi) * dy
        assert centre(view.see(drive.pose(i))) == pytest.approx(by_hand(*around), abs=0.15)


def test_slip_and_angle_are_those_of_the_watched_wheel(drive: Motion) -> None:
    c, s = np.cos(drive.psi), np.sin(drive.psi)
    x = drive.x + c * WHEEL_CONTACT[0] - s * WHEEL_CONTACT[1]
    y = drive.y + s * WHEEL_CONTACT[0] + c * WHEEL_CONTACT[1]
    middle = drive.psi[1:] - 0.5 * drive.turn[1:]
    along = np.cos(middle) * np.diff(x) + np.sin(middle) * np.diff(y)
    left = -np.sin(middle) * np.diff(x) + np.cos(middle) * np.diff(y)
    np.testing.assert_allclose(1.0 - along / drive.wheel[1:], drive.slip[1:], atol=1e-3)
    np.testing.assert_allclose(np.arctan2(left, along), drive.theta[1:], atol=1e-3)


def test_projection_is_that_of_opencv() -> None:
    camera = Camera(310.0, (161.0, 118.0), (-0.08, 0.02), 55.0, 4.0, -2.0, (-0.35, 0.2, 0.6))
    points = np.array([[-0.7, 0.1, 0.0], [-0.9, 0.5, 0.05], [-0.5, 0.2, -0.1]])
    rig = camera.rig(10.0, 0.1)
    turn, matrix = np.array(rig["R_vehicle_camera"]), np.array(rig["camera_matrix"])
    shift = -turn.T @ np.array(rig["t_vehicle_camera"])
    values = np.array(rig["dist_coeffs"]["values"])
    expected = cv2.projectPoints(points, cv2.Rodrigues(turn.T)[0], shift, matrix, values)[0].reshape(-1, 2)
    pixels = camera.project(points)
    np.testing.assert_allclose(pixels, expected, atol=1e-6)
    ground = camera.on_plane(pixels[:1, 0], pixels[:1, 1])
    np.testing.assert_allclose(ground, points[:1, :2], atol=1e-6)


def test_rays_meet_mounds_where_they_are_seen() -> None:
    rng = np.random.default_rng(3)
    ground = mounds(rng, 0.04, 0.4)
    cloth = Cloth(np.zeros((64, 64), np.float32), 0.01)
    camera = Camera(260.0, (160.0, 120.0), (0.0, 0.0), 52.0, 0.0, 0.0, (-0.3, 0.1, 0.5))
    x, y, z = ReliefView(camera, cloth, ground, np.array([0.5, 0.0, 0.8]), 5.0).meets(Pose(0.0, 0.0, 0.0))
    assert np.ptp(z) > 0.01
    assert np.abs(ground.at(x, y) - z).max() < 2e-4
    u, v = sub_pixels()
    met = np.stack([x, y, z], axis=-1).astype(np.float64)
    pixels = camera.project(met.reshape(-1, 3))
    assert np.abs(pixels - np.stack([u, v], axis=-1).reshape(-1, 2)).max() < 0.01


def test_top_of_a_wheel_moves_towards_the_camera() -> None:
    wheel = Wheel(CAMERA, 0.08, -0.6, 0.2, 1.0)
    v, _ = np.mgrid[0:512, 0:512]
    mark = np.where(np.abs(v - 40) < 8, 255.0, 0.0).astype(np.float32)
    black = np.zeros((240, 320), np.float32)
    rows = []
    for turned in (-0.4, -0.2):
        painted = wheel.paint(black, turned, mark) * (np.arange(320) > 260)
        rows.append(centre(np.where(painted > 120.0, painted, 0.0).astype(np.float32))[1])
    assert rows[1] > rows[0] + 5.0


def test_repeats_keep_the_noise() -> None:
    recipe = prepare("repeats", 1, 8)
    recipe.stands = True
    fresh = recipe.stream.pop()
    frames = pictures(recipe)
    assert isinstance(fresh, Repeats)
    out = Repeats([False, True] * 4, 90, 90)(frames)

    def change(a: Frame, b: Frame) -> float:
        return float((a.astype(float) - b).std())

    noise = np.sqrt(2.0) * recipe.noise
    assert max(change(out[i], out[i + 1]) for i in (0, 2, 4)) < 0.4 * noise
    assert min(change(out[i], out[i + 1]) for i in (1, 3, 5)) > 0.8 * noise


def test_pairs_are_swapped() -> None:
    frames = [np.full((2, 2), i, np.uint8) for i in range(5)]
    assert [int(f[0, 0]) for f in Swapped([True, False])(frames)] == [1, 0, 2, 3, 4]


def test_specks_stay_while_the_ground_moves() -> None:
    recipe = prepare("dirt_arrives", 0, 24)
    specks = next(layer for layer in recipe.lens if isinstance(layer, Specks))
    frames = [f.astype(float) for f in pictures(recipe)]
    covered, bare = specks.cover > 0.85, specks.cover < 0.01
    changes = np.abs(frames[23] - frames[21])
    assert changes[covered].mean() < 0.5 * changes[bare].mean()
    arrived = np.abs(frames[20] - frames[19])
    assert arrived[covered].mean() > 2.0 * arrived[bare].mean()


def test_wheels_spin_while_a_stuck_rover_stands() -> None:
    motion = prepare("stuck_clean", 2, 40).motion
    assert motion.slip[24] < 0.7
    assert (motion.slip[33:] == 1.0).all()
    assert np.ptp(motion.x[33:]) == np.ptp(motion.psi[33:]) == 0.0
    assert motion.wheel[33:].min() > 0.0


def test_a_rotation_on_the_spot_is_about_its_centre() -> None:
    recipe = prepare("spot_right", 1, 60)
    assert recipe.rotation is not None
    assert recipe.centre is not None
    motion, (start, length, degrees) = recipe.motion, recipe.rotation
    turned = np.degrees(motion.psi[start + length - 1] - motion.psi[start - 1])
    assert turned == pytest.approx(degrees)
    x, y = recipe.centre
    c, s = np.cos(motion.psi), np.sin(motion.psi)
    centre = np.stack([motion.x + c * x - s * y, motion.y + s * x + c * y])[:, start - 1 : start + length]
    assert np.ptp(centre, axis=1).max() < 1e-3
    assert motion.travel[start - 1] < 0.2 * motion.travel[: start - 8].mean()


def test_same_draw_gives_same_pictures() -> None:
    first, again = (np.array(pictures(prepare("clean", 4, 3))) for _ in range(2))
    assert (first == again).all()
    assert (first != np.array(pictures(prepare("clean", 5, 3)))).any()


def test_mirrored_is_flipped() -> None:
    recipe, unchanged = prepare("mirrored", 0, 2), prepare("mirrored", 0, 2)
    assert recipe.stream == [mirrored]
    unchanged.stream.clear()
    for seen, plain in zip(pictures(recipe), pictures(unchanged), strict=True):
        assert (seen[:, ::-1] == plain).all()


def test_rig_file_of_a_wrong_mounting_is_wrong(tmp_path: Path) -> None:
    recipe = prepare("height_low", 0, 2)
    write(recipe, tmp_path)
    rig = json.loads((tmp_path / "rig.json").read_text())
    assert recipe.camera.position[2] == pytest.approx(0.9 * rig["t_vehicle_camera"][2])
    assert len(list((tmp_path / "frames").iterdir())) == 5
    with (tmp_path / "truth.csv").open() as file:
        truth = list(csv.DictReader(file))
    assert float(truth[-1]["x"]) == pytest.approx(recipe.motion.x[-1], abs=1e-6)
    assert json.loads((tmp_path / "scene.json").read_text())["look"] == "height_low"


@pytest.mark.nightly
@pytest.mark.parametrize("case", CASES)
def test_every_case_renders(case: str) -> None:
    for draw in range(10):
        recipe = prepare(case, draw, 4)
        frames = pictures(recipe)
        assert len(frames) == recipe.frames
        assert all(f.shape == (240, 320) and f.dtype == np.uint8 for f in frames)
