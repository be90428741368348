import math
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from tests.nature.trace_drive import RATE_HZ, SETS, Drive, Floats, hides, rocked, turned
from tests.nature.trace_rut import LOOKS, RutLook
from tests.nature.trace_scene import Picture, TraceScene
from tests.nature.trace_sets import make_drive


def seen_from_above(drive: Drive, picture: Picture, step: int, world_m: Floats) -> Floats:
    """Return grey at world places: projected into the picture, where the scene casts rays out of it."""
    motion = drive.motion
    local = turned(world_m - motion.origin_m[step], np.full(len(world_m), -motion.yaw_rad[step]))
    pixels = drive.camera.pixels(np.insert(local, 2, 0.0, axis=1) @ rocked(*motion.rock_rad[step]))
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.float32)
    column, row = pixels.astype(np.float32).T[:, None]
    return np.asarray(cv2.remap(grey, column, row, cv2.INTER_LINEAR)[0], np.float64)


@pytest.mark.parametrize("name", SETS)
def test_the_angle_is_where_the_wheel_goes_against_its_axis(name: str) -> None:
    drive = make_drive(name, 3, 20.0 if name != "sparse" else 60.0)
    wheel = drive.wheels[0]
    way = drive.motion.wheel_way(wheel)
    for step, row in list(zip(drive.steps, drive.truth(), strict=True))[1:-1]:
        ahead = way[step + 1] - way[step - 1]
        axis = drive.motion.yaw_rad[step] + wheel.steer_rad
        off = math.degrees(math.atan2(*ahead[::-1]) - axis) - row.theta_deg
        assert math.remainder(off, 360) == pytest.approx(0, abs=0.05)


def test_the_gyro_turns_as_the_heading_does() -> None:
    drive = make_drive("curved", 1)
    heading = np.degrees(drive.motion.yaw_rad[list(drive.steps)])
    told = np.array([row.gyro_yaw_dps for row in drive.telemetry()])
    error = (told[1:] + told[:-1]) / 2 - np.diff(heading) * drive.frames_hz
    assert np.ptp(heading) > 1.0
    assert np.std(error) < 0.15
    assert abs(np.mean(error)) < 0.6


def test_ground_stays_where_it_is_while_the_camera_moves_over_it() -> None:
    drive = make_drive("curved", 3)
    scene = TraceScene(drive, "dark")
    first, last = drive.steps[40], drive.steps[47]
    side = np.arange(0.0, 0.2, 0.002)
    wheel = drive.wheels[0]
    corner = drive.motion.origin_m[first] + turned(
        np.array([wheel.x_m - 0.35, wheel.y_m + 0.10]), np.array(drive.motion.yaw_rad[first])
    )
    world = corner + np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    seen = [
        seen_from_above(drive, scene.frame(k), step, world).reshape(100, 100)
        for k, step in ((40, first), (47, last))
    ]
    shift, answer = cv2.phaseCorrelate(seen[0], seen[1], np.asarray(cv2.createHanningWindow((100, 100), 6)))
    assert np.linalg.norm(shift) < 0.5
    assert answer > 0.3


@pytest.mark.parametrize("name", ["curved", "field_1"])
def test_the_rut_lies_about_the_centre_line(name: str) -> None:
    drive = make_drive(name, 1)
    frame = len(drive.steps) - 1
    step = drive.steps[frame]
    scene = TraceScene(drive, "dark")
    flat = RutLook(tone=-0.4, depth_m=0.0, berm_m=0.0, ragged_m=0.0)
    scene._ways = [replace(scene._ways[-1], look=flat)]
    with_rut = scene.frame(frame).astype(np.float32)
    scene._ways = []
    pressed = (with_rut - scene.frame(frame)).mean(axis=2) < -5
    points, visible, _ = drive.centre_line(step)
    across = np.arange(-0.09, 0.0901, 0.002)
    normal = np.gradient(points[:, :2], axis=0) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    middles = []
    for place in np.flatnonzero(visible)[8:-8:6]:
        line = points[place, :2] + across[:, None] * normal[place]
        pixels = drive.camera.pixels(np.insert(line, 2, 0.0, axis=1) @ rocked(*drive.motion.rock_rad[step]))
        columns, rows = np.round(pixels).astype(int).T
        inside = (columns >= 0) & (columns < 640) & (rows >= 0) & (rows < 480)
        if inside.all():
            middles.append(across[pressed[rows, columns]])
    ends = np.array([(low.min(), low.max()) for low in middles if len(low) > 10])
    assert len(ends) > 5
    assert np.median(ends.mean(axis=1)) == pytest.approx(0.0, abs=0.0015)
    assert np.median(np.ptp(ends, axis=1)) == pytest.approx(drive.wheels[0].width_m, abs=0.012)


def test_on_a_straight_way_the_chord_is_the_direction_and_the_length_grows() -> None:
    drive = make_drive("easy", 4)
    moved = drive.motion
    count = len(moved.yaw_rad)
    theta, yaw = math.radians(9), 0.4
    course = np.array([math.cos(yaw + theta), math.sin(yaw + theta)])
    straight = replace(
        moved,
        yaw_rad=np.full(count, yaw),
        theta_rad=np.full(count, theta),
        rock_rad=np.zeros((count, 2)),
        origin_m=np.arange(count)[:, None] * 0.08 / RATE_HZ * course,
        way_m=np.arange(count) * 0.08 / RATE_HZ,
    )
    wheel = replace(drive.wheels[0], steer_rad=0.0)
    steps = tuple(range(0, count, 20))
    drive = replace(
        drive, motion=straight, wheels=(wheel, *drive.wheels[1:]), steps=steps, gain=(1.0,) * len(steps)
    )
    rows = [row for row in drive.truth() if row.visible_m > 0.05]
    assert rows[-1].present
    assert all(row.present == (row.visible_m >= 0.20) for row in rows)
    for row in rows:
        assert row.chord_deg == pytest.approx(9, abs=1e-6)
        assert row.chord_distance_m == pytest.approx(row.distance_m, abs=1e-6)
    growth = np.diff([row.visible_m for row in rows])
    assert (growth > -1e-9).all()
    assert growth.max() == pytest.approx(0.08 / drive.frames_hz, abs=0.006)


def test_the_wheel_hides_what_lies_behind_it() -> None:
    rng = np.random.default_rng(2)
    wheel = make_drive("easy", 1).wheels[0]
    start = np.array([wheel.x_m - 0.1, wheel.y_m + 0.03, 0.5])
    ends = np.column_stack([wheel.x_m + rng.uniform(-0.3, 0.2, 300), wheel.y_m + rng.uniform(-0.2, 0.2, 300)])
    rays = np.insert(ends, 2, 0.0, axis=1) - start
    points = start + np.linspace(0, 0.97, 2000)[:, None, None] * rays
    local = turned(points[..., :2] - [wheel.x_m, wheel.y_m], np.array(-wheel.steer_rad))
    reach = np.hypot(local[..., 0], points[..., 2] - wheel.radius_m)
    inside = (reach < wheel.radius_m + wheel.lug_m) & (np.abs(local[..., 1]) < wheel.width_m / 2)
    assert (hides(wheel, start, rays) != inside.any(axis=0)).mean() < 0.01
    assert 0.05 < inside.any(axis=0).mean() < 0.9


def test_a_picture_is_the_same_each_time_and_another_with_each_look() -> None:
    drive = make_drive("texture", 2, 5.0)
    pictures = [TraceScene(drive, look).frame(20) for look in ("dark", *LOOKS)]
    assert (pictures[0] == pictures[1]).all()
    assert pictures[0].std() > 5
    assert all((one != other).mean() > 0.02 for one, other in pairwise(pictures[1:]))
