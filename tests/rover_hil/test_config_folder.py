"""File names in a configuration count from its folder; those from the current folder still work."""

import shutil
from pathlib import Path

import pytest

from drivers.can_wheels.settings import CanWheelsSettings
from drivers.errors import ConfigError
from rover_hil.config import load_config
from tests.rover_hil.command import Command

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
MAPPING = 'mapping = "docs/examples/can/differential.toml"'


def write_rover(folder: Path, mapping: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    text = (EXAMPLES / "differential.toml").read_text("utf-8")
    assert MAPPING in text
    (folder / "rover.toml").write_text(text.replace(MAPPING, f'mapping = "{mapping}"'), "utf-8")
    return folder / "rover.toml"


def mapping_of(path: Path) -> str:
    device = load_config(str(path)).devices["wheels"]
    assert isinstance(device, CanWheelsSettings)
    return device.mapping


def test_a_mapping_beside_the_configuration_is_found_from_anywhere(command: Command, tmp_path: Path) -> None:
    path = write_rover(tmp_path / "own", "can/differential.toml")
    shutil.copytree(EXAMPLES / "can", tmp_path / "own" / "can")
    for start in (tmp_path, tmp_path / "own"):
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(start)
            place = path.relative_to(start)
            assert Path(mapping_of(place)).samefile(tmp_path / "own" / "can" / "differential.toml")
            assert command("check", str(place)) == 0, command.out


def test_a_mapping_from_the_current_folder_is_found_as_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_rover(tmp_path / "own", "can/differential.toml")
    shutil.copytree(EXAMPLES / "can", tmp_path / "can")
    monkeypatch.chdir(tmp_path)
    assert mapping_of(path) == "can/differential.toml"


def test_the_file_beside_the_configuration_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_rover(tmp_path / "own", "can/differential.toml")
    for folder in (tmp_path, tmp_path / "own"):
        shutil.copytree(EXAMPLES / "can", folder / "can")
    monkeypatch.chdir(tmp_path)
    assert mapping_of(path) == str(tmp_path / "own" / "can" / "differential.toml")


def test_a_shipped_mapping_and_an_absolute_path_stay(tmp_path: Path) -> None:
    assert mapping_of(write_rover(tmp_path / "own", "generic_wheel")) == "generic_wheel"
    absolute = str(EXAMPLES / "can" / "differential.toml")
    assert mapping_of(write_rover(tmp_path / "own", absolute)) == absolute


def test_a_slip_map_beside_the_configuration_is_read(tmp_path: Path) -> None:
    text = '[slip]\nmaps = "own_map.toml"\n'
    (tmp_path / "rover.toml").write_text(text, "utf-8")
    (tmp_path / "own_map.toml").write_text("not = [a map", "utf-8")
    with pytest.raises(ConfigError, match=r"own_map\.toml is not valid TOML"):
        load_config(str(tmp_path / "rover.toml"))
