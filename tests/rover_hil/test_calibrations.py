"""Every calibration is a folder, found by its name, and follows the one procedure."""

import inspect
from importlib import import_module

import pytest
from typer.main import get_command

from rover_hil.app.app import COMMANDS, app
from rover_hil.app.lazy_group import Place, Room
from rover_hil.ready.procedure import Procedure
from tests.rover_hil.command import Command, assert_one_sentence

CALIBRATIONS = COMMANDS["calibrate"]
assert isinstance(CALIBRATIONS, Room)
NAMES = list(CALIBRATIONS.places)
OLD_SPELLINGS = {
    "calibrate imu a.mcap --turns 2 --out b.toml": "mounting",
    "calibrate compass a.mcap --motors --out b.toml": "motors",
    "calibrate camera robotino-camera --scale --log a.mcap --out b.toml": "scale",
}


def test_all_calibrations_are_found() -> None:
    assert {"camera", "compass", "imu", "motors", "mounting", "scale", "time", "wheels"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_each_is_one_procedure(name: str) -> None:
    module = import_module(f"rover_hil.ready.{name}.calibration")
    kinds = [
        kind for kind in vars(module).values() if inspect.isclass(kind) and kind.__module__ == module.__name__
    ]
    assert sum(issubclass(kind, Procedure) for kind in kinds) == 1


def test_the_list_loads_no_calibration(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Place, "load", lambda *_: pytest.fail("loaded"))
    assert command("calibrate", "--help") == 0
    for name in NAMES:
        assert name in command.out


@pytest.mark.parametrize("line", OLD_SPELLINGS)
def test_an_old_spelling_leads_to_the_new_command(command: Command, line: str) -> None:
    assert command(*line.split()) == 2
    told, problem = command.error.splitlines(keepends=True)
    assert f"is now `calibrate {OLD_SPELLINGS[line]}`" in told
    assert_one_sentence(problem, "cannot read log a.mcap")


@pytest.mark.parametrize("name", NAMES)
def test_json_and_force_are_options_of_all(name: str) -> None:
    group = get_command(app).commands["calibrate"]  # type: ignore[attr-defined]
    options = [option for parameter in group.commands[name].params for option in parameter.opts]
    assert {"--json", "--force", "--out"} <= set(options)
    assert len(options) == len(set(options))
