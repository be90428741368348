"""Deviation tables and iron calibration: interpolation, fit, and files that must be refused."""

import datetime as dt
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.errors import ConfigError, ModelError
from drivers.heading_calibration import (
    DeviationTable,
    MagnetometerCalibration,
    fit_magnetometer,
    load_calibration,
)

DAY = dt.date(2026, 5, 4)
HARD_IRON = np.array([310.0, -120.0, 80.0])
SOFT_IRON_ERROR = np.array([[1.2, 0.1, -0.05], [0.1, 0.9, 0.08], [-0.05, 0.08, 1.05]])
FIELD_COUNTS = 480.0

TABLE = """
source = "swung on the yard against a GNSS compass"
date = 2026-05-04
heading_deg = [10, 100, 190, 280.0]
deviation_deg = [1.0, 3.0, -1.0, 0.0]
"""
IRON = """
source = "turned by hand"
date = 2026-05-04
hard_iron_counts = [310.0, -120.0, 80.0]
soft_iron = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
"""


def table_of(tmp_path: Path, text: str) -> DeviationTable:
    file = tmp_path / "deviation.toml"
    file.write_text(text)
    return load_calibration(file, DeviationTable)


@pytest.mark.parametrize(
    ("reading_deg", "deviation_deg"),
    [
        (10, 1.0),
        (100, 3.0),
        (55, 2.0),
        (145, 1.0),
        (280, 0.0),
        (325, 0.5),
        (0, 8 / 9),
        (370, 1.0),
        (-35, 0.5),
    ],
)
def test_deviation_is_linear_between_entries_and_across_north(
    tmp_path: Path, reading_deg: float, deviation_deg: float
) -> None:
    table = table_of(tmp_path, TABLE)
    assert table.deviation_at(reading_deg) == pytest.approx(deviation_deg)
    assert table.source.startswith("swung")
    assert table.date == DAY


@given(
    readings=st.lists(st.integers(0, 35_999), min_size=4, max_size=40, unique=True),
    reading_deg=st.floats(-720, 720),
    seed=st.integers(0, 2**32 - 1),
)
def test_deviation_agrees_with_numpy(readings: list[int], reading_deg: float, seed: int) -> None:
    heading_deg = [reading / 100.0 for reading in sorted(readings)]
    deviation_deg = np.random.default_rng(seed).uniform(-20, 20, len(heading_deg))
    table = DeviationTable(
        source="x", date=DAY, heading_deg=tuple(heading_deg), deviation_deg=tuple(deviation_deg.tolist())
    )
    expected = np.interp(reading_deg % 360.0, heading_deg, deviation_deg, period=360.0)
    assert table.deviation_at(reading_deg) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("heading_deg =", "heading =", r"deviation\.toml.*key 'heading_deg'.*keys source, date, heading_deg"),
        ("date =", "days = 3\ndate =", r"key 'days'.*[Ee]xtra"),
        ("date = 2026-05-04", "", r"key 'date'.*[Rr]equired"),
        ("3.0, -1.0", "nan, -1.0", r"key 'deviation_deg\.1'.*finite"),
        ("100, 190", "190, 100", r"key 'heading_deg'.*strictly increasing"),
        ("100, 190", "100, 100", r"key 'heading_deg'.*strictly increasing"),
        ("280.0]", "360.0]", r"key 'heading_deg\.3'.*less than 360"),
        (", 280.0]", "]", r"key 'heading_deg'.*at least 4"),
        (", 0.0]", "]", r"key 'deviation_deg'.*as many entries as heading_deg"),
        ("1.0, 3.0", "1.0, 200.0", r"key 'deviation_deg\.1'.*90"),
        ("[10", "[10 10", r"deviation\.toml is not valid TOML"),
    ],
)
def test_wrong_tables_are_refused_with_file_key_and_fix(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in TABLE
    with pytest.raises(ConfigError, match=message):
        table_of(tmp_path, TABLE.replace(old, new, 1))


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"absent\.toml"):
        load_calibration(tmp_path / "absent.toml", DeviationTable)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match=r"binary\.toml is not valid TOML"):
        load_calibration(binary, DeviationTable)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("hard_iron_counts", "hard_iron", r"key 'hard_iron_counts'"),
        ("[0.0, 0.0, 1.0]]", "[0.0, 0.0, -1.0]]", r"key 'soft_iron'.*positive determinant"),
        ("[0.0, 0.0, 1.0]]", "]", r"key 'soft_iron"),
        ("80.0]", "inf]", r"key 'hard_iron_counts\.2'.*finite"),
    ],
)
def test_wrong_iron_files_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "iron.toml"
    file.write_text(IRON)
    assert load_calibration(file, MagnetometerCalibration).apply((311.0, -120.0, 82.0)) == (1.0, 0.0, 2.0)
    file.write_text(IRON.replace(old, new, 1))
    with pytest.raises(ConfigError, match=message):
        load_calibration(file, MagnetometerCalibration)


def sphere(count: int) -> NDArray[np.float64]:
    directions = np.random.default_rng(3).standard_normal((count, 3))
    unit: NDArray[np.float64] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return unit


def circle(count: int, until_rad: float = 2 * np.pi) -> NDArray[np.float64]:
    angle_rad = np.linspace(0.0, until_rad, count, endpoint=False)
    return np.stack([np.cos(angle_rad), np.sin(angle_rad), np.full(count, -0.8)], axis=1)


def distorted(field: NDArray[np.float64], noise_counts: float = 0.0) -> NDArray[np.float64]:
    noise = noise_counts * np.random.default_rng(4).standard_normal(field.shape)
    raw: NDArray[np.float64] = field * FIELD_COUNTS @ SOFT_IRON_ERROR.T + HARD_IRON + noise
    return raw


def calibrated(calibration: MagnetometerCalibration, raw: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([calibration.apply((x, y, z)) for x, y, z in raw.tolist()])


def test_ellipsoid_fit_recovers_hard_and_soft_iron() -> None:
    field = sphere(400)
    calibration = fit_magnetometer(distorted(field, noise_counts=2.0), source="turned by hand", date=DAY)
    assert calibration.hard_iron_counts == pytest.approx(tuple(HARD_IRON), abs=1.0)
    corrected = calibrated(calibration, distorted(field))
    strength = np.linalg.norm(corrected, axis=1)
    assert strength.std() / strength.mean() < 0.003
    angle_rad = np.arccos(np.clip((corrected / strength[:, None] * field).sum(axis=1), -1, 1))
    assert np.degrees(angle_rad).max() < 0.5
    assert strength.mean() == pytest.approx(
        FIELD_COUNTS * np.linalg.det(SOFT_IRON_ERROR) ** (1 / 3), rel=0.01
    )


def test_planar_fit_recovers_the_heading_on_level_ground() -> None:
    field = circle(200)
    raw = distorted(field, noise_counts=2.0)
    heading_deg = np.degrees(np.arctan2(field[:, 1], field[:, 0]))

    def largest_error_deg(vectors: NDArray[np.float64]) -> float:
        error_deg = np.degrees(np.arctan2(vectors[:, 1], vectors[:, 0])) - heading_deg
        return float(np.abs((error_deg + 180.0) % 360.0 - 180.0).max())

    calibration = fit_magnetometer(raw, source="turned on the yard", date=DAY, planar=True)
    assert largest_error_deg(raw) > 20.0
    assert largest_error_deg(calibrated(calibration, raw)) < 1.5
    assert calibration.hard_iron_counts[2] == 0.0
    assert calibration.soft_iron[2] == (0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("make", "planar", "message"),
    [
        (lambda: distorted(circle(200)), False, "all directions"),
        (lambda: distorted(circle(200, until_rad=2.5), 2.0), True, "all directions"),
        (lambda: distorted(sphere(5)), False, "at least 12"),
        (lambda: np.full((50, 3), np.nan), False, "finite"),
        (lambda: np.tile([100.0, 200.0, 300.0], (50, 1)), False, "all directions"),
        (lambda: np.outer(np.linspace(-1, 1, 50), [1.0, 2.0, 3.0]), True, "all directions"),
    ],
    ids=["circle for sphere", "arc", "too few", "not finite", "standing still", "line"],
)
def test_readings_that_do_not_tell_are_refused(
    make: Callable[[], NDArray[np.float64]], planar: bool, message: str
) -> None:
    with pytest.raises(ModelError, match=message):
        fit_magnetometer(make(), source="x", date=DAY, planar=planar)


def test_all_mistakes_of_a_calibration_come_at_once(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        table_of(tmp_path, TABLE.replace("10, 100", "100, 10").replace("date", "day"))
    lines = str(caught.value).splitlines()
    assert [line.split("key ")[1].split(":")[0] for line in lines] == ["'date'", "'heading_deg'", "'day'"]
