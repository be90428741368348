"""`rover-hil calibrate scale` on a simulated drive whose camera hangs lower than its rig says."""

import datetime as dt
import json
import tomllib
from pathlib import Path

import pytest

from drivers.clock import date_of, wall_time_ns
from rover_hil.config import load_config
from rover_hil.config.loader import SHIPPED, SHIPPED_CONFIGS
from rover_hil.ready.ages import check_ages
from tests.rover_hil.command import Command

HEIGHT_M, TOLD_M = 0.4365, 0.45
TURNS = """[mission]
type = "small_turns"
heading = "along_path"
frequencies_hz = [0.2, 0.3]
each_s = 15
turn_rate_rad_s = 0.3

"""
LINE = "calibrate scale mine.toml --out scale.toml --force"


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    monkeypatch.chdir(tmp_path)
    return Command(monkeypatch, capsys)


def write_config(folder: Path) -> Path:
    """Write the shipped rover with a camera of a quarter of the pixels, 3 % lower than its rig says."""
    rig = json.loads((SHIPPED / "rigs" / "robotino.json").read_text("utf-8"))
    rig["image"] |= {"width": 320, "height": 240}
    rig["camera_matrix"] = [[277.128129211, 0, 159.5], [0, 277.128129211, 119.5], [0, 0, 1]]
    (folder / "rig.json").write_text(json.dumps(rig))
    text = (SHIPPED_CONFIGS / "robotino-camera.toml").read_text("utf-8")
    for old, new in (
        ('rig = "robotino" ', 'rig = "rig.json" '),
        ("width = 640", "width = 320"),
        ("height = 480", "height = 240"),
        (f"height_m = {TOLD_M}", f"height_m = {HEIGHT_M}"),
    ):
        assert old in text
        text = text.replace(old, new)
    path = folder / "mine.toml"
    path.write_text(text)
    return path


@pytest.mark.slow
def test_the_scale_of_a_camera_that_hangs_too_low_is_found_and_entered(
    command: Command, tmp_path: Path
) -> None:
    config = write_config(tmp_path)
    assert command(*LINE.split(), "--virtual", "--enter") == 0, command.error
    entered = tomllib.loads(config.read_text())["ground_motion"]
    found = entered["tolerance"]
    # Its rig is on the rover's contacts, a millimetre below the ground.
    expected = (HEIGHT_M - 0.001) / TOLD_M
    assert found["scale"] == pytest.approx(expected, abs=0.012)
    assert abs(found["scale"] - expected) < 2.5 * found["scale_sd"] < 0.03
    assert dt.date.fromisoformat(found["scale_date"]) == date_of(wall_time_ns())
    assert entered["rig"] == "rig.json"
    assert tomllib.loads((tmp_path / "scale.toml").read_text()) == {"ground_motion": {"tolerance": found}}
    for words in ("known travel: wheels", "+-", "0 days ago", "height that fits: 0.4"):
        assert words in command.out
    # The log of the drive again: nothing of the entered scale is left in it, and the result is the same.
    assert command(*LINE.replace("scale.toml", "again.toml").split(), "--log", "scale.mcap", "--json") == 0
    assert json.loads(command.out)["ground_motion.tolerance"] == found


def test_a_scale_is_of_a_rover_with_a_ground_camera(command: Command) -> None:
    assert command(*["calibrate", "scale", "robotino", "--virtual", "--out", "a.toml"]) == 2
    assert "[ground_motion]" in command.error


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("robotino-camera --virtual --enter", "cannot be edited"),
        ("robotino-camera --virtual --log a.mcap", "a.mcap is a log: leave --virtual out"),
        ("robotino-camera --log nothing.mcap", "nothing.mcap"),
    ],
)
def test_options_that_do_not_belong_together_are_named(command: Command, line: str, words: str) -> None:
    assert command("calibrate", "scale", *line.split(), "--out", "a.toml") == 2
    assert words in command.error


def test_an_old_scale_is_told(command: Command, tmp_path: Path) -> None:
    config = write_config(tmp_path)

    def findings(day: str) -> list[str]:
        text = config.read_text() + f'\n[ground_motion.tolerance]\nscale = 0.98\nscale_date = "{day}"\n'
        (tmp_path / "dated.toml").write_text(text)
        dated = load_config("dated.toml")
        found = check_ages(dated, dt.date(2026, 11, 27))
        return [each.what for each in found if "scale" in each.what]

    assert findings("2026-10-01") == ["scale 0.98 of 2026-10-01"]
    (old,) = findings("2024-10-01")
    assert old == "its scale is of 2024-10-01, today is 2026-11-27"


@pytest.mark.slow
def test_the_time_of_the_frames_is_found_by_turns(command: Command, tmp_path: Path) -> None:
    config = write_config(tmp_path)
    text = config.read_text()
    text = text[: text.index("[mission]")] + TURNS + text[text.index("[ground_motion]") :]
    text = text[: text.index("[slip]")] + text[text.index("# Fitted to the simulated ground") :]
    text = text.replace("slip_sd_share", "# slip_sd_share")
    config.write_text(text.replace("readout_s = 0.015", "readout_s = 0\nexposure_s = 0.06"))
    assert command("run", "mine.toml", "--virtual", "--out", "turns") == 0, command.error
    assert command("calibrate", "time", "turns/run.mcap", "--json") == 0, command.error
    camera = json.loads(command.out)["offsets"]["ground camera 'camera'"]
    # Frames are stamped when the exposure begins, half of it before its middle.
    assert camera["problem"] == ""
    assert camera["offset_s"] == pytest.approx(-0.03, abs=0.004)
