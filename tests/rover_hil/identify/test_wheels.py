"""`rover-hil calibrate wheels`: radius and base of a rover whose configuration is wrong about them."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from controllers.motion.rover_geometry import SkidSteerRoverSettings, WheelsRoverSettings
from rover_hil.app.ask import ask_number, ask_yes
from rover_hil.config import load_config, read_config_text
from rover_hil.identify.wheels.fit import fit_factor, proposal
from tests.rover_hil.command import Command, assert_one_sentence

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"


def test_wrong_geometry_is_found_on_the_simulated_rover(command: Command, tmp_path: Path) -> None:
    text = read_config_text("robotino").replace("wheel_radius_m = 0.040", "wheel_radius_m = 0.042")
    text = text.replace("base_radius_m = 0.125", "base_radius_m = 0.120")
    (tmp_path / "rover.toml").write_text(text, "utf-8")
    command_line = "calibrate wheels rover.toml --virtual --out wheels.toml --length 0.8 --turns 1 --enter"
    assert command(*command_line.split()) == 0
    found = tomllib.loads((tmp_path / "wheels.toml").read_text("utf-8"))["rover"]
    assert found["wheel_radius_m"] == pytest.approx(0.040, rel=0.01)
    assert found["base_radius_m"] == pytest.approx(0.125, rel=0.015)
    rover = load_config("rover.toml").rover
    assert rover.model_dump(include={"wheel_radius_m", "base_radius_m"}) == found
    assert (tmp_path / "wheels.html").is_file()
    # The same logs again, as a user names them.
    logs = ["--line", "wheels-line1.mcap=0.762", "--spin", "wheels-spin2.mcap=-1.0"]
    assert command("calibrate", "wheels", "rover.toml", "--out", "again.toml", *logs, "--json") == 0
    assert json.loads(command.out)["rover"]["wheel_radius_m"] == pytest.approx(0.040, rel=0.02)
    assert (
        command("calibrate", "wheels", "rover.toml", "--out", "double.toml", "--line", "wheels-line1.mcap=2")
        == 1
    )
    assert "correct ticks, gear ratio, sign or units" in command.out
    assert not (tmp_path / "double.toml").exists()
    assert (
        command("calibrate", "wheels", "rover.toml", "--out", "c.toml", "--spin", "wheels-line1.mcap=1") == 2
    )
    assert_one_sentence(command.error, "half a turn in one sense is needed")


@pytest.mark.parametrize("seed", range(3))
def test_the_interval_covers_the_truth(seed: int) -> None:
    rng, hits = np.random.default_rng(seed), 0
    for _ in range(200):
        odometry = rng.uniform(2.0, 6.0, 4)
        factor = fit_factor((1.03 * odometry + rng.normal(0.0, 0.01, 4)).tolist(), odometry.tolist(), 0.01)
        hits += abs(factor.value - 1.03) <= factor.half_width
    assert hits >= 186


def test_scatter_beyond_the_stated_accuracy_widens_the_interval() -> None:
    close = fit_factor([5.0, 5.01], [5.0, 5.0], 0.005)
    far = fit_factor([5.0, 5.4], [5.0, 5.0], 0.005)
    assert close.problem == ""
    assert far.half_width > 10 * close.half_width
    assert "uncertain" in far.problem


def test_each_kind_of_rover_gets_its_own_keys() -> None:
    radius, turn = fit_factor([5.1], [5.0], 0.001), fit_factor([6.0], [6.3], 0.001)
    skid = SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.1, track_m=0.6)
    assert proposal(skid, radius, turn) == {"wheel_radius_m": 0.102, "track_m": pytest.approx(0.6426)}
    assert proposal(skid, None, turn) == {"track_m": pytest.approx(0.63)}
    # Without turns the base goes with the radius, and turns stay as they are.
    assert proposal(skid, radius, None) == {"wheel_radius_m": 0.102, "track_m": pytest.approx(0.612)}
    rover = load_config(str(EXAMPLES / "differential.toml")).rover
    assert isinstance(rover, WheelsRoverSettings)
    wheels = proposal(rover, radius, turn)["wheels"]
    assert wheels == [
        {"x_m": 0.0, "y_m": pytest.approx(0.16065), "radius_m": pytest.approx(0.0612)},
        {"x_m": 0.0, "y_m": pytest.approx(-0.16065), "radius_m": pytest.approx(0.0612)},
    ]


def test_bad_input_is_one_sentence(command: Command) -> None:
    for options, words in (
        ("--out w.toml --line run.mcap", "--line run.mcap: write the log and what is known"),
        ("--out w.toml --spin run.mcap=0", "--spin run.mcap=0: write"),
        ("--out w.toml --line none.mcap=2", "cannot read log none.mcap"),
        ("--out w.html", "name a file that ends with .toml"),
        ("--out w.toml --enter", "--enter: robotino cannot be edited"),
    ):
        assert command("calibrate", "wheels", "robotino", *options.split()) == 2
        assert_one_sentence(command.error, words)


def test_questions_are_asked_again_until_the_answer_is_right(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    answers = tmp_path / "answers"
    answers.write_text("two\n70\n2.5\nmaybe\n\n")
    with answers.open() as stream:
        monkeypatch.setattr("sys.stdin", stream)
        assert ask_number("Distance, m", 0.1, 50.0) == 2.5
        assert ask_yes("Go on?", default=True)
    assert capsys.readouterr().err.count("Distance, m: ") == 3
