"""Messages about a configuration that a newcomer meets: a wrong name, a wrong number, an unsuitable rover."""

from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.config import load_config
from tests.rover_hil.command import Command, assert_one_sentence

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    return Command(monkeypatch, capsys)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "nothere.toml",
            "no configuration nothere.toml: give a TOML file or one of el-dorado, el-dorado-camera, "
            "el-dorado-crab, robotino, robotino-camera",
        ),
        (
            "robotin",
            "no configuration robotin: give a TOML file or one of el-dorado, el-dorado-camera, "
            "el-dorado-crab, robotino, robotino-camera; did you mean robotino?",
        ),
    ],
)
def test_a_missing_configuration_is_called_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError) as caught:
        load_config(name)
    assert str(caught.value) == message


def test_a_mistake_in_a_plant_names_its_key_not_its_type(tmp_path: Path) -> None:
    text = (EXAMPLES / "differential.toml").read_text("utf-8")
    path = tmp_path / "my_rover.toml"
    start = text.index("mass_kg")
    path.write_text(text[:start] + "mass_kg = -8.0" + text[text.index("\n", start) :], "utf-8")
    with pytest.raises(ConfigError) as caught:
        load_config(str(path))
    assert "simulation.plant.mass_kg: input should be greater than 0, got -8.0" in str(caught.value)
    assert "simulation.plant.wheels:" not in str(caught.value)


def test_the_gyro_of_another_rover_is_refused_before_it_drives(command: Command, tmp_path: Path) -> None:
    out = tmp_path / "gyro.toml"
    rover = str(EXAMPLES / "differential.toml")
    assert command("calibrate", "imu", rover, "--virtual", "--out", str(out)) == 2
    assert_one_sentence(
        command.error,
        "omnidirectional wheels",
    )
    assert list(tmp_path.iterdir()) == []
