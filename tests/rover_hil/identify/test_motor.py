import json
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import ConfigError, LogError
from rover_hil.config import load_config
from rover_hil.drives.formats.robotino_csv import read_run
from rover_hil.drives.formats.to_log import observing_config, write_run_as_log
from rover_hil.identify.motor.command import identify_motor
from rover_hil.identify.motor.identify import find_logs, identify, read_records
from rover_hil.identify.motor.log import read_log
from rover_hil.identify.motor.report import MotorReport
from rover_hil.identify.motor.robotino import read_table
from tests.nature.motor import Measured, TrueMotor, measure, staircase, write_csv

SOFT = TrueMotor(kp=20, inertia_kg_m2=4.1e-5)
FREE = TrueMotor()
PROFILE = staircase((30.0, 70.0, 110.0, 150.0), hold_s=1.5, rest_s=0.7)
REASONS = {"resistance_ohm": "no voltage", "torque_constant_nm_per_a": "ratios to Kt"}

Lines = list[list[str]]


@pytest.fixture(scope="module")
def soft() -> Measured:
    return measure(SOFT, PROFILE, 3, np.random.default_rng(5), friction_spread=0.02)


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> Path:
    measured = measure(FREE, PROFILE, 3, np.random.default_rng(6), friction_spread=0.02)
    return write_csv(tmp_path_factory.mktemp("free") / "free.csv", measured, (0, 1, 2))


@pytest.fixture(scope="module")
def reports(free: Path) -> Sequence[MotorReport]:
    return identify(read_records(free), lambda: None)


@pytest.fixture
def fitted(reports: Sequence[MotorReport], monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit the record of `free` once for all tests that only look at what is printed or written of it."""
    monkeypatch.setattr("rover_hil.identify.motor.command.identify", lambda records, on_motor, calls: reports)


def run_json(capsys: pytest.CaptureFixture[str], *logs: Path) -> tuple[int, list[dict[str, Any]]]:
    code = identify_motor([*logs], out=None, as_json=True)
    return code, json.loads(capsys.readouterr().out)["motors"]


def by_name(motor: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {estimate["name"]: estimate for estimate in motor["estimates"]}


def changed(path: Path, change: Callable[[list[str], Lines], None]) -> Path:
    """Rewrite a file with its columns' names and rows changed."""
    lines = path.read_text(encoding="utf-8").splitlines()
    names, rows = lines[2].split(";"), [line.split(";") for line in lines[3:]]
    change(names, rows)
    head = [lines[0], lines[1], ";".join(names)]
    copy = path.with_name("changed.csv")
    copy.write_text("\n".join([*head, *(";".join(row) for row in rows)]), encoding="utf-8")
    return copy


def test_everything_is_found_where_the_voltage_is_measured_and_the_loop_is_slow(
    soft: Measured, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, motors = run_json(capsys, write_csv(tmp_path / "soft.csv.gz", soft, (0, 1, 2), voltage=True))
    assert code == 0
    truth = {
        "coulomb_nm": (SOFT.coulomb_nm, 0.1),
        "inertia_kg_m2": (SOFT.inertia_kg_m2, 0.1),
        "resistance_ohm": (SOFT.resistance_ohm, 0.1),
        "speed_constant_v_s_per_rad": (SOFT.speed_constant_v_s, 0.05),
        "torque_constant_nm_per_a": (SOFT.torque_constant_nm_a, 0.05),
        "delay_s": (SOFT.delay_s, 0.03),
        "lag_s": (0.0468, 0.03),
        "droop_rad_s_per_a": (58.2, 0.1),
        "gain": (0.8167, 0.02),
    }
    for motor in motors:
        found = by_name(motor)
        for name, (value, share) in truth.items():
            assert found[name]["determined"], name
            assert found[name]["value"] == pytest.approx(value, rel=share), name
            assert found[name]["low"] < found[name]["value"] < found[name]["high"]
        assert motor["undetermined"] == []
        assert motor["fitted"]["current_a"] < motor["data_sheet"]["current_a"]


@pytest.mark.usefixtures("fitted")
def test_without_voltage_only_ratios_to_kt_are_given(free: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, motors = run_json(capsys, free)
    assert code == 0
    for motor in motors:
        found = by_name(motor)
        for name, words in REASONS.items():
            assert found[name]["value"] is None
            assert not found[name]["determined"]
            assert words in found[name]["why"]
        assert found["coulomb_a"]["value"] == pytest.approx(
            FREE.coulomb_nm / FREE.torque_constant_nm_a, rel=0.1
        )
        assert found["coulomb_nm"]["value"] == pytest.approx(found["coulomb_a"]["value"] * 0.0514)
        assert not found["coulomb_nm"]["determined"]
        assert "held" in found["coulomb_nm"]["why"]
        assert found["delay_s"]["low"] < FREE.delay_s + 1 / 1800 < found["delay_s"]["high"]
        assert any("Kt" in words and "ratios" in words for words in motor["undetermined"])


@pytest.mark.usefixtures("fitted")
def test_people_see_every_name_value_and_reason(
    free: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    identify_motor([free], out=None, as_json=False)
    printed = capsys.readouterr().out
    assert "speed_constant_v_s_per_rad" in printed
    assert "resistance_ohm, speed_constant_v_s_per_rad: no voltage was measured" in " ".join(printed.split())
    assert "…" not in printed
    assert "rolling" not in printed


@pytest.mark.nightly
def test_friction_on_the_ground_is_not_taken_for_the_motor_s_own(
    free: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def load(names: list[str], rows: Lines) -> None:
        for row in rows:
            for column in ("m1cur", "m2cur", "m3cur"):
                row[names.index(column)] = f"{3.0 * float(row[names.index(column)]):.6g}"

    _, motors = run_json(capsys, changed(free, load))
    assert all(any("contains what rolling costs" in note for note in motor["notes"]) for motor in motors)


@pytest.mark.usefixtures("fitted")
def test_inertia_is_not_given_where_the_speed_settles_between_two_samples(
    free: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, motors = run_json(capsys, free)
    for motor in motors:
        for name in ("inertia_kg_m2", "inertia_a_s2_per_rad", "lag_s"):
            assert by_name(motor)[name]["value"] is None
            assert "between two samples" in by_name(motor)[name]["why"]


def test_a_wheel_that_is_never_told_to_turn_teaches_nothing(
    free: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def rest(names: list[str], rows: Lines) -> None:
        for column in ("m2setvel", "m2pos", "m2vel", "m2cur"):
            for row in rows:
                row[names.index(column)] = "0"

    _, motors = run_json(capsys, changed(free, rest))
    assert [motor["motor"] for motor in motors] == [1, 2, 3]
    assert all(estimate["value"] is None for estimate in motors[1]["estimates"])
    assert all("always 0" in estimate["why"] for estimate in motors[1]["estimates"])
    assert by_name(motors[0])["coulomb_a"]["determined"]


def test_one_constant_set_point_determines_no_friction(
    free: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def cut(names: list[str], rows: Lines) -> None:
        hold = [row for row in rows if 0.4 < float(row[names.index("t")]) / 1000 < 1.4]
        rows[:] = hold

    code, motors = run_json(capsys, changed(free, cut))
    assert code == 1
    for motor in motors:
        assert all(estimate["value"] is None for estimate in motor["estimates"])


def test_a_saturated_current_gives_no_number(free: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def clip(names: list[str], rows: Lines) -> None:
        for row in rows:
            for column in ("m1cur", "m2cur", "m3cur"):
                place = names.index(column)
                row[place] = f"{min(float(row[place]), 8 * 4 / 156):.6g}"

    code, motors = run_json(capsys, changed(free, clip))
    assert code == 1
    assert all("saturated at 0.21 A" in item["why"] for motor in motors for item in motor["estimates"])


def drop_current(names: list[str], rows: Lines) -> None:
    names[names.index("m3cur")] = "other"


def turn_clock_back(names: list[str], rows: Lines) -> None:
    rows[100][names.index("t")] = rows[90][names.index("t")]


def spoil_number(names: list[str], rows: Lines) -> None:
    rows[7][names.index("m1cur")] = "nan"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (drop_current, "names no column 'm3cur'"),
        (turn_clock_back, r"line 104, column .t.: .* is negative or not after the line before"),
        (spoil_number, "line 11, column .m1cur.: .nan. is not a number"),
    ],
)
def test_wrong_tables_are_refused_in_one_sentence(
    free: Path, change: Callable[[list[str], Lines], None], words: str
) -> None:
    with pytest.raises(LogError, match=words) as caught:
        read_records(changed(free, change))
    assert "\n" not in str(caught.value)


def test_paths_without_logs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="is not a log and holds none"):
        find_logs([tmp_path])
    with pytest.raises(LogError, match="is not a log and holds none"):
        find_logs([tmp_path / "missing.csv"])


@pytest.mark.usefixtures("fitted")
def test_the_data_file_holds_what_is_determined_and_is_never_overwritten(free: Path, tmp_path: Path) -> None:
    out = tmp_path / "motor.toml"
    identify_motor([free], out=out, as_json=False)
    data = tomllib.loads(out.read_text(encoding="utf-8"))
    assert data["schema"] == "rover-hil-motor/1"
    assert data["source"] == [str(free)]
    motor = data["motor"][0]
    assert motor["speed_range_rad_s"][1] == pytest.approx(145, rel=0.05)
    assert motor["coulomb_a"]["low"] < motor["coulomb_a"]["value"] < motor["coulomb_a"]["high"]
    assert "value" not in motor["resistance_ohm"]
    with pytest.raises(ConfigError, match="exists"):
        identify_motor([free], out=out, as_json=False)


def test_a_log_and_the_table_it_was_imported_from_tell_the_same(shared_data: Path, tmp_path: Path) -> None:
    table = shared_data / "robotino_2023/one_surface_type/table_surface/exp24.csv.gz"
    log = tmp_path / "run.mcap"
    for _ in write_run_as_log(
        read_run(table, 2.0), table.name, observing_config(load_config("robotino")), log
    ):
        pass
    for ours, theirs in zip(read_log(log), read_table(table), strict=True):
        for name in ("set_point", "speed", "current", "position"):
            mine, other = getattr(ours, name), getattr(theirs, name)
            np.testing.assert_allclose(mine.value, other.value, atol=1e-4, err_msg=name)
            np.testing.assert_allclose(mine.t_s - mine.t_s[0], other.t_s - other.t_s[0], atol=1e-6)
        assert ours.scale.current_a == pytest.approx(theirs.scale.current_a)
        assert ours.scale.position_rad == pytest.approx(theirs.scale.position_rad)


def test_the_fit_predicts_the_measured_record_better_than_the_data_sheet(
    shared_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = "robotino_2023/motor_identification/data_for_identification_without_integral.csv.gz"
    code, motors = run_json(capsys, shared_data / record)
    assert code == 0
    for motor in motors:
        found = by_name(motor)
        assert motor["fitted"]["current_a"] < 0.98 * motor["data_sheet"]["current_a"]
        assert motor["fitted"]["speed_rad_s"] < 0.9 * motor["data_sheet"]["speed_rad_s"]
        assert found["coulomb_a"]["value"] == pytest.approx(0.175, abs=0.02)
        assert found["gain"]["value"] == pytest.approx(0.99, abs=0.01)
        assert found["delay_s"]["value"] == pytest.approx(0.12, abs=0.015)
        assert "positions contradict the reported speeds and are not used" in motor["notes"]
