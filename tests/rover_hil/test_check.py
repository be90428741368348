"""`rover-hil check` finds every mistake at once, as run, simulate, tune and doctor do, and opens no port."""

import json
import re
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.config import Rule, load_config, read_config_text, schema_text, shipped_configs
from rover_hil.doctor.configuration.progress_sources import describe_progress
from rover_hil.ready.check import TUNE_RULE
from rover_hil.run.checks import RUN_CHECKS
from rover_hil.tune.parameters import TUNE_CHECKS, check_parameters
from tests.rover_hil.command import Command, assert_one_sentence

MANY_MISTAKES = (
    ("base_radius_m = 0.125", "base_radius = 0.125"),
    ("rate_hz = 50", "rate_hz = 5000"),
    ('gyro = "imu"', 'gyro = "imus"'),
    ('port = "ports/imu"', 'port = "ports/board"'),
    ("length_m = 0.9", 'length_m = "long"'),
    ("[simulation]", "[simulations]"),
    ("low = 0.03, high = 1.5", "low = 1.5, high = 0.03"),
)


def write(folder: Path, name: str, *edits: tuple[str, str]) -> str:
    text = read_config_text(name)
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "rover.toml").write_text(text, "utf-8")
    return "rover.toml"


@pytest.mark.parametrize("name", shipped_configs())
def test_a_shipped_configuration_is_valid_and_ready_for_all(command: Command, name: str) -> None:
    assert command("check", name) == 0
    assert f"{name} is valid" in command.out
    for line in ("run: yes", "run --virtual: yes", "simulate: yes", "tune: yes"):
        assert f"  {line}\n" in command.out


def test_what_notices_a_rover_that_does_not_get_on_is_named(command: Command, tmp_path: Path) -> None:
    assert command("check", "robotino") == 0
    told = describe_progress(load_config("robotino"))
    assert f"  entrapment: {told}\n" in command.out
    excitation, currents, encoder = told.split("; ")
    assert excitation.endswith(
        "by the yaw excitation, on the real rover after commissioning: stopped once after 1.5 m"
    )
    assert currents.endswith("where they are far from those of free driving: stopped once after 1.5 m")
    assert encoder == "a wheel that sticks stops it after 1 s, by its encoder"
    assert command("check", "robotino-camera", "--json") == 0
    entrapment = json.loads(command.out)["entrapment"]
    assert entrapment.startswith("camera shows no progress: stopped after 0.15 m of the wheels; ")
    assert command("check", "el-dorado", "--json") == 0
    assert "camera sees no motion of the ground, or is covered: " in json.loads(command.out)["entrapment"]
    without = write(tmp_path, "robotino", ('use = "yaw_probe"', 'use = "surfaces"'))
    assert command("check", without, "--json") == 0
    assert json.loads(command.out)["entrapment"].startswith(
        "wheels in the air, digging in and a wall by the "
    )
    alone = load_config("robotino").model_copy(update={"slip": None})
    assert describe_progress(alone).startswith("nothing notices wheels in the air, ")


def test_the_sources_of_slip_are_named_with_the_error_of_the_rig(command: Command, tmp_path: Path) -> None:
    assert command("check", "robotino") == 0
    assert (
        "  slip: yaw excitation (on the real rover after commissioning), then encoders, which assume rolling "
        "wheels\n"
    ) in command.out
    section = ("[scomp]", '[ground_motion]\nrig = "el-dorado"\n\n[scomp]')
    assert command("check", write(tmp_path, "el-dorado", section)) == 0
    found = re.search(
        r"  slip: ground motion by camera, travel (\d\.\d) % uncertain by its rig (\(.*\)), then (.*)",
        command.out,
    )
    assert found is not None
    assert 1.0 < float(found[1]) < 2.5
    assert found[2].startswith("(1 % of the camera's height or focal length is about 0.01 of slip; too long")
    assert found[3] == "slip law with the wheel trace by camera, then encoders, which assume rolling wheels"


def test_of_a_calibrated_scale_no_error_of_height_and_focal_length_is_told(
    command: Command, tmp_path: Path
) -> None:
    tolerance = "tolerance = {scale = 1.02, scale_sd = 0.004}"
    section = ("[scomp]", f'[ground_motion]\nrig = "el-dorado"\n{tolerance}\n\n[scomp]')
    assert command("check", write(tmp_path, "el-dorado", section)) == 0
    assert "uncertain by its rig, then slip law" in command.out


def test_a_camera_without_a_rig_of_its_own_is_a_mistake(command: Command, tmp_path: Path) -> None:
    without = ('rig = "el-dorado"', "")
    assert command("check", write(tmp_path, "el-dorado", without)) == 1
    assert "roles.camera: its calibration is missing: add ground_motion.rig or scomp.rig" in command.out


def test_a_yaw_that_nothing_watches_on_the_real_rover_is_a_warning(command: Command, tmp_path: Path) -> None:
    assert command("check", "robotino") == 0
    assert "warning: yaw unwatched: " in command.out
    commissioned = ('use = "yaw_probe"', 'use = "yaw_probe"\nexcite_real_rover = true')
    assert command("check", write(tmp_path, "robotino", commissioned)) == 0
    assert "unwatched" not in command.out


@pytest.mark.parametrize("name", shipped_configs())
def test_a_shipped_configuration_can_be_tuned_as_it_is(name: str) -> None:
    config = load_config(name, TUNE_CHECKS)
    assert len(check_parameters(config).parameters) >= 3


def test_a_command_that_lacks_a_section_says_which(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "rover.toml"
    text = read_config_text("robotino")
    path.write_text(text[: text.index("[tune.")], "utf-8")
    assert command("check", str(path)) == 0
    assert command.out.count("tune: ") == 1


def test_every_mistake_is_printed_at_once(command: Command, tmp_path: Path) -> None:
    path = write(tmp_path, "robotino", *MANY_MISTAKES)
    assert command("check", path) == 1
    for words in (
        "rover.base_radius: unknown key; did you mean base_radius_m?",
        "loop.rate_hz: ",
        "roles.gyro: [devices] has no 'imus'",
        "devices.imu.port: 'ports/board' is already the port of device 'board'",
        "mission.length_m: ",
        "simulations: unknown key; did you mean simulation?",
        "tune.parameters.mission.lookahead_m: low 1.5 is not below high 0.03",
        "7 mistakes: correct them",
    ):
        assert words in command.out
    assert command.error == ""


@pytest.mark.parametrize("rules", [(*RUN_CHECKS, TUNE_RULE), TUNE_CHECKS])
@pytest.mark.parametrize(
    "edit", [('gyro = "imu"', 'gyro = "nosuch"'), ('port = "ports/imu"', 'port = "ports/board"')]
)
def test_ranges_to_tune_are_judged_only_where_all_else_is_right(
    tmp_path: Path, rules: tuple[Rule, ...], edit: tuple[str, str]
) -> None:
    path = write(tmp_path, "robotino", edit)
    with pytest.raises(ConfigError) as caught:
        load_config(str(tmp_path / path), rules)
    assert len(str(caught.value).splitlines()) == 1
    assert edit[1].split('"')[1] in str(caught.value)


def test_more_mistakes_than_an_error_has_lines(command: Command, tmp_path: Path) -> None:
    path = write(
        tmp_path, "robotino", ("[limits]", "".join(f"[wrong_{n}]\n" for n in range(40)) + "[limits]")
    )
    assert command("check", path) == 1
    assert "wrong_39: unknown key" in command.out
    assert "40 mistakes" in command.out


def test_what_only_shows_when_the_rover_is_put_together_is_found(command: Command, tmp_path: Path) -> None:
    slow_line = ('port = "ports/imu"', 'port = "ports/imu"\nbaud_rate = 4800')
    assert command("check", write(tmp_path, "robotino", slow_line)) == 1
    assert "simulated device 'imu' needs 5500 bit/s, its line has 4800" in command.out


def test_times_that_stop_the_rover_are_a_mistake(command: Command, tmp_path: Path) -> None:
    path = write(tmp_path, "robotino", ("settle_s = 3.0", "settle_s = 3.0\nexpiry_s = 0.02"))
    assert command("check", path) == 1
    assert "expiry_s = 0.02 is less than two periods" in command.out


def test_a_missing_section_is_no_mistake_but_a_lack(command: Command, tmp_path: Path) -> None:
    text = read_config_text("robotino").partition("# Everything below describes the simulated rover")[0]
    (tmp_path / "rover.toml").write_text(text, "utf-8")
    assert command("check", "rover.toml", "--json") == 0
    record = json.loads(command.out)
    assert record["verdict"] == "valid"
    assert record["mistakes"] == []
    assert record["commands"]["run"] == ""
    for name in ("run --virtual", "simulate", "tune"):
        assert record["commands"][name].startswith("simulation: this key is missing")


def test_no_file_is_bad_input(command: Command) -> None:
    assert command("check", "nowhere.toml") == 2
    assert_one_sentence(command.error, "no configuration nowhere.toml")


def test_a_file_that_is_not_toml_is_bad_input(command: Command, tmp_path: Path) -> None:
    (tmp_path / "rover.toml").write_text("[rover\n", "utf-8")
    assert command("check", "rover.toml") == 2
    assert_one_sentence(command.error, "rover.toml is not valid TOML")


def test_the_schema_is_written_for_an_editor_and_never_over_a_file(command: Command, tmp_path: Path) -> None:
    (tmp_path / "taken.json").write_text("mine")
    assert command("check", "robotino", "--schema", "taken.json") == 2
    assert_one_sentence(command.error, "--force", "--schema")
    assert command("check", "robotino", "--schema", "/proc/schema.json") == 2
    assert_one_sentence(command.error, "choose another --schema")
    assert command("check", "robotino", "--schema", "rover.schema.json") == 0
    assert (tmp_path / "rover.schema.json").read_text("utf-8") == schema_text()
    assert command.out.endswith("schema: rover.schema.json\n")
