"""Configurations of three earlier states of the program are valid, or the message states the new key."""

from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.config import load_config
from rover_hil.config.moved_keys import REMOVED, RENAMED_VALUES

CONFIGS = Path(__file__).parent / "data" / "configs"
TOLD = {
    "2026-11-21-robotino.toml": ("simulation.plant.floor: ", "simulation.plant.patches: "),
    "2026-11-21-el-dorado.toml": ("simulation.plant: 'type' is called 'el_dorado' now",),
}


@pytest.mark.parametrize("path", sorted(CONFIGS.iterdir()), ids=lambda path: path.name)
def test_an_earlier_configuration_is_valid_or_told_the_key_of_today(path: Path) -> None:
    told = TOLD.get(path.name, ())
    if not told:
        load_config(str(path))
        return
    with pytest.raises(ConfigError) as caught:
        load_config(str(path))
    lines = str(caught.value).splitlines()
    assert len(lines) == len(told)
    for line, words in zip(lines, told, strict=True):
        assert line.startswith(f"{path}: {words}")
        assert "unknown key" not in line


def test_a_section_of_another_name_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    named = [path for path in CONFIGS.iterdir() if "[trace_slip]" in path.read_text("utf-8")]
    assert named
    load_config(str(named[0]))
    (line,) = capsys.readouterr().err.splitlines()
    assert "[trace_slip] is now called [scomp]" in line


def test_there_are_three_states_and_no_sentence_without_a_configuration() -> None:
    assert len({path.name[:10] for path in CONFIGS.iterdir()}) == 3
    text = "".join(path.read_text("utf-8") for path in CONFIGS.iterdir())
    assert all(key[-1] in text for key in (*REMOVED, *RENAMED_VALUES))


def test_slip_of_an_earlier_configuration_keeps_its_meaning(capsys: pytest.CaptureFixture[str]) -> None:
    config = load_config(str(CONFIGS / "2026-11-27-robotino.toml"))
    name, *numbers, by_way, by_rotation = config.ground.prior()
    assert (name, by_way, by_rotation) == ("unknown", None, 0.0)
    assert numbers == pytest.approx([0.0, 0.36, 0.3 * 0.36, 0.5, 0.0])
    assert config.tune is not None
    assert config.tune.logs is not None
    assert "ground.slip_sd" in config.tune.logs.parameters
    (line,) = capsys.readouterr().err.splitlines()
    assert "filter.unsure_slip_sd is now slip_sd in [ground]" in line
