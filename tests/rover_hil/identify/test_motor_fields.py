"""`rover-hil calibrate motors` on drives of which the field of each motor is known."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import LogError
from rover_hil.config import load_config, read_config_text
from rover_hil.ready.motors.fit import fit_motor_fields, read_motor_drive
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.identify.motor_logs import write_motor_drive

FIELDS = (0.05 - 0.03j, -0.04 + 0.02j, 0.02 + 0.06j, 0.03 - 0.05j)
EACH_BY_ITSELF = ((4, 0, 0, 0), (0, 3, 0, 0), (0, 0, -4, 0), (0, 0, 0, 3), (2, -2, 2, -2), (-1, 3, 2, 4))
ALWAYS_ALIKE = ((2, 2, 2, 2), (-2, -2, -2, -2))
DAY = "2026-05-04"


def as_rows(fields: tuple[complex, ...]) -> np.ndarray:
    return np.array([(each.real, each.imag) for each in fields])


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.slow
def test_the_field_of_each_motor_is_found(tmp_path: Path, seed: int) -> None:
    write_motor_drive(tmp_path / "drive.mcap", FIELDS, seed, patterns=EACH_BY_ITSELF)
    fit = fit_motor_fields(read_motor_drive(tmp_path / "drive.mcap", None), DAY)
    assert fit.problem == ""
    assert fit.fields.device == "compass"
    assert fit.separate.all()
    error = np.array(fit.fields.per_ampere) - as_rows(FIELDS)
    assert np.abs(error).max() < 0.003
    assert np.abs(error / np.array(fit.fields.per_ampere_sd)).max() < 3.0
    before, after = (math.sqrt(np.mean(each**2)) for each in (fit.before_deg, fit.after_deg))
    assert before > 3.0
    assert after < 0.6  # the noise of the compass is 0.4 deg


def test_motors_that_always_act_alike_are_named_and_uncertain(tmp_path: Path) -> None:
    """Their sum is known, and corrects such a drive; each by itself is known no better than before."""
    write_motor_drive(tmp_path / "drive.mcap", FIELDS, 3, patterns=ALWAYS_ALIKE, ripple=0.0)
    fit = fit_motor_fields(read_motor_drive(tmp_path / "drive.mcap", None), DAY)
    assert fit.problem == ""
    found, sd = np.array(fit.fields.per_ampere), np.array(fit.fields.per_ampere_sd)
    assert found.sum(axis=0) == pytest.approx(as_rows(FIELDS).sum(axis=0), abs=0.004)
    assert np.abs((found - as_rows(FIELDS)) / sd).max() < 3.0
    assert sd.min() > 0.05
    assert not fit.separate.any()
    assert math.sqrt(np.mean(fit.after_deg**2)) < 0.6


@pytest.mark.usefixtures("unrendered")
def test_motors_without_any_current_stay_unknown(command: Command, tmp_path: Path) -> None:
    write_motor_drive(tmp_path / "drive.mcap", FIELDS, 9, patterns=((4, 0, 0, 0), (-3, 0, 0, 0)), legs=16)
    assert command("calibrate", "motors", "drive.mcap", "--out", "m.toml") == 0
    assert "motors 2, 3, 4 had no current of their own" in command.out
    found = tomllib.loads(Path("m.toml").read_text("utf-8"))
    assert found["per_ampere"][0] == pytest.approx((0.05, -0.03), abs=0.005)
    assert found["per_ampere"][1:] == [[0.0, 0.0]] * 3
    assert min(sd for pair in found["per_ampere_sd"][1:] for sd in pair) > 0.1


def test_motors_that_do_not_matter_are_not_written(command: Command, tmp_path: Path) -> None:
    write_motor_drive(tmp_path / "drive.mcap", (0j,) * 4, 4, patterns=EACH_BY_ITSELF, legs=16)
    assert command("calibrate", "motors", "drive.mcap", "--out", "m.toml") == 1
    assert "not written: the motors hardly change the heading" in command.out
    assert not Path("m.toml").exists()
    assert "no correction is needed" in Path("m.html").read_text("utf-8")


def test_a_field_stronger_than_that_of_the_earth_is_refused(tmp_path: Path) -> None:
    write_motor_drive(tmp_path / "drive.mcap", (0.5 + 0j,) * 4, 8, patterns=EACH_BY_ITSELF, legs=16)
    problem = fit_motor_fields(read_motor_drive(tmp_path / "drive.mcap", None), DAY).problem
    assert "move the compass away" in problem or "error on held-out parts" in problem


def test_a_heading_that_is_no_number_is_left_out(tmp_path: Path) -> None:
    write_motor_drive(tmp_path / "drive.mcap", FIELDS, 3, patterns=EACH_BY_ITSELF, legs=16, lost_heading=300)
    fit = fit_motor_fields(read_motor_drive(tmp_path / "drive.mcap", None), DAY)
    assert np.isfinite(fit.before_deg).all()
    assert math.sqrt(np.mean(fit.after_deg**2)) < 0.6


def test_a_drive_in_one_direction_does_not_show_the_field(tmp_path: Path) -> None:
    """It is explained well by half of the field, which would be wrong in other directions."""
    write_motor_drive(tmp_path / "drive.mcap", FIELDS, 7, patterns=EACH_BY_ITSELF, turn_rad_s=0.05)
    with pytest.raises(LogError, match="drove in one direction only"):
        fit_motor_fields(read_motor_drive(tmp_path / "drive.mcap", None), DAY)


def test_the_result_is_entered_and_the_configuration_is_valid(command: Command, tmp_path: Path) -> None:
    write_motor_drive(tmp_path / "drive.mcap", FIELDS, 5, patterns=EACH_BY_ITSELF, legs=16)
    Path("rover.toml").write_text(read_config_text("el-dorado"), "utf-8")
    arguments = ("calibrate", "motors", "rover.toml", "--log", "drive.mcap", "--enter")
    assert command(*arguments, "--json") == 0, command.error
    assert json.loads(command.out)["file"] == "rover-compass-motors.toml"
    fields = load_config("rover.toml").filter.motor_fields
    assert fields is not None
    assert fields.device == "compass"
    assert command("check", "rover.toml") == 0
    # Of another rover: three wheels, no compass.
    text = read_config_text("robotino").replace(
        "[filter]\n", '[filter]\nmotor_fields = "rover-compass-motors.toml"\n'
    )
    Path("other.toml").write_text(text, "utf-8")
    assert command("check", "other.toml") == 1
    assert "per_ampere has 4 motors, the rover has 3 wheels" in command.out
    assert "the compass 'compass', which is not in roles.headings" in command.out


def test_bad_input_is_one_sentence(command: Command, tmp_path: Path) -> None:
    write_motor_drive(tmp_path / "none.mcap", FIELDS, 6, patterns=EACH_BY_ITSELF, legs=4, has_currents=False)
    write_motor_drive(tmp_path / "rest.mcap", FIELDS, 6, patterns=((0, 0, 0, 0),), legs=8)
    for arguments, words in (
        (("none.mcap", "--out", "m.toml"), "reports no current of the motors 0, 1, 2, 3"),
        (("rest.mcap", "--out", "m.toml"), "the currents change by less than 0.1 A"),
        (("rest.mcap", "--out", "m.toml", "--virtual"), "is a log"),
        (("rest.mcap",), "--out is missing"),
        (("el-dorado", "--enter"), "cannot be edited"),
    ):
        assert command("calibrate", "motors", *arguments) in (1, 2)
        assert_one_sentence(command.error, words)
    assert not Path("m.toml").exists()
