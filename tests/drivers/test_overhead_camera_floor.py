"""The floor calibration of an overhead camera: what a file may say, where points lie, how it is fitted."""

import datetime as dt
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ConfigError, ModelError
from drivers.heading_calibration import load_calibration
from drivers.overhead_camera.floor import Floor, FloorCalibration, fit_floor
from tests.drivers.overhead_pictures import (
    HEIGHT,
    LENS_M,
    WIDTH,
    camera_calibration,
    project,
    write_toml,
)

GRID = tuple((x, y) for x in (-0.2, 0.5, 1.1) for y in (-0.2, 0.3, 0.7))
SCALE = {"source": "ruler", "date": "2026-01-02", "width": 640, "height": 480, "scale_mm_per_px": 2.0}


def on_floor(points: tuple[tuple[float, float], ...], height_m: float = 0.0) -> list[tuple[float, float]]:
    pixels = project(np.array([(x, y, height_m) for x, y in points]))
    return [(float(x), float(y)) for x, y in pixels]


def homography_calibration() -> FloorCalibration:
    return FloorCalibration.model_validate(
        {
            "source": "clicks",
            "date": "2026-01-02",
            "width": WIDTH,
            "height": HEIGHT,
            "camera_m": LENS_M,
            "homography": fit_floor(on_floor(GRID), GRID).homography,
        }
    )


@pytest.mark.parametrize("form", ["homography", "camera"])
@given(x_m=st.floats(-0.1, 1.0), y_m=st.floats(-0.1, 0.6), height_m=st.sampled_from([0.0, 0.01, 0.25, 1.0]))
def test_points_above_the_floor_are_found_where_they_are(
    form: str, x_m: float, y_m: float, height_m: float
) -> None:
    calibration = (
        homography_calibration()
        if form == "homography"
        else FloorCalibration.model_validate(camera_calibration())
    )
    pixel = np.array(on_floor(((x_m, y_m),), height_m))
    assert Floor(calibration).locate(pixel, height_m)[0] == pytest.approx((x_m, y_m), abs=1e-6)


def test_without_the_correction_a_raised_point_seems_farther_from_below_the_lens() -> None:
    floor = Floor(homography_calibration())
    seen = floor.locate(np.array(on_floor(((1.0, 0.3),), 0.22)), 0.0)[0]
    # 0.22 m high and 0.5 m from the foot of a lens 2.2 m high: a tenth of 0.5 m / 0.9 too far.
    assert seen == pytest.approx((0.5 + 0.5 / 0.9, 0.3), abs=1e-6)


def test_lens_distortion_is_taken_out() -> None:
    distortion = (-0.2, 0.05, 0.001, -0.002)
    calibration = FloorCalibration.model_validate({**camera_calibration(), "distortion": distortion})
    pixel = project(np.array([(1.0, 0.6, 0.2)]), distortion)
    straight = project(np.array([(1.0, 0.6, 0.2)]))
    assert np.linalg.norm(pixel - straight) > 3.0
    assert Floor(calibration).locate(pixel, 0.2)[0] == pytest.approx((1.0, 0.6), abs=1e-4)


def test_the_smallest_form_is_a_scale_with_x_to_the_right_and_y_up() -> None:
    floor = Floor(FloorCalibration.model_validate({**SCALE, "camera_m": (0.0, 0.0, 2.0)}))
    points = floor.locate(np.array([(319.5, 239.5), (419.5, 239.5), (319.5, 139.5)]), 0.0)
    assert points == pytest.approx(np.array([(0.0, 0.0), (0.2, 0.0), (0.0, 0.2)]), abs=1e-12)
    assert floor.locate(np.array([(419.5, 239.5)]), 0.5)[0] == pytest.approx((0.15, 0.0))


def test_a_raised_point_needs_to_know_the_camera() -> None:
    floor = Floor(FloorCalibration.model_validate(SCALE))
    with pytest.raises(ModelError, match="camera_m"):
        floor.locate(np.array([(1.0, 1.0)]), 0.1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scale_mm_per_px": None}, "give either"),
        ({"homography": ((1, 0, 0), (0, -1, 0), (0, 0, 1))}, "give either"),
        ({"scale_mm_per_px": None, "homography": ((1, 0, 0), (0, 1, 0), (0, 0, 1))}, "right-handed"),
        ({"scale_mm_per_px": None, "homography": ((1, 0, 0), (1, 0, 0), (0, 0, 1))}, "right-handed"),
        ({"scale_mm_per_px": None, "camera_matrix": ((1, 0, 0), (0, 1, 0), (0, 0, 1))}, "give either"),
        ({"rotation_vector": (0.0, 0.0, 0.0)}, "give either"),
        ({"distortion": (0.1, 0.0, 0.0, 0.0)}, "camera_matrix"),
        ({"camera_m": (0.0, 0.0, -1.0)}, "above the floor"),
        ({"scale_mm_per_px": 0.0}, "greater than"),
    ],
)
def test_a_wrong_calibration_is_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        FloorCalibration.model_validate({**SCALE, **change})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"distortion": [0.1, 0.2]}, "4, 5 or 8"),
        ({"camera_m": [0.0, 0.0, 1.0]}, "remove it"),
        ({"translation_m": [0.0, 0.0, -2.0]}, "right-handed|above the floor"),
    ],
)
def test_a_wrong_camera_is_refused_in_one_sentence(
    change: dict[str, object], words: str, tmp_path: Path
) -> None:
    path = write_toml(tmp_path / "floor.toml", {**camera_calibration(), **change})
    with pytest.raises(ConfigError, match=words) as caught:
        load_calibration(path, FloorCalibration)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_exact_points_give_the_exact_map_and_four_leave_no_residuals() -> None:
    fit = fit_floor(on_floor(GRID), GRID)
    assert fit.rms_px < 1e-9
    assert fit.scale_std_mm_per_px is not None
    assert fit.scale_std_mm_per_px < 1e-9
    corners = (GRID[0], GRID[2], GRID[6], GRID[8])
    four = fit_floor(on_floor(corners), corners)
    assert four.scale_std_mm_per_px is None
    assert np.array(four.homography) == pytest.approx(np.array(fit.homography), abs=1e-8)


def test_the_scale_is_the_length_that_a_pixel_shows() -> None:
    fit = fit_floor(on_floor(GRID), GRID)
    middle = tuple(np.mean(GRID, axis=0))
    (x, y), (x_right, y_right), (x_up, y_up) = (
        on_floor(((middle[0] + dx, middle[1] + dy),))[0]
        for dx, dy in ((0.0, 0.0), (0.001, 0.0), (0.0, 0.001))
    )
    area_px = abs((x_right - x) * (y_up - y) - (x_up - x) * (y_right - y))
    assert fit.scale_mm_per_px == pytest.approx(1.0 / math.sqrt(area_px), rel=1e-3)


def test_the_error_of_the_scale_is_as_large_as_told() -> None:
    rng = np.random.default_rng(5)
    exact = np.array(on_floor(GRID))
    fits = [fit_floor([(x, y) for x, y in exact + rng.normal(0, 0.4, exact.shape)], GRID) for _ in range(300)]
    spread = float(np.std([fit.scale_mm_per_px for fit in fits]))
    told = float(np.sqrt(np.mean([(fit.scale_std_mm_per_px or 0.0) ** 2 for fit in fits])))
    assert told == pytest.approx(spread, rel=0.15)
    # Of 18 coordinates, 8 are used up by the map.
    rms_px = float(np.sqrt(np.mean([fit.rms_px**2 for fit in fits])))
    assert rms_px == pytest.approx(0.4 * math.sqrt(2 * 10 / 18), rel=0.05)


def test_a_wrong_point_stands_out() -> None:
    pixels = on_floor(GRID)
    pixels[4] = (pixels[4][0] + 8.0, pixels[4][1])
    fit = fit_floor(pixels, GRID)
    lengths = [math.hypot(*residual) for residual in fit.residuals_px]
    assert lengths.index(max(lengths)) == 4
    assert fit.residuals_px[4][0] > 3.0
    assert fit.rms_m == pytest.approx(1e-3 * fit.scale_mm_per_px * fit.rms_px, rel=0.1)


@pytest.mark.parametrize(
    ("pixels", "metres", "words"),
    [
        (((0, 0), (9, 0), (9, 9)), ((0, 0), (1, 0), (1, 1)), "at least 4"),
        (((0, 0), (9, 0), (9, 9), (0, 9)), ((0, 0), (1, 0), (1, 1)), "at least 4"),
        (((0, 0), (5, 5), (9, 9), (12, 12)), ((0, 0), (1, 1), (2, 2), (3, 3)), "line"),
        (((0, 0), (5, 0), (9, 0), (4, 7)), ((0, 0), (1, 0), (2, 0), (1, 1)), "line"),
        (((3, 3),) * 4, ((0, 0), (1, 0), (1, 1), (0, 1)), "same"),
        (((0, 0), (9, 0), (9, 9), (0, math.nan)), ((0, 0), (1, 0), (1, 1), (0, 1)), "finite"),
        (((0, 0), (9, 0), (9, 9), (0, 9)), ((0, 0), (1, 0), (1, 1), (0, 1)), "mirrored"),
    ],
)
def test_points_that_fix_no_floor_are_refused(
    pixels: tuple[tuple[float, float], ...], metres: tuple[tuple[float, float], ...], words: str
) -> None:
    with pytest.raises(ModelError, match=words) as caught:
        fit_floor(pixels, metres)
    assert "\n" not in str(caught.value)


def test_a_fit_can_be_kept_in_a_file(tmp_path: Path) -> None:
    fit = fit_floor(on_floor(GRID), GRID)
    path = tmp_path / "floor.toml"
    path.write_text(
        fit.to_toml(source="clicks", date=dt.date(2026, 1, 2), size_px=(WIDTH, HEIGHT), camera_m=LENS_M)
    )
    calibration = load_calibration(path, FloorCalibration)
    assert calibration.homography == fit.homography
    assert (calibration.width, calibration.height, calibration.camera_m) == (WIDTH, HEIGHT, LENS_M)
    assert calibration.date == dt.date(2026, 1, 2)
