"""The named sets of drives, and the files they are written to."""

import csv
import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.errors import ConfigError
from sim_backends.rear_scene.ground_kinds import SIZE, make_ground
from tests.rear_scene.draws import draw_rig
from tests.rear_scene.sequence import FrameSequence, write_sequence
from tests.rear_scene.sets import (
    FIRST_HELD_OUT_SEED,
    PHOTOGRAPHS,
    SANDS,
    SET_NAMES,
    SetName,
    make_sequence,
)
from tests.sim_backends.rear_drives import grey

pytestmark = pytest.mark.nightly  # a truth generator, which no change of the program touches

RIG_KEYS = {
    "schema",
    "vehicle_frame",
    "image",
    "camera_matrix",
    "dist_coeffs",
    "R_vehicle_camera",
    "t_vehicle_camera",
    "wheel",
    "other_wheels",
    "b_m",
    "nominal_speed_mps",
    "ground_view_m",
    "max_slip_angle_deg",
}
WHEEL_KEYS = {"name", "contact_point", "radius_m", "width_m", "grouser_height_m", "lug_count", "steer_deg"}
TELEMETRY_KEYS = ["frame", "t", "wheel_speed_mps", "compass_deg", "gyro_roll_dps", "gyro_pitch_dps"]


def off_rms_deg(sequence: FrameSequence) -> float:
    off = [truth.theta_t_deg - truth.line_deg for truth in sequence.truth if truth.trace_present]
    return float(np.sqrt(np.mean(np.square(off))))


@pytest.mark.parametrize("name", SET_NAMES)
def test_every_set_gives_frames_and_the_same_again(name: SetName) -> None:
    duration_s = 24.0 if name == "sparse" else 1.2
    sequence, again = (make_sequence(name, 4, duration_s) for _ in range(2))
    frames, once_more = list(sequence.frames()), list(again.frames())
    assert len(frames) == len(sequence) == len(sequence.truth) == len(sequence.telemetry) >= 5
    assert all(frame.shape == (480, 640, 3) and frame.dtype == np.uint8 for frame in frames)
    assert all(np.array_equal(a, b) for a, b in zip(frames, once_more, strict=True))
    assert sequence.truth[-1].theta_t_deg == again.truth[-1].theta_t_deg
    assert grey(frames[0]).std() > 4
    assert not np.array_equal(frames[0], next(make_sequence(name, 5, duration_s).frames()))


def test_held_out_drives_have_grounds_and_rigs_of_their_own() -> None:
    for kinds in (SANDS, PHOTOGRAPHS):
        assert not set(kinds[False]) & set(kinds[True])
    ours, theirs = make_sequence("easy", 0, 1.0), make_sequence("easy", FIRST_HELD_OUT_SEED, 1.0)
    assert ours.rig.wheel.width_m == 0.11
    assert theirs.rig.wheel.width_m != ours.rig.wheel.width_m
    assert theirs.rig.wheel.lug_count >= 14


@pytest.mark.parametrize("seed", [2, FIRST_HELD_OUT_SEED + 2])
def test_the_camera_sees_about_60_cm_by_80_cm_behind_the_wheel(seed: int) -> None:
    rig = make_sequence("easy", seed, 1.0).rig
    wheel = rig.wheel
    grid = np.array([(wheel.x_m - 0.35, wheel.y_m + side, 0.0) for side in (-0.32, 0.32)])
    assert rig.sees(rig.project(grid)).all()
    assert not rig.sees(rig.project(grid * [1, 1, 0] + [0, 0.5, 0]))[1]
    near, far = (rig.project(np.array([[wheel.x_m - back, wheel.y_m, 0.0]]))[0] for back in (0.14, 0.6))
    assert 0 <= far[1] < near[1] <= 479


@pytest.mark.parametrize("seed", [*range(6), *range(FIRST_HELD_OUT_SEED, FIRST_HELD_OUT_SEED + 6)])
def test_every_pixel_is_where_its_ray_is_projected(seed: int) -> None:
    rig = draw_rig(seed >= FIRST_HELD_OUT_SEED, 5.0, np.random.default_rng(seed))
    rays = rig.rays()[::7, ::7].reshape(-1, 2)
    directions = np.insert(rays, 2, 1.0, axis=1) @ rig.vehicle_from_camera.T
    pixels = np.stack(np.meshgrid(np.arange(0, 640, 7), np.arange(0, 480, 7)), axis=-1).reshape(-1, 2)
    assert rig.project(rig.camera_m + directions) == pytest.approx(pixels, abs=0.01)


def test_sets_differ_as_they_say() -> None:
    curved, easy = (
        np.mean([off_rms_deg(make_sequence(name, s)) for s in range(2)]) for name in ("curved", "easy")
    )
    assert curved > 2 * easy
    assert not any(truth.trace_present for truth in make_sequence("no_trace", 1).truth)
    dropped = make_sequence("drop_out", 1)
    assert 0 < sum(not truth.usable for truth in dropped.truth) < 0.2 * len(dropped)
    lengths = [truth.visible_m for truth in dropped.truth[50:]]
    assert min(lengths) < 0.7 * max(lengths)


def test_sparse_frames_are_32_cm_apart_on_the_wheel() -> None:
    sequence = make_sequence("sparse", 0)
    times = np.array([truth.t for truth in sequence.truth])
    angle = sequence.motion.wheel_angle_rad[np.round(times * 100).astype(int)]
    assert np.diff(angle).mean() * 0.092 == pytest.approx(0.32, rel=0.03)


@pytest.mark.parametrize("seed", [0, FIRST_HELD_OUT_SEED])
def test_the_field_tests_are_those_of_the_paper_in_length_slope_and_drift(seed: int) -> None:
    first = make_sequence("field_test_1", seed)
    way_m = np.hypot(*np.diff(first.motion.position_m[:, :2], axis=0).T).sum()
    assert way_m == pytest.approx(7.0, abs=0.4)
    theta = np.array([truth.theta_t_deg for truth in first.truth])
    assert np.abs(theta[:250]).mean() < 2.0
    assert abs(theta[-50:].mean()) > 6.0
    second = make_sequence("field_test_2", seed)
    way_m = np.hypot(*np.diff(second.motion.position_m[:, :2], axis=0).T).sum()
    assert way_m == pytest.approx(13.0, abs=0.6)
    theta = np.array([truth.theta_t_deg for truth in second.truth])
    assert theta.min() < -4
    assert theta.max() > 4
    climb = np.degrees(np.median(second.motion.pitch_rad))
    assert climb == pytest.approx(-5.0, abs=2.0)


def test_files_hold_rig_telemetry_truth_and_frames(tmp_path: Path) -> None:
    sequence = make_sequence("easy", 1, 1.2)
    folder = tmp_path / "easy_1"
    write_sequence(sequence, folder)
    rig = json.loads((folder / "rig.json").read_text("utf-8"))
    assert set(rig) == RIG_KEYS
    assert rig["schema"] == "rear-camera-rig/1"
    assert set(rig["wheel"]) == WHEEL_KEYS == set(rig["other_wheels"][2])
    assert set(rig["image"]) == {"width", "height", "fps", "format"}
    assert np.linalg.det(rig["R_vehicle_camera"]) == pytest.approx(1.0)
    assert len(rig["dist_coeffs"]["values"]) == 5
    with (folder / "telemetry.csv").open(encoding="utf-8") as file:
        telemetry = list(csv.DictReader(file))
    assert list(telemetry[0]) == [*TELEMETRY_KEYS, "gyro_yaw_dps"]
    assert len(telemetry) == len(sequence)
    with (folder / "truth.csv").open(encoding="utf-8") as file:
        truth = list(csv.DictReader(file))
    assert float(truth[5]["theta_t_deg"]) == sequence.truth[5].theta_t_deg
    assert truth[0]["trace_present"] == "0"
    images = sorted((folder / "frames").iterdir())
    assert [path.name for path in images] == [f"{frame:05d}.png" for frame in range(len(sequence))]
    assert np.array_equal(np.asarray(cv2.imread(str(images[3]))), list(sequence.frames())[3])


def test_a_folder_that_exists_is_not_written_over(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    with pytest.raises(ConfigError, match="choose a new folder"):
        write_sequence(make_sequence("easy", 1, 1.0), tmp_path)


def test_an_unknown_set_is_refused() -> None:
    with pytest.raises(ConfigError, match="no set of scenes is called 'beach'"):
        make_sequence("beach", 0)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["fine_sand", "rippled_sand", "gravel", "grass", "brick", "sandy_gravel"])
def test_ground_continues_over_its_edges(kind: str) -> None:
    tile = make_ground(kind, np.random.default_rng(1))  # type: ignore[arg-type]
    assert tile.reflectance.shape == tile.relief_m.shape == (SIZE, SIZE)
    for layer in (tile.reflectance, tile.relief_m):
        inside = np.abs(np.diff(layer, axis=0)).mean()
        assert np.abs(layer[0] - layer[-1]).mean() < 1.6 * inside
        assert np.abs(layer[:, 0] - layer[:, -1]).mean() < 1.6 * np.abs(np.diff(layer, axis=1)).mean()
    assert tile.reflectance.mean() == pytest.approx(0.42, abs=0.03)
    assert not math.isclose(float(tile.relief_m.std()), 0.0)
