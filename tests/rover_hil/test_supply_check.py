"""`least_supply_v` needs a device that reports its supply voltage."""

from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.config import load_config, read_config_text
from rover_hil.run.checks import ROVER_CHECKS

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
REPORTING = ("robotino", "el-dorado", "robotino3_board.toml", "vesc.toml")


def with_limit(folder: Path, name: str) -> str:
    text = (EXAMPLES / name).read_text("utf-8") if name.endswith(".toml") else read_config_text(name)
    key = "least_supply_v = 20.0\n"
    text = (
        text.replace("\n[safety]\n", f"\n[safety]\n{key}")
        if "\n[safety]\n" in text
        else (f"{text}\n[safety]\n{key}")
    )
    path = folder / "rover.toml"
    path.write_text(text, "utf-8")
    return str(path)


@pytest.mark.parametrize("name", REPORTING)
def test_a_device_that_reports_its_supply_is_enough(tmp_path: Path, name: str) -> None:
    assert load_config(with_limit(tmp_path, name), ROVER_CHECKS).safety.least_supply_v == 20.0


def test_without_such_a_device_the_key_is_refused(tmp_path: Path) -> None:
    path = with_limit(tmp_path, "canopen_wheels.toml")
    with pytest.raises(ConfigError) as caught:
        load_config(path, ROVER_CHECKS)
    assert str(caught.value) == (
        f"{path}: safety.least_supply_v is 20 V, but no device reports its supply voltage: remove the key, "
        "or map the voltage in [power] of a can_wheels mapping"
    )
