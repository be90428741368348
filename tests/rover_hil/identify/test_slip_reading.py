from pathlib import Path

import numpy as np
import pytest

from controllers.slip.effort.motor_model import MotorSettings
from drivers.errors import LogError
from rover_hil.config import load_config
from rover_hil.drives.formats.robotino_csv import read_run
from rover_hil.drives.formats.to_log import observing_config, write_run_as_log
from rover_hil.identify.slip.runs import find_runs, read_windows, surface_of, surface_parts
from rover_hil.recording.writer import LogWriter
from tests.rover_hil.identify.slip_runs import NAMES, write_drive, write_rows

MOTOR = MotorSettings()
AVERAGED_NAMES = (
    "X axis speed, mm/s;Y axis speed, mm/s;Rotational speed, deg/s;"
    "Motor 1 velocity, rpm;Motor 2 velocity, rpm;Motor 3 velocity, rpm;"
    "Motor 1 current, A;Motor 2 current, A;Motor 3 current, A;Delta angle, deg;Delta X, mm;Delta Y, mm"
)


def write_log(csv: Path, log: Path, mm_per_px: float = 2.0) -> Path:
    run = read_run(csv, mm_per_px)
    for _ in write_run_as_log(run, csv.name, observing_config(load_config("robotino")), log):
        pass
    return log


@pytest.mark.parametrize("slip", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("name", ["exp00.csv", "exp00.csv.gz"])
def test_slip_of_a_turning_drive_is_found(tmp_path: Path, slip: float, name: str) -> None:
    path = write_drive(tmp_path / "sand_surface" / name, slip=slip, turn_rad_s=0.3)
    (run,) = read_windows(path, MOTOR)
    assert run.surface == "sand_surface"
    assert run.camera_in_pixels
    assert run.elapsed_s == pytest.approx(np.full(len(run.elapsed_s), 0.5), abs=0.035)
    effective = run.camera_wheel_speed_rad_s(0.002)
    assert effective == pytest.approx((1.0 - slip) * run.wheel_speed_rad_s, abs=0.02)
    assert 1.0 - run.camera_distance_m(0.002).sum() / run.encoder_distance_m().sum() == pytest.approx(
        slip, abs=0.002
    )


def test_currents_take_the_sign_of_their_wheels(tmp_path: Path) -> None:
    (run,) = read_windows(write_drive(tmp_path / "exp.csv", slip=0.2, direction_deg=100), MOTOR)
    steady = run.start_s > 0.5
    assert (np.sign(run.current_a) == np.sign(run.wheel_speed_rad_s))[steady].all()
    assert np.abs(run.current_a[steady]).max() == pytest.approx(0.8, abs=0.02)
    assert run.usable[steady].all()


def test_a_repeated_camera_row_is_no_frame(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "exp.csv", slip=0.4)
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = lines[3:]
    for index in range(17, len(rows), 17):
        cells, before = rows[index].split(";"), rows[index - 1].split(";")
        rows[index] = ";".join(cells[:14] + before[14:])
    (run,) = read_windows(write_rows(path, rows), MOTOR)
    slip = 1.0 - run.camera_distance_m(0.002) / run.encoder_distance_m()
    assert slip == pytest.approx(np.full(len(slip), 0.4), abs=0.01)


def test_a_log_tells_the_same_as_the_file_it_was_made_from(tmp_path: Path) -> None:
    csv = write_drive(tmp_path / "sand_surface" / "exp00.csv", slip=0.3)
    (expected,) = read_windows(csv, MOTOR)
    (run,) = read_windows(write_log(csv, tmp_path / "sand_surface" / "exp00.mcap"), MOTOR)
    assert (run.surface, run.camera_in_pixels) == ("sand_surface", False)
    assert run.camera_distance_m(9.9) == pytest.approx(expected.camera_distance_m(0.002), rel=1e-3)
    assert run.encoder_distance_m() == pytest.approx(expected.encoder_distance_m(), rel=1e-3)
    assert run.wheel_torque_nm[1:] == pytest.approx(expected.wheel_torque_nm[1:], rel=0.02)


def test_saturated_currents_are_not_usable(tmp_path: Path) -> None:
    (run,) = read_windows(write_drive(tmp_path / "exp.csv", slip=0.2, current_a=6.55), MOTOR)
    assert not run.usable.any()


def test_zero_currents_on_turning_wheels_were_not_measured(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"current of wheel 0 is zero throughout although the wheel turns"):
        read_windows(write_drive(tmp_path / "exp.csv", slip=0.2, current_a=0.0), MOTOR)


def test_a_missing_wheel_is_named(tmp_path: Path) -> None:
    names = NAMES.replace("m3cur", "other")
    path = write_rows(tmp_path / "exp.csv", ["0" + ";0" * 16 + ";"], names=names)
    with pytest.raises(LogError, match="names no column 'm3cur'"):
        read_windows(path, MOTOR)


def test_a_clock_that_goes_backwards_is_refused(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "exp.csv", slip=0.2)
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[20], lines[21] = lines[21], lines[20]
    path.write_text("\n".join((*lines, "")), encoding="utf-8")
    with pytest.raises(LogError, match=r"line 22, column 't'.*not after the line before"):
        read_windows(path, MOTOR)


def test_a_short_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"less than 0\.5 s of camera and wheels"):
        read_windows(write_drive(tmp_path / "exp.csv", slip=0.2, duration_s=0.2), MOTOR)


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        ([], "holds no positions of wheel 0"),
        ([{"wheel": 0, "position_rad": 1.0}], "holds no currents of wheel 0"),
        ([{"wheel": 0, "position_rad": 1.0, "current_a": 0.1}], "holds no positions of wheel 1"),
        (
            [{"wheel": wheel, "position_rad": 1.0, "current_a": 0.1} for wheel in range(3)],
            "holds no true pose",
        ),
    ],
)
def test_what_a_log_lacks_is_named(tmp_path: Path, samples: list[dict[str, float]], message: str) -> None:
    config = load_config("robotino")
    path = tmp_path / "run.mcap"
    device = config.roles.wheels
    with LogWriter(path, 1, config.model_dump_json(by_alias=True).encode(), {}, "test") as log:
        records = [{"device": device, "t_ns": 5, **sample} for sample in samples]
        log.write_json("/samples", 5, {"WheelSample": records})
    with pytest.raises(LogError, match=message):
        read_windows(path, MOTOR)


def test_a_log_whose_clock_goes_backwards_is_refused(tmp_path: Path) -> None:
    config = load_config("robotino")
    path = tmp_path / "run.mcap"
    with LogWriter(path, 1, config.model_dump_json(by_alias=True).encode(), {}, "test") as log:
        for t_ns in (50, 40):
            wheels = [
                {
                    "device": config.roles.wheels,
                    "t_ns": t_ns,
                    "wheel": n,
                    "position_rad": 1.0,
                    "current_a": 1.0,
                }
                for n in range(3)
            ]
            log.write_json("/samples", t_ns, {"WheelSample": wheels})
            log.write_json("/truth", t_ns, {"t_ns": t_ns, "x_m": 0.0, "y_m": 0.0, "yaw_rad": 0.0})
    with pytest.raises(LogError, match="its clock goes backwards or does not advance"):
        read_windows(path, MOTOR)


def test_averaged_rows_become_drives(tmp_path: Path) -> None:
    rows = ["100;0;0;-245;0;245;0.9;0.01;0.9;0;20;0"] * 4 + ["0;0;30;80;80;80;0.5;0.5;0.5;9;0;0"] * 2
    rows += ["0;100;0;140;-280;140;0.5;1.1;0.5;0;0;30"] * 3
    path = tmp_path / "experimental_data_blue.csv"
    path.write_text("\n".join((AVERAGED_NAMES, *rows)), encoding="utf-8")
    forward, left = read_windows(path, MOTOR)
    assert (forward.surface, len(forward.elapsed_s), len(left.elapsed_s)) == ("blue_surface", 4, 3)
    assert forward.camera_distance_m(9.9) == pytest.approx([0.02] * 4)
    # 245 rpm, gear 16, radius 40 mm, wheels at 60 degrees to the way.
    assert forward.encoder_distance_m() == pytest.approx(
        [0.5 * 245 / 60 * 2 * np.pi / 16 * 0.04 / 0.8660] * 4, rel=1e-3
    )
    assert left.encoder_velocity[0, 1] > 0
    assert forward.usable.tolist() == [[True, False, True]] * 4


@pytest.mark.parametrize(
    ("names", "row", "message"),
    [
        (
            AVERAGED_NAMES.replace("Motor 2 current, A", "x"),
            "1" + ";1" * 11,
            "no column 'Motor 2 current, A'",
        ),
        (AVERAGED_NAMES, "1;2", "line 2 has 2 cells, its header 12"),
        (AVERAGED_NAMES, "1" + ";nan" * 11, r"line 2, column .Y axis speed, mm/s.: .nan. is not a number"),
        (AVERAGED_NAMES, "", "holds no lines below its header"),
    ],
)
def test_wrong_averages_are_refused(tmp_path: Path, names: str, row: str, message: str) -> None:
    path = tmp_path / "experimental_data_red.csv"
    path.write_text(f"{names}\n{row}\n", encoding="utf-8")
    with pytest.raises(LogError, match=message):
        read_windows(path, MOTOR)


def test_folders_are_searched_and_other_files_listed(tmp_path: Path) -> None:
    run = write_drive(tmp_path / "a" / "sand_surface" / "exp00.csv.gz", slip=0.1)
    motor = write_rows(tmp_path / "a" / "motor" / "bench.csv", [], names="t;m1setvel;m1pos;m1cur;", units="")
    notes = tmp_path / "a" / "notes.md"
    notes.write_text("-", encoding="utf-8")
    found = find_runs([tmp_path / "a", run])
    assert found.files == (run,)
    assert found.other_files == (motor, notes)


@pytest.mark.parametrize(("name", "message"), [("empty", "holds no run"), ("missing", "does not exist")])
def test_nothing_to_read_is_said(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "notes.md").write_text("-", encoding="utf-8")
    with pytest.raises(LogError, match=message):
        find_runs([tmp_path / name])


def test_a_surface_is_named_by_its_folder() -> None:
    assert surface_of(Path("/data/green_surface/exp00.csv.gz")) == "green_surface"
    assert surface_of(Path("/data/experimental_data_red.csv")) == "red_surface"


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("green_table", ["green_surface", "table_surface"]),
        ("green_surface", ["green_surface"]),
        ("green_sand", ["green_sand"]),
        ("lawn", ["lawn"]),
    ],
)
def test_a_field_of_two_surfaces_is_taken_apart(name: str, parts: list[str]) -> None:
    assert surface_parts(name, ["green_surface", "table_surface", "gray_surface"]) == parts
