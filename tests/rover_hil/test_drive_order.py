"""No command moves a real rover without an explicit order, and each says which one it is about to move."""

import io
import os
import pty
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from drivers.can_wheels.settings import CanWheelsSettings
from drivers.errors import ConfigError
from rover_hil import ready
from rover_hil.config import load_config, read_config_text
from rover_hil.ready import procedure
from rover_hil.run.drive_permission import permit_drive, permit_turning
from tests.rover_hil.command import Command, assert_one_sentence

CALIBRATIONS = [path.parent.name for path in Path(ready.__file__).parent.glob("*/calibration.py")]
ROVER = "the rover of rover.toml (board at ports/board, imu at ports/imu)"
CHANNEL = "can7"
COMMANDS = (
    "calibrate imu rover.toml --out o.toml",
    "calibrate mounting rover.toml --turns 2 --out o.toml",
    "calibrate compass compass.toml --out o.toml",
    "calibrate motors compass.toml --out o.toml",
    "calibrate wheels rover.toml --out o.toml",
    "calibrate scale camera.toml --out o.toml",
    "commission rover.toml --out runs",
)
"""Every command that moves the wheels and is not itself the order."""


@pytest.fixture(autouse=True)
def rovers(command: Command) -> None:
    for name, source in (
        ("rover.toml", "robotino"),
        ("compass.toml", "el-dorado"),
        ("camera.toml", "robotino-camera"),
    ):
        text = read_config_text(source)
        Path(name).write_text(re.sub(r"(?m)^#:schema.*\n", "", text), "utf-8")


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_every_calibration_that_drives_is_among_them(name: str) -> None:
    module = import_module(f"rover_hil.ready.{name}.calibration")
    own = [
        item
        for item in vars(module).values()
        if isinstance(item, type) and item.__module__ == module.__name__
    ]
    drives = any("drives" in vars(item) for item in own)
    assert drives == any(line.startswith(f"calibrate {name} ") for line in COMMANDS)


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Give what really would have driven: the rover of each order, "virtual" for a simulated one."""
    found: list[str] = []

    def real(*arguments: object, order: object, **options: object) -> None:
        found.append(str(order))
        raise ConfigError("driven")

    def virtual(*arguments: object, **options: object) -> None:
        found.append("virtual")
        raise ConfigError("driven")

    monkeypatch.setattr(procedure, "run_real", real)
    monkeypatch.setattr(procedure, "run_virtual", virtual)
    return found


@pytest.fixture
def keys(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Put the program on a terminal, and give the other end of it."""
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, "r", encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        yield ours
    os.close(ours)


@pytest.mark.parametrize("line", COMMANDS)
def test_without_a_terminal_nothing_drives_unless_told(
    command: Command, driven: list[str], monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("yes\n" * 9))
    assert command(*line.split()) == 2
    assert driven == []
    assert_one_sentence(command.error, "this would move the rover of", "add --drive", "--virtual")
    assert command(*line.split(), "--drive", "--virtual") == 2
    assert driven == []
    assert_one_sentence(command.error, "leave one out")
    assert not list(Path().glob("o.*"))
    assert command(*line.split(), "--drive") == 2
    assert len(driven) == 1
    assert re.search(r"\w+\.toml", driven[0])[0] == re.search(r"\w+\.toml", line)[0]  # type: ignore[index]
    assert "imu at ports/imu" in driven[0]
    assert command(*line.split(), "--virtual") == 2
    assert driven[1:] == ["virtual"]


@pytest.mark.parametrize("line", COMMANDS)
def test_at_a_terminal_the_answer_decides(command: Command, driven: list[str], keys: int, line: str) -> None:
    os.write(keys, b"\n")
    assert command(*line.split()) == 1
    assert driven == []
    assert "not confirmed: nothing was driven" in command.error
    assert "This moves the rover of" in command.error
    os.write(keys, b"yes\n\n")
    assert command(*line.split()) == 2
    assert len(driven) == 1


@pytest.mark.parametrize(
    "line",
    [
        "calibrate wheels rover.toml --out o.toml",
        "calibrate wheels rover.toml --out o.toml --line logs/line*.mcap=2",
        "calibrate wheels rover.toml --out o.toml --line ",
        "calibrate compass compass.toml --out o.toml --log logs/*.mcap",
        "calibrate compass logs/*.mcap --out o.toml",
        "calibrate motors logs/*.mcap --out o.toml",
        "calibrate imu logs/*.mcap --out o.toml",
        "calibrate mounting logs/*.mcap --turns 2 --out o.toml",
        "commission rover.toml --again --out nowhere",
    ],
)
def test_a_pattern_that_matches_no_log_never_drives(command: Command, driven: list[str], line: str) -> None:
    assert command(*line.split(" ")) == 2
    assert_one_sentence(command.error)
    assert driven == []


@pytest.mark.parametrize(
    "line",
    [
        "calibrate wheels rover.toml --out o.toml --line a.mcap=2",
        "calibrate compass compass.toml --out o.toml --log a.mcap",
        "calibrate motors compass.toml --out o.toml --log a.mcap",
        "calibrate compass compass.toml --out o.toml --by-hand",
        "calibrate imu a.mcap --out o.toml",
        "calibrate mounting rover.toml --turns 2 --out o.toml --by-hand",
        "commission rover.toml --again --out runs",
    ],
)
def test_drive_is_refused_where_nothing_is_driven(command: Command, driven: list[str], line: str) -> None:
    assert command(*line.split(), "--drive") == 2
    assert_one_sentence(command.error, "--drive", "out")
    assert driven == []


def test_file_and_ports_are_named() -> None:
    order = permit_drive("rover.toml", load_config("rover.toml"), virtual=False, drive=True)
    assert order is not None
    assert order.rover == ROVER


def test_answers_from_a_file_turn_the_wheels_only_with_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = CanWheelsSettings(
        type="can_wheels", interface="socketcan", channel=CHANNEL, mapping="generic_wheel"
    )
    monkeypatch.setattr(sys, "stdin", io.StringIO("no\nyes\nyes\n"))
    assert permit_turning("drives", settings, drive=True) is None
    with pytest.raises(ConfigError, match=f"turn the wheels of drives at {CHANNEL}: add --drive"):
        permit_turning("drives", settings, drive=False)
    order = permit_turning("drives", settings, drive=True)
    assert order is not None
    assert order.rover == f"drives at {CHANNEL}"


def test_at_a_terminal_the_wheels_turn_after_yes(keys: int) -> None:
    settings = CanWheelsSettings(
        type="can_wheels", interface="socketcan", channel=CHANNEL, mapping="generic_wheel"
    )
    os.write(keys, b"yes\n")
    assert permit_turning("drives", settings, drive=False) is not None
