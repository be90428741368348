"""Every command makes the same checks of a configuration and reports all mistakes at once."""

from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.config import load_config, read_config_text
from rover_hil.drive.run import run_rover
from rover_hil.drive.simulate import simulate
from rover_hil.ready.doctor import examine
from rover_hil.run.checks import ROVER_CHECKS
from rover_hil.tune.command import tune
from tests.rover_hil.tune.tuning import SHIPPED_TUNE

Edits = tuple[tuple[str, str], ...]

TUNE = """
[tune.parameters]
"mission.lookahead_m" = { low = 0.1, high = 0.5, unit = "m" }
[tune.objective]
closure_m = 0.1
"""


def run(path: str, *, virtual: bool) -> int:
    return run_rover(path, virtual=virtual, duration_s=None, out=None, realtime=False, as_json=False)


COMMANDS: dict[str, Callable[[str], int]] = {
    "run": lambda path: run(path, virtual=False),
    "run --virtual": lambda path: run(path, virtual=True),
    "simulate": lambda path: simulate(path, 0.1),
    "tune": lambda path: tune(path, study="study", trials=1, minutes=None, out=None, as_json=False),
    "doctor": lambda path: examine(path, as_json=True),
}


def write(folder: Path, name: str, *edits: tuple[str, str]) -> str:
    text = read_config_text(name)
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    text = text.partition(SHIPPED_TUNE)[0]
    (folder / "rover.toml").write_text(f"{text}\n{TUNE}", "utf-8")
    return "rover.toml"


def mistakes(command: str, path: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        COMMANDS[command](path)
    return str(caught.value).splitlines()


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("name", "old", "new", "line"),
    [
        (
            "el-dorado",
            'heading = "along_path"\n',
            "",
            'mission.heading: this rover cannot move sideways and hold its heading, set it to "along_path"',
        ),
        (
            "robotino",
            "length_m = 0.9",
            "length_m = 0.9\nposition_tolerance_m = 0.45",
            "mission: the line from (0.",
        ),
        (
            "robotino",
            'port = "ports/imu"',
            'port = "ports/../ports/board"',
            "devices.imu.port: 'ports/../ports/board' is already the port of device 'board'",
        ),
        (
            "el-dorado",
            'channel = "ports/can"',
            'channel = "ports/compass"',
            "devices.compass.port: 'ports/compass' is already the port of device 'wheels'",
        ),
        (
            "el-dorado",
            'mapping = "generic_wheel"',
            'mapping = "nowhere.toml"',
            "devices.wheels: no mapping 'nowhere.toml'",
        ),
        (
            "el-dorado",
            'port = "ports/compass"',
            'port = "ports/compass"\ncalibration = "nowhere.toml"',
            "devices.compass: cannot read calibration file nowhere.toml",
        ),
        (
            "robotino",
            'type = "witmotion"\nframes = ["rate"]',
            'type = "nmea_compass"',
            "simulation.devices.imu.type: must be 'witmotion'",
        ),
    ],
)
def test_every_command_refuses_what_run_refuses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, name: str, old: str, new: str, line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = write(tmp_path, name, (old, new))
    assert {found[: len(f"{path}: {line}")] for found in mistakes(command, path)} == {f"{path}: {line}"}
    assert [entry.name for entry in tmp_path.iterdir()] == [path]


@pytest.mark.parametrize("command", ["run", "run --virtual", "doctor"])
def test_without_a_mission_nothing_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(tmp_path)
    text = read_config_text("robotino")
    mission = text[text.index("[mission]") : text.index("[limits]")]
    path = write(tmp_path, "robotino", (mission, ""))
    assert mistakes(command, path) == [f"{path}: mission: this key is missing; add what the rover is to do"]


@pytest.mark.parametrize("command", ["run", "run --virtual", "doctor"])
def test_a_mission_without_a_path_is_for_the_page_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(tmp_path)
    text = read_config_text("robotino")
    mission = text[text.index("[mission]") : text.index("[limits]")]
    path = write(tmp_path, "robotino", (mission, '[mission]\ntype = "by_hand"\nspeed_m_s = 0.1\n\n'))
    (line,) = mistakes(command, path)
    assert line.startswith(f"{path}: mission.type: 'by_hand' has no path")
    load_config(path, ROVER_CHECKS)  # what the page asks for


def test_all_mistakes_come_at_once_one_line_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    changes_and_lines = (
        (("track_m = 0.66", "track_mm = 0.66"), "rover.track_mm: unknown key; did you mean track_m?"),
        (("rate_hz = 50", "rate_hz = 5000"), "loop.rate_hz: input should be less than or equal to 1000, got"),
        (('wheels = "wheels"', 'wheels = "compass"'), "roles.wheels: device 'compass' turns no wheels: name"),
        (('gyro = "imu"', 'gyro = "imuu"'), "roles.gyro: [devices] has no 'imuu': name one of wheels, comp"),
        (('mapping = "generic_wheel"', 'mapping = "nowhere.toml"'), "devices.wheels: no mapping 'nowhere.t"),
        (('port = "ports/imu"', 'port = "ports/compass"'), "devices.imu.port: 'ports/compass' is already t"),
        (("max_age_s = 0.7", "max_age_s = 0.1"), "devices.camera: max_age_s = 0.1 is not longer than one p"),
        (("length_m = 3.0", "length_m = 300"), "mission.length_m: input should be less than or equal to 10"),
        (('parameters = "el-dorado"', 'parameters = "none"'), "scomp.parameters: cannot read paramete"),
        (('rig = "el-dorado"', 'rig = "none.json"'), "scomp.rig: cannot read rig file none.json"),
        (("wheel_radius_error", "mass"), "simulation.plant.mass: unknown key; did you mean mass_kg?"),
    )
    path = write(tmp_path, "el-dorado", *(change for change, _ in changes_and_lines))
    lines = mistakes("doctor", path)
    for _, start in changes_and_lines:
        assert sum(line.startswith(f"{path}: {start}") for line in lines) == 1, start
    assert len(lines) == len(changes_and_lines)


def test_devices_may_share_a_can_interface_and_recorded_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bus = 'type = "can_wheels"\ninterface = "socketcan"\nchannel = "can0"\nmapping = "generic_wheel"\n'
    video = 'type = "camera"\nsource = "video"\npath = "a.avi"\nwidth = 64\nheight = 48\nframe_rate_hz = 5\n'
    shared = f"[devices.a]\n{bus}\n[devices.b]\n{bus}\n[devices.c]\n{video}\n[devices.d]\n{video}\n"
    path = write(tmp_path, "el-dorado", ("[mission]", f"{shared}\n[mission]"))
    assert load_config(path, ROVER_CHECKS).devices.keys() >= {"a", "b", "c", "d"}


def test_a_broken_device_is_no_reason_to_miss_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor to find [devices] empty, or the other device without a role."""
    monkeypatch.chdir(tmp_path)
    broken = (('port = "ports/board"', "port = 1"), ('port = "ports/imu"', "port = 2"))
    lines = mistakes("run", write(tmp_path, "robotino", *broken))
    assert lines == [
        "rover.toml: devices.board.port: input should be a valid string, got 1",
        "rover.toml: devices.imu.port: input should be a valid string, got 2",
    ]
