import csv
import json
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from controllers.slip.scomp.parameters import ScompParameters
from drivers.errors import ConfigError, LogError, ModelError
from rover_hil.app.app import app
from rover_hil.identify.scomp.command import identify_scomp
from rover_hil.identify.scomp.pictures import model_pictures
from rover_hil.pages.atomic_write import write_file
from rover_hil.scomp.columns import drive_of
from rover_hil.scomp.command import run_scomp
from rover_hil.scomp.drive import SensorRows
from rover_hil.scomp.files import COLUMNS, parameters_text, read_parameters, read_rows, read_truth
from tests.controllers.scomp.drives import mounds, sideways

Columns = dict[str, np.ndarray]


def write_csv(path: Path, columns: Columns) -> Path:
    with path.open("w", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both field tests as files, and the parameters of the first."""
    folder = tmp_path_factory.mktemp("scomp")
    for name, recorded in (("first", sideways()), ("second", mounds())):
        write_csv(folder / f"{name}.csv", recorded.log)
        write_csv(folder / f"{name}_truth.csv", recorded.truth)
    code = identify_scomp(
        folder / "first.csv",
        truth=folder / "first_truth.csv",
        out=folder / "sand.toml",
        pictures=folder / "pictures",
        as_json=True,
    )
    assert code == 0
    return folder


def test_the_second_test_with_parameters_of_the_first(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "path.csv"
    arguments = [
        "scomp",
        str(folder / "second.csv"),
        "--params",
        str(folder / "sand.toml"),
        "--out",
        str(out),
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["rover-hil", *arguments])
        result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0
    lines = out.read_text().splitlines()
    assert lines[0] == ",".join(COLUMNS) == "t_s,x_m,y_m,heading_rad,slip,slip_angle_rad,sigma_x_m,sigma_y_m"
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    truth = mounds().truth
    assert table[:, 0].tolist() == truth["t_s"].tolist()
    assert np.hypot(table[-1, 1] - truth["x_m"][-1], table[-1, 2] - truth["y_m"][-1]) < 0.25
    assert "no --params" not in result.stdout


def test_parameters_have_a_provenance_and_survive_the_file(folder: Path, tmp_path: Path) -> None:
    parameters = read_parameters(folder / "sand.toml")
    assert parameters.provenance.log == "first.csv"
    assert parameters.provenance.truth == "first_truth.csv"
    assert len(parameters.provenance.fitted_on) == 8
    again = tmp_path / "again.toml"
    write_file(again, parameters_text(parameters))
    assert read_parameters(again) == parameters
    defaults = tmp_path / "defaults.toml"
    write_file(defaults, parameters_text(ScompParameters()))
    assert read_parameters(defaults).pitch.model == ScompParameters().pitch.model


def test_pictures_of_the_fit(folder: Path) -> None:
    names = {path.name for path in (folder / "pictures").iterdir()}
    assert names >= {
        "fig07_longitudinal_force.svg",
        "fig12_slip_over_angle.svg",
        "slip_over_angle.svg",
        "path.svg",
    }
    assert all("<svg" in path.read_text() for path in (folder / "pictures").iterdir())
    assert len(model_pictures(ScompParameters().pitch.model)) == 6


def test_parameters_go_to_standard_output(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    identify_scomp(
        folder / "first.csv", truth=folder / "first_truth.csv", out=None, pictures=None, as_json=False
    )
    printed = capsys.readouterr()
    table = tomllib.loads(printed.out)
    assert table["schema"] == "rover-hil-scomp/1"
    assert ScompParameters.model_validate(table).pitch == read_parameters(folder / "sand.toml").pitch
    assert "c_rr" in printed.err


def test_an_existing_parameter_file_is_kept(folder: Path) -> None:
    with pytest.raises(ConfigError, match="never overwritten"):
        identify_scomp(
            folder / "first.csv",
            truth=folder / "first_truth.csv",
            out=folder / "sand.toml",
            pictures=None,
            as_json=False,
        )


def scomp_json(capsys: pytest.CaptureFixture[str], log: Path, out: Path) -> dict[str, Any]:
    assert run_scomp(log, params=None, out=out, online=True, as_json=True) == 0
    summary: dict[str, Any] = json.loads(capsys.readouterr().out)
    return summary


def some(columns: Columns, rows: int = 200) -> Columns:
    return {name: values[:rows] for name, values in columns.items()}


def test_wheels_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = some(mounds().log)
    log = {
        name: log[name]
        for name in ("t_s", "position1_rad", "position2_rad", "position3_rad", "position4_rad")
    }
    summary = scomp_json(capsys, write_csv(tmp_path / "few.csv", log), tmp_path / "path.csv")
    words = " ".join(summary["notes"])
    for missing in ("no gyro and no compass", "no pitch", "no roll", "no trace", "no --params"):
        assert missing in words
    assert summary["sigma_y_m"] > 0.0
    assert summary["x_m"] > 0.1


def test_empty_cells_stand_for_nothing_new(tmp_path: Path) -> None:
    text = "t_s,position1_rad,heading_deg,pitch_deg,beta_ftrace_deg,beta_valid,mood\n"
    text += "0,0,,,,,good\n1,1,350,,5,True,good\n2,2,,2,6,False,good\n3,3,10,,7,true,bad\n"
    path = tmp_path / "holes.csv"
    path.write_text(text)
    drive, notes = read_rows(path)
    assert drive.compass_rad is not None
    assert np.degrees(drive.compass_rad[[1, 3]]) == pytest.approx([350.0, 370.0])
    assert np.isnan(drive.compass_rad[[0, 2]]).all()
    assert drive.pitch_rad == pytest.approx(np.full(4, np.radians(2.0)))
    assert drive.trace_rad is not None
    assert np.isfinite(drive.trace_rad).tolist() == [False, True, False, True]
    assert drive.gyro_rad_s is None
    assert any("mood" in note for note in notes)


def test_a_repeated_compass_reading_is_no_new_one() -> None:
    columns = {
        "t_s": 0.1 * np.arange(30.0),
        "position1_rad": np.arange(30.0),
        "heading_deg": np.full(30, 3.0),
    }
    drive, _ = drive_of(columns, "held")
    assert drive.compass_rad is not None
    assert np.flatnonzero(np.isfinite(drive.compass_rad)).tolist() == [0, 10, 20]


@pytest.mark.parametrize(("first", "last"), [(0, 15), (5, 20), (20, 30)])
def test_a_long_gap_of_a_sensor_is_reported(first: int, last: int) -> None:
    pitch_deg = np.full(30, 3.0)
    pitch_deg[first:last] = np.nan
    columns = {"t_s": 0.1 * np.arange(30.0), "position1_rad": np.arange(30.0), "pitch_deg": pitch_deg}
    drive, notes = drive_of(columns, "gappy")
    assert drive.pitch_rad == pytest.approx(np.full(30, math.radians(3.0)))
    assert [note for note in notes if note.startswith("pitch_deg has no data for 1.")]
    pitch_deg[first + 5 : last] = 3.0
    assert not [note for note in drive_of(columns, "gappy")[1] if "no data" in note]


def wheels(*ends: float) -> tuple[SensorRows, list[str]]:
    columns = {"t_s": np.arange(3.0)}
    columns |= {f"position{i + 1}_rad": np.linspace(5.0, 5.0 + end, 3) for i, end in enumerate(ends)}
    return drive_of(columns, "wheels")


def test_wheels_that_disagree_are_told() -> None:
    drive, notes = wheels(4.0, 4.1, 4.0, 4.1)
    assert drive.wheel_rad[-1] == pytest.approx(4.05)
    assert drive.wheel_yaw_rad[-1] == pytest.approx(0.05)
    assert notes == []
    drive, notes = wheels(4.0, -4.0, 4.0, -4.0)
    assert drive.wheel_rad[-1] == pytest.approx(0.0)
    drive, notes = wheels(4.0, -4.0, 4.0, 4.0)
    assert drive.wheel_rad[-1] == pytest.approx(4.0)
    assert "position2_rad turned against" in notes[0]
    drive, notes = wheels(4.0, 4.0, 0.1, 4.0)
    assert drive.wheel_rad[-1] == pytest.approx(4.0)
    assert "position3_rad turned by another angle" in notes[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no data"),
        ("t_s,position1_rad\n", "has no data"),
        ("t_s,position1_rad\n0,0\n0,1\n", "time does not increase"),
        ("t_s,position1_rad\n0,0\n,1\n", "time does not increase"),
        ("t_s,position1_rad\n0,0\n1,fast\n", "line 3, column 'position1_rad': 'fast' is not a number"),
        ("t_s,position1_rad\n0,0\n1\n", "line 3 has 1 cells, its header 2"),
        ("t_s,position1_rad,position1_rad\n0,0,0\n1,1,1\n", "twice"),
        ("position1_rad\n0\n1\n", "no column 't_s'"),
        ("t_s,yaw_rate_deg_s\n0,0\n1,1\n", "no wheel encoder"),
        ("t_s,position1_rad\n0,0\n", "needs two"),
    ],
)
def test_bad_logs(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(LogError, match=message):
        read_rows(path)
    out = tmp_path / "path.csv"
    with pytest.raises(LogError):
        run_scomp(path, params=None, out=out, online=False, as_json=False)
    assert not out.exists()


def test_missing_files(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot read"):
        read_rows(tmp_path / "none.csv")
    with pytest.raises(LogError, match="cannot read"):
        read_rows(tmp_path / "none.mcap")
    with pytest.raises(ConfigError, match="cannot read parameter file"):
        read_parameters(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t_s,x_m,y_m\n0,0,0\n1,1,1\n", "no column 'yaw_rad'"),
        (
            "t_s,x_m,y_m,yaw_rad\n0,0,0,0\n1,,1,0\n",
            "line 3, column 'x_m': '' is not a number: write a number or leave the row out",
        ),
        ("t_s,x_m,y_m,yaw_rad\n1,0,0,0\n0,1,1,0\n", "time does not increase"),
    ],
)
def test_bad_truths(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(text)
    with pytest.raises(LogError, match=message):
        read_truth(path)


def test_a_truth_that_crosses_half_a_turn(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("t_s,x_m,y_m,yaw_rad,slip\n0,0,0,3.1,0\n1,1,1,-3.1,0\n")
    assert read_truth(path).yaw_rad[1] == pytest.approx(2.0 * np.pi - 3.1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[pitch]\ncolour = 3\n", "pitch.colour"),
        ("[pitch]\nrolling_resistance = 9\n", "pitch.rolling_resistance"),
        ('schema = "other/1"\n', "schema"),
        ("[pitch\n", "not valid TOML"),
    ],
)
def test_bad_parameters(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_parameters(path)


def test_a_short_drive_cannot_be_identified(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", some(sideways().log))
    truth = write_csv(tmp_path / "truth.csv", some(sideways().truth))
    with pytest.raises(ModelError, match="8 are needed"):
        identify_scomp(log, truth=truth, out=tmp_path / "p.toml", pictures=None, as_json=False)
    assert not (tmp_path / "p.toml").exists()


def test_an_unwritable_path_is_told(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", some(sideways().log, 20))
    with pytest.raises(ConfigError, match="choose another --out"):
        run_scomp(log, params=None, out=tmp_path / "no" / "path.csv", online=False, as_json=False)
