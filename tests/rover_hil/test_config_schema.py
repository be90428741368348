"""The JSON schema for editors accepts every shipped configuration, and rejects what the program rejects."""

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft7Validator

from docs.generate.schema_file import schema_text as generated_text
from drivers.errors import ConfigError
from rover_hil.config import load_config, read_config_text, schema_text, shipped_configs
from rover_hil.config.loader import SCHEMA_NAME

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.toml"))
CONFIGS = [*shipped_configs(), *map(str, EXAMPLES)]
SCHEMA = json.loads(schema_text())
VALIDATOR = Draft7Validator(SCHEMA)


def is_valid(table: Any) -> bool:
    return bool(VALIDATOR.is_valid(table))


def test_the_committed_schema_is_up_to_date() -> None:
    assert schema_text() == generated_text(), "run `make reference`"
    assert (ROOT / "docs" / "reference" / SCHEMA_NAME).read_text("utf-8") == schema_text()
    Draft7Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("name", CONFIGS)
def test_a_configuration_fits_the_schema_that_it_names(name: str) -> None:
    text = read_config_text(name)
    assert [error.message for error in VALIDATOR.iter_errors(tomllib.loads(text))] == []
    folder = ROOT / "rover_hil" / "config" / "shipped" / "configs" if name in shipped_configs() else None
    line = text.splitlines()[0]
    assert line.startswith("#:schema ")
    assert ((folder or Path(name).parent) / line.removeprefix("#:schema ")).resolve().is_file()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("base_radius_m = 0.125", "base_radius = 0.125"),
        ("rate_hz = 50", "rate_hz = 5000"),
        ("rate_hz = 50", 'rate_hz = "fast"'),
        ("wheel_radius_m = 0.040\n", ""),
        ('type = "robotino_board"', 'type = "robotino_bord"'),
        ('type = "robotino_board"\n', ""),
        ('kinematics = "omni3"', 'kinematics = "omni4"'),
        ('schema = "rover-hil-config/1"', 'schema = "rover-hil-config/2"'),
        ("[limits]", "[limit]"),
        ('scale = "log"', 'scale = "logarithmic"'),
        ("speed_m_s = 0.15", "speed_m_s = 15"),
        ("seed = 3", "seed = -3"),
        ('frames = ["rate"]', "frames = []"),
    ],
)
def test_the_schema_rejects_what_the_program_rejects(tmp_path: Path, old: str, new: str) -> None:
    text = read_config_text("robotino")
    assert old in text
    path = tmp_path / "rover.toml"
    path.write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(ConfigError):
        load_config(str(path))
    assert not is_valid(tomllib.loads(path.read_text("utf-8")))


def test_every_key_has_a_meaning_and_no_key_takes_null() -> None:
    def tables(value: Any) -> list[Any]:
        found = [value] if isinstance(value, dict) and "properties" in value else []
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        return found + [table for item in inner for table in tables(item)]

    assert '"null"' not in schema_text()
    places = [(key, place) for table in tables(SCHEMA) for key, place in table["properties"].items()]
    assert len(places) > 300
    assert [key for key, place in places if "description" not in place] == []
    (radius,) = {place["description"] for key, place in places if key == "base_radius_m"}
    assert radius == "Distance of each wheel from the origin. [m]"
