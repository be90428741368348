"""`run` drives the check manoeuvre only where the room is confirmed; no other command drives it."""

import io
import json
import sys
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from drivers.mounting import Mounting
from rover_hil.config import Config, load_config, read_config_text
from rover_hil.drive.check_manoeuvre import NOBODY, OFFER, REFUSED, offer, permit_check_manoeuvre
from rover_hil.recording.data_files import restore_config, with_controller_of
from rover_hil.recording.reader import LogReader
from rover_hil.run.check_manoeuvre import without_check_manoeuvre
from rover_hil.run.driving import run_virtual
from tests.rover_hil.command import Command
from tests.rover_hil.test_virtual_run import records, replay_file


def wanting(name: str = "robotino") -> Config:
    config = load_config(name)
    return config.model_copy(update={"safety": config.safety.model_copy(update={"check_manoeuvre": True})})


def write_config() -> str:
    text = read_config_text("robotino").replace("#:schema", "#").replace('"paper_like"', '"floor_table"')
    text = text.replace("[safety]\n", "[safety]\ncheck_manoeuvre = true\n")
    Path("rover.toml").write_text(text.replace("settle_s = 3.0", "settle_s = 1.0"), "utf-8")
    return "rover.toml"


class Terminal(io.StringIO):
    """A standard input at which somebody sits."""

    def isatty(self) -> bool:
        return True


@pytest.mark.usefixtures("unrendered")
def test_a_virtual_run_confirms_itself_states_the_room_and_prints_a_line_for_each_source(
    command: Command,
) -> None:
    assert command("run", write_config(), "--virtual", "--duration", "20", "--out", "run") == 0, command.error
    lines = [line for line in command.error.splitlines() if line.startswith("check manoeuvre: ")]
    assert "0.23 m ahead of the rover's origin, 0.23 m behind and 0.23 m to each side" in lines[0]
    assert [line.split(": ")[1] for line in lines[1:]] == ["board", "imu"]
    assert all("rotation agrees with" in line for line in lines[1:])
    checks = json.loads(Path("run/summary.json").read_text())["checks"]
    assert [check["verdict"] for check in checks] == ["agrees", "agrees"]
    assert "Check manoeuvre" in Path("run/report.html").read_text("utf-8")
    assert replay_file(Path("run/run.mcap")).differences == []


def test_without_a_terminal_it_is_not_driven_and_the_sources_stay_unconfirmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("yes\n"))
    permission = permit_check_manoeuvre(wanting(), virtual=False)
    assert permission.words == NOBODY
    assert "the sources stay unconfirmed" in NOBODY
    assert not permission.config.safety.check_manoeuvre


@pytest.mark.parametrize(("answer", "is_driven", "words"), [("yes\n", True, ""), ("\n", False, REFUSED)])
def test_at_a_terminal_the_room_is_confirmed(
    answer: str,
    is_driven: bool,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    permission = permit_check_manoeuvre(wanting(), virtual=False)
    assert permission.config.safety.check_manoeuvre is is_driven
    assert permission.words == words
    assert "Is this room free? (yes/no) [no]" in capsys.readouterr().err


def test_where_it_is_not_wanted_nothing_is_asked() -> None:
    config = load_config("robotino")
    assert permit_check_manoeuvre(config, virtual=False) == (config, "")


@pytest.mark.parametrize("is_confirmed", [True, False])
def test_only_a_confirmed_run_drives_it_and_its_log_holds_what_was_driven(
    is_confirmed: bool, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    run_virtual(wanting(), path, 18.0, None, check_manoeuvre=is_confirmed)
    assert any("checks" in record for record in records(path, "/estimate")) is is_confirmed
    log = LogReader(path)
    with restore_config(log) as config:
        assert config.safety.check_manoeuvre is is_confirmed
        assert with_controller_of(config, wanting()).safety.check_manoeuvre is is_confirmed
    assert replay_file(path).differences == []


def test_a_configuration_without_it_stays_as_it_is() -> None:
    config = load_config("robotino")
    assert without_check_manoeuvre(config) is config


def test_an_area_that_is_too_small_for_it_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    table = wanting().model_dump(by_alias=True)
    table["devices"]["overhead"] = {
        "type": "overhead_camera", "source": "live_folder", "path": "frames", "max_age_s": 10.0,
        "marker_id": 7, "marker_size_m": 0.12, "marker_height_m": 0.22, "calibration": "simulated",
        "frame_rate_hz": 5.0,
    }  # fmt: skip
    table["roles"]["fixes"] = ["overhead"]
    table["mission"] = {"type": "line", "length_m": 0.05, "speed_m_s": 0.1}
    table["safety"]["area"] = {"type": "circle", "centre_m": (0.0, 0.0), "radius_m": 0.3}
    with pytest.raises(ConfigError, match=r"set check_manoeuvre = false in \[safety\], or correct the area"):
        permit_check_manoeuvre(Config.model_validate(table), virtual=True)


@pytest.mark.usefixtures("unrendered")
def test_a_gyro_with_the_wrong_sign_ends_the_run_with_exit_code_1(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    correct = Mounting.correct_rate
    monkeypatch.setattr(Mounting, "correct_rate", lambda self, rate: tuple(-x for x in correct(self, rate)))
    code = command("run", write_config(), "--virtual", "--out", "run")
    assert (code, "imu: rotation has the opposite sign of the wheels" in command.out) == (1, True), (
        command.error
    )
    assert OFFER in command.error


def test_after_a_stop_it_is_offered_and_nothing_else() -> None:
    assert offer(wanting(), 1) == OFFER
    assert offer(wanting(), 0) == offer(load_config("robotino"), 1) == ""
