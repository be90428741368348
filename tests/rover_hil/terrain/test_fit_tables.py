import csv
import json
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import LogError
from rover_hil.terrain.commands.fit import fit
from rover_hil.terrain.fit_tables import (
    PLATE_COLUMNS,
    WHEEL_COLUMNS,
    read_plate_table,
    read_wheel_table,
)
from sim_backends.terramechanics.soil.any_angle_wheel import Motion, any_angle_at_load, load_any_angle_soil
from sim_backends.terramechanics.soil.library import load_wheel

WHEEL = load_wheel("cmu_smooth")
START = load_any_angle_soil("cmu_sand_blind")


def write(path: Path, columns: tuple[str, ...], rows: list[tuple[object, ...]]) -> Path:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([columns, *rows])
    return path


def plate_rows(modulus_pa: float, exponent: float) -> list[tuple[object, ...]]:
    rows: list[tuple[object, ...]] = []
    for test, diameter_m in (("small", 0.06), ("middle", 0.08), ("large", 0.1)):
        for sinkage_m in np.linspace(0.0, 0.03, 31):
            load_n = modulus_pa * sinkage_m**exponent * np.pi / 4.0 * diameter_m**2
            rows.append((test, diameter_m, sinkage_m, load_n))
    return rows


def test_plates_of_ones_own_test_bed_give_modulus_and_exponent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "plates.csv", ("test", *PLATE_COLUMNS), plate_rows(5.0e6, 1.3))
    assert (
        fit(tmp_path, wheel_name="cmu_smooth", soil_name="cmu_sand", free="", plates_only=True, as_json=True)
        == 0
    )
    found = {row["name"]: row["value"] for row in json.loads(capsys.readouterr().out)["fitted"]}
    assert found["plate_modulus_pa"] == pytest.approx(5.0e6, rel=1e-6)
    assert found["plate_exponent"] == pytest.approx(1.3, rel=1e-6)


def test_a_wheel_table_says_what_its_trials_were(tmp_path: Path) -> None:
    motion = Motion(np.array([0.02]), np.array([0.01 * np.cos(0.5)]), np.array([0.01 * np.sin(0.5)]))
    sinkage_m, forces = any_angle_at_load(WHEEL, START, motion, np.array([20.0]))
    row = ("a", np.degrees(0.5), 0.01, 0.02, 20.0, forces.drawbar_n[0], forces.side_n[0], sinkage_m[0])
    tests = read_wheel_table(write(tmp_path / "wheel.csv", ("cell", *WHEEL_COLUMNS), [row, row]))
    assert list(tests.cell) == ["a", "a"]
    assert tests.rim_speed_mm_s == pytest.approx([20.0, 20.0])
    for found, true in zip(tests.motion, motion, strict=True):
        assert found == pytest.approx(np.repeat(true, 2))
    assert np.all(tests.side_n < 0), "sliding to the left is resisted to the right"


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (("a", 0.06, 0.01, "nan"), r"line 2: load_n is 'nan'"),
        (("a", 60, 0.01, 5), r"line 2: diameter_m is '60'"),
        (("a", 0.06, "", 5), r"line 2: sinkage_m is ''"),
    ],
)
def test_bad_numbers_are_named_with_their_line(tmp_path: Path, row: tuple[object, ...], message: str) -> None:
    with pytest.raises(LogError, match=message):
        read_plate_table(write(tmp_path / "plates.csv", ("test", *PLATE_COLUMNS), [row]))


def test_tables_that_are_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no column 'load_n'"):
        read_plate_table(
            write(tmp_path / "plates.csv", ("test", "diameter_m", "sinkage_m"), [("a", 0.1, 0.01)])
        )
    with pytest.raises(LogError, match="no column 'cell'"):
        read_wheel_table(write(tmp_path / "wheel.csv", WHEEL_COLUMNS, []))
    rows: list[tuple[object, ...]] = [("a", 0.1, 0.01, 5), ("a", 0.2, 0.01, 5)]
    two_plates = write(tmp_path / "plates.csv", ("test", *PLATE_COLUMNS), rows)
    with pytest.raises(LogError, match="2 diameters"):
        read_plate_table(two_plates)
    with pytest.raises(LogError, match="cannot read"):
        read_plate_table(tmp_path / "nowhere.csv")


def test_several_wheels_in_a_folder_are_told_apart_by_the_wheels_name(tmp_path: Path) -> None:
    write(tmp_path / "plates.csv", ("test", *PLATE_COLUMNS), plate_rows(5.0e6, 1.3))
    for name in ("smooth", "grousered"):
        (tmp_path / f"{name}_wheel_steady_state.csv").write_text("beta_deg\n0\n", "utf-8")

    def fit_wheel(wheel_name: str) -> None:
        fit(
            tmp_path,
            wheel_name=wheel_name,
            soil_name="cmu_sand",
            free="slide_number",
            plates_only=False,
            as_json=True,
        )

    with pytest.raises(LogError, match=r"grousered_wheel_steady_state\.csv line 1 names no column"):
        fit_wheel("cmu_grousered")
    with pytest.raises(LogError, match=r"not one .* for wheel wh31"):
        fit_wheel("wh31")
