"""Overhead camera: settings, and poses from drawn pictures."""

import math
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.driver import Codec, Rejection
from drivers.errors import ConfigError
from drivers.link import CameraImage, Received
from drivers.overhead_camera.markers import MarkerFinder, centre_of
from drivers.overhead_camera.parameters import DICTIONARY_PATTERN
from drivers.overhead_camera.settings import OverheadCameraSettings
from drivers.samples import Image, PoseFixSample
from tests.drivers.overhead_pictures import (
    HEIGHT,
    SIZE_M,
    WIDTH,
    camera_calibration,
    empty_floor,
    marker_corners,
    project,
    put_marker,
    write_toml,
)

MARKER_HEIGHT_M = 0.22
T_NS = 5_000_000_000


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_toml(tmp_path_factory.mktemp("overhead") / "floor.toml", camera_calibration())


def device(floor: Path | str, **changes: object) -> OverheadCameraSettings:
    table: dict[str, object] = {
        "type": "overhead_camera",
        "source": "live_folder",
        "path": "frames",
        "marker_id": 7,
        "marker_size_m": SIZE_M,
        "marker_height_m": MARKER_HEIGHT_M,
        "calibration": str(floor),
    }
    return OverheadCameraSettings.model_validate({**table, **changes})


def picture(x_m: float, y_m: float, yaw_rad: float, **marker: float) -> Image:
    image = empty_floor()
    height_m, size_m = marker.get("height_m", MARKER_HEIGHT_M), marker.get("size_m", SIZE_M)
    put_marker(image, project(marker_corners(x_m, y_m, yaw_rad, height_m, size_m)))
    return image


def decode(
    codec: Codec[CameraImage], image: Image, t_capture_ns: int | None = T_NS - 40_000_000, t_ns: int = T_NS
) -> PoseFixSample | Rejection:
    (result,) = codec.decode(Received(t_ns, CameraImage(image, t_capture_ns)))
    assert isinstance(result, PoseFixSample | Rejection)
    return result


def fix_of(codec: Codec[CameraImage], image: Image) -> PoseFixSample:
    result = decode(codec, image, None)
    assert isinstance(result, PoseFixSample), result
    return result


def angle_between(first_rad: float, second_rad: float) -> float:
    return math.remainder(first_rad - second_rad, math.tau)


@settings(max_examples=25, deadline=None)
@given(
    x_m=st.floats(0.2, 0.9), y_m=st.floats(0.0, 0.4), yaw_rad=st.floats(-math.pi, math.pi), grey=st.booleans()
)
def test_the_pose_is_found_where_the_marker_is(
    calibration: Path, x_m: float, y_m: float, yaw_rad: float, grey: bool
) -> None:
    image = picture(x_m, y_m, yaw_rad)
    if not grey:
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
    fix = fix_of(device(calibration).make_codec("overhead"), image)
    assert (fix.x_m, fix.y_m) == pytest.approx((x_m, y_m), abs=0.5e-3)
    assert angle_between(fix.yaw_rad, yaw_rad) == pytest.approx(0.0, abs=math.radians(0.6))


def test_the_errors_are_not_larger_than_told(calibration: Path) -> None:
    codec = device(calibration, position_noise_m=0.0, yaw_noise_deg=0.0).make_codec("overhead")
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(40):
        x_m, y_m, yaw_rad = rng.uniform((0.2, 0.0, -math.pi), (0.9, 0.4, math.pi))
        image = cv2.add(picture(x_m, y_m, yaw_rad), rng.normal(0, 4, (HEIGHT, WIDTH)), dtype=cv2.CV_8U)
        fix = fix_of(codec, np.asarray(image, np.uint8))
        error_m = (fix.x_m - x_m, fix.y_m - y_m)
        errors.append(
            [e / fix.position_std_m for e in error_m]
            + [angle_between(fix.yaw_rad, yaw_rad) / fix.yaw_std_rad]
        )
    assert float(np.sqrt(np.mean(np.square(errors), axis=0)).max()) < 1.2


def test_the_standard_deviations_follow_from_the_noise_of_the_corners(calibration: Path) -> None:
    image = picture(0.5, 0.3, 0.0)
    quiet = {"position_noise_m": 0.0, "yaw_noise_deg": 0.0, "corner_noise_px": 0.5}
    fix = fix_of(device(calibration, **quiet).make_codec("overhead"), image)
    # 1.98 m below the lens a pixel shows 1.98 m / 902.5.
    corner_m = 0.5 * 1.98 / 902.5
    assert fix.position_std_m == pytest.approx(corner_m / 2, rel=0.02)
    assert fix.yaw_std_rad == pytest.approx(corner_m / (math.sqrt(2) * SIZE_M), rel=0.02)
    told = {**quiet, "position_noise_m": 0.01, "yaw_noise_deg": 2.0}
    worse = fix_of(device(calibration, **told).make_codec("overhead"), image)
    assert worse.position_std_m == pytest.approx(math.hypot(fix.position_std_m, 0.01))
    assert worse.yaw_std_rad == pytest.approx(math.hypot(fix.yaw_std_rad, math.radians(2.0)))
    away = fix_of(device(calibration, **told, marker_x_m=0.3).make_codec("overhead"), image)
    assert away.position_std_m == pytest.approx(math.hypot(worse.position_std_m, 0.3 * worse.yaw_std_rad))


def test_the_mounting_leads_from_the_marker_to_the_rover(calibration: Path) -> None:
    mounted = device(calibration, marker_x_m=0.1, marker_y_m=-0.05, marker_yaw_deg=90.0)
    # The rover stands at (0.4, 0.3) and faces y: its forward offset points along y, its left along -x.
    fix = fix_of(mounted.make_codec("overhead"), picture(0.45, 0.4, math.pi))
    assert (fix.x_m, fix.y_m) == pytest.approx((0.4, 0.3), abs=0.5e-3)
    assert fix.yaw_rad == pytest.approx(math.pi / 2, abs=0.01)


def test_the_height_of_the_marker_matters(calibration: Path) -> None:
    wrong = device(calibration, marker_height_m=0.0)
    fix = fix_of(wrong.make_codec("overhead"), picture(0.9, 0.3, 0.0, height_m=0.1))
    # Lens above (0.5, 0.3) at 2.2 m: 0.4 m * 0.1 / 2.1 too far out.
    assert fix.x_m - 0.9 == pytest.approx(0.4 * 0.1 / 2.1, abs=0.5e-3)


def test_times_are_kept(calibration: Path) -> None:
    codec = device(calibration, latency_s=0.03).make_codec("overhead")
    image = picture(0.5, 0.3, 0.0)
    stamped, unstamped = decode(codec, image, T_NS - 7), decode(codec, image, None, T_NS + 10)
    assert isinstance(stamped, PoseFixSample)
    assert isinstance(unstamped, PoseFixSample)
    assert (stamped.t_ns, stamped.t_capture_ns) == (T_NS, T_NS - 7)
    assert unstamped.t_capture_ns == T_NS + 10 - 30_000_000
    assert stamped.device == "overhead"


def twice() -> Image:
    image = picture(0.2, 0.3, 0.0)
    put_marker(image, project(marker_corners(0.7, 0.3, 1.0, MARKER_HEIGHT_M)))
    return image


def another() -> Image:
    image = empty_floor()
    put_marker(image, project(marker_corners(0.5, 0.3, 0.0, MARKER_HEIGHT_M)), marker_id=8)
    return image


def stretched() -> Image:
    image = empty_floor()
    corners = marker_corners(0.5, 0.3, 0.0, MARKER_HEIGHT_M)
    corners[:, 0] = 0.5 + 1.12 * (corners[:, 0] - 0.5)
    put_marker(image, project(corners))
    return image


def covered() -> Image:
    image = picture(0.5, 0.3, 0.0)
    x, y = project(np.array([(0.5, 0.3, MARKER_HEIGHT_M)]))[0].astype(int)
    image[y - 5 : y + 8, x - 60 : x + 60] = 200
    return image


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (empty_floor(), "no_marker"),
        (another(), "no_marker"),
        (covered(), "no_marker"),
        (twice(), "ambiguous"),
        (picture(0.5, 0.3, 0.0, size_m=1.15 * SIZE_M), "marker_size"),
        (picture(0.5, 0.3, 0.0, height_m=0.5), "marker_size"),
        (stretched(), "marker_shape"),
        (picture(0.5, 0.3, 0.0, size_m=0.06), "marker_small"),
        (cv2.GaussianBlur(picture(0.5, 0.3, 0.0), (0, 0), 3.0), "blurred"),
        (np.zeros((48, 64), np.uint8), "size"),
        (np.zeros((0, 0), np.uint8), "empty"),
    ],
)
def test_no_pose_is_invented(image: Image, reason: str, calibration: Path) -> None:
    codec = device(calibration).make_codec("overhead")
    assert decode(codec, image) == Rejection(reason)
    assert isinstance(decode(codec, picture(0.5, 0.3, 0.0), None), PoseFixSample)


def test_a_stamp_from_the_future_is_refused_and_does_not_block_the_next(calibration: Path) -> None:
    codec = device(calibration).make_codec("overhead")
    image = picture(0.5, 0.3, 0.0)
    assert decode(codec, image, T_NS + 1_000_001) == Rejection("stamp_future")
    assert isinstance(decode(codec, image, T_NS), PoseFixSample)
    assert decode(codec, image, T_NS - 1, T_NS + 5) == Rejection("stamp_backwards")
    codec.reset()
    assert isinstance(decode(codec, image, T_NS - 1, T_NS + 5), PoseFixSample)


def test_a_fix_is_never_later_than_its_arrival(calibration: Path) -> None:
    fix = decode(device(calibration).make_codec("overhead"), picture(0.5, 0.3, 0.0), T_NS + 1_000_000)
    assert isinstance(fix, PoseFixSample)
    assert fix.t_capture_ns == fix.t_ns == T_NS


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(["noise", "blocks", "torn"]))
def test_whatever_the_picture_shows_nothing_raises_and_numbers_are_finite(
    calibration: Path, seed: int, kind: str
) -> None:
    rng = np.random.default_rng(seed)
    image = picture(*rng.uniform((0.2, 0.0, -3.0), (0.9, 0.4, 3.0)))
    if kind == "noise":
        image = rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    elif kind == "blocks":
        blocks = rng.integers(0, 2, (HEIGHT // 20, WIDTH // 20), dtype=np.uint8) * 255
        image = np.kron(blocks, np.ones((20, 20), np.uint8))
    else:
        image[rng.integers(HEIGHT) :] = 128
    result = decode(device(calibration).make_codec("overhead"), image)
    if isinstance(result, PoseFixSample):
        assert kind == "torn"
        assert math.isfinite(result.x_m + result.y_m + result.yaw_rad + result.yaw_std_rad)
        assert result.position_std_m > 0


def test_the_centre_of_a_marker_seen_aslant_is_its_centre() -> None:
    corners = marker_corners(0.2, 0.4, 0.7, 0.0, size_m=0.4)
    centre = project(np.array([(0.2, 0.4, 0.0)]))[0]
    assert centre_of(project(corners)) == pytest.approx(tuple(centre), abs=1e-6)
    assert np.linalg.norm(project(corners).mean(axis=0) - centre) > 0.05


def test_markers_on_the_floor_are_told_apart_for_calibration() -> None:
    image = empty_floor()
    put_marker(image, project(marker_corners(0.2, 0.3, 0.0, 0.0)), marker_id=3)
    put_marker(image, project(marker_corners(0.8, 0.4, 1.0, 0.0)), marker_id=9)
    found = {
        marker.marker_id: centre_of(marker.corners_px) for marker in MarkerFinder("DICT_4X4_50").find(image)
    }
    assert set(found) == {3, 9}
    assert found[9] == pytest.approx(tuple(project(np.array([(0.8, 0.4, 0.0)]))[0]), abs=0.2)


def test_the_dictionaries_are_those_of_opencv() -> None:
    known = {name for name in dir(cv2.aruco) if name.startswith("DICT_")}
    accepted = {name for name in known if re.match(DICTIONARY_PATTERN, name)}
    assert {name.upper() for name in known} == {name.upper() for name in accepted}
    for name in accepted:
        assert MarkerFinder(name).marker_count <= 2320


@pytest.mark.parametrize(
    "change",
    [
        {"dictionary": "DICT_4X4_51"},
        {"dictionary": "4X4_50"},
        {"marker_id": -1},
        {"marker_size_m": 0},
        {"marker_height_m": -0.1},
        {"calibration": ""},
        {"frame_rate_hz": 0.4},
        {"colour": "grey"},
    ],
)
def test_wrong_settings_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        device("floor.toml", **change)


def test_every_setting_error_is_one_sentence(calibration: Path, tmp_path: Path) -> None:
    scale = {"source": "ruler", "date": "2026-01-02", "width": 640, "height": 480, "scale_mm_per_px": 2.0}
    low = {**scale, "camera_m": [0.0, 0.0, 0.2]}
    cases = (
        (device(tmp_path / "none.toml"), "none.toml"),
        (device(calibration, width=320, height=240), "640 x 480 pixels, not 320 x 240"),
        (device(calibration, marker_id=50), "markers 0 to 49"),
        (device(write_toml(tmp_path / "scale.toml", scale)), "camera_m"),
        (device(write_toml(tmp_path / "low.toml", low)), "camera_m"),
    )
    for wrong, words in cases:
        with pytest.raises(ConfigError, match=re.escape(words)) as caught:
            wrong.make_codec("overhead")
        assert "\n" not in str(caught.value)
    device(tmp_path / "scale.toml", marker_height_m=0.0).make_codec("overhead")


def test_the_calibration_travels_with_the_log(calibration: Path) -> None:
    assert device(calibration).data_files() == {"calibration": (calibration,)}
    (shipped,) = device("simulated").data_files()["calibration"]
    assert shipped.is_file()
    copied = device("simulated").model_copy(update={"calibration": str(shipped)})
    assert copied.calibration_file == shipped


def test_settings_do_not_import_opencv() -> None:
    code = (
        "import sys, drivers.overhead_camera.settings, sim_backends.settings; sys.exit('cv2' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
