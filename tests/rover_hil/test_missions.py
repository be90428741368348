"""Missions with speeds, stops and repetitions: checked, drawn, driven."""

import json
from pathlib import Path

import numpy as np
import pytest

from rover_hil.config import load_config, read_config_text
from rover_hil.drives.drive import read_drive
from rover_hil.run.driving import run_virtual
from tests.rover_hil.command import Command, assert_one_sentence

AREA = """[safety.area]
type = "polygon"
points_m = [[-0.5, -0.5], [0.6, -0.5], [0.6, 0.5], [-0.5, 0.5]]
"""
MISSION = """[mission]
type = "waypoints"
points = [[0.3, 0.0], [0.3, 0.2]]
speeds_m_s = [0.15, 0.08]
waits_s = [2.0, 0.0]
heading_gain_per_s = 8.0
"""


def write_config(mission: str) -> str:
    text = read_config_text("robotino").replace("#:schema", "#")
    begin, end = text.index("[mission]"), text.index("# Wheel slip is")
    text = text[:begin] + mission + text[end:]
    text = text[: text.index("[tune.parameters]")].replace('"paper_like"', '"floor_table"')
    Path("rover.toml").write_text(text, "utf-8")
    return "rover.toml"


def test_check_draws_the_mission(command: Command) -> None:
    name = write_config(MISSION + AREA)
    assert command("check", name, "--preview", "mission.html") == 0, command.out
    page = Path("mission.html").read_text("utf-8")
    assert "2, 0.50 m in all" in page
    assert "at least 6 s, of these 2 s at rest" in page  # 0.3 / 0.15 + 0.2 / 0.08 + 2
    assert command("check", name, "--preview", "mission.html") == 2
    assert_one_sentence(command.error, "mission.html", "--force")


def test_a_way_point_outside_is_one_sentence_and_draws_nothing(command: Command) -> None:
    name = write_config(MISSION.replace("[0.3, 0.2]", "[0.7, 0.2]") + AREA)
    assert command("check", name, "--preview", "mission.html", "--json") == 1
    (mistake,) = json.loads(command.out)["mistakes"]
    assert (
        "on the line from 0.3, 0 to 0.7, 0.2 m the body of 0.131 m radius is outside safety.area" in mistake
    )
    assert not Path("mission.html").exists()
    assert command("run", name, "--virtual") == 2
    assert_one_sentence(command.error, "outside safety.area")


def test_turns_in_place_have_no_picture(command: Command) -> None:
    name = write_config('[mission]\ntype = "whole_turns"\nheading = "along_path"\n')
    assert command("check", name, "--preview", "mission.html") == 2
    assert_one_sentence(command.error, "no path to draw")


def test_a_leg_too_slow_to_notice_a_stall_is_refused(command: Command) -> None:
    name = write_config(MISSION.replace("0.08", "0.01"))
    assert command("check", name) == 1
    assert "no stall could be noticed" in command.out


@pytest.mark.usefixtures("unrendered")
def test_the_simulated_rover_drives_slower_and_stops(command: Command) -> None:
    config = load_config(write_config(MISSION)).model_copy(update={"slip": None})
    run_virtual(config, Path("run.mcap"), 30.0, None)
    drive = read_drive(Path("run.mcap"))
    true = drive.true_poses()
    t_s = drive.seconds(true.t_ns)
    speed = np.hypot(np.gradient(true.x_m, t_s), np.gradient(true.y_m, t_s))
    first = speed[np.abs(true.x_m - 0.15) < 0.03].mean()
    second = speed[np.abs(true.y_m - 0.08) < 0.03].mean()
    assert first / second == pytest.approx(0.15 / 0.08, rel=0.1)
    at_corner = (np.hypot(true.x_m - 0.3, true.y_m) < 0.08) & (speed < 0.005)
    assert np.count_nonzero(at_corner) * np.median(np.diff(t_s)) == pytest.approx(2.0, abs=0.6)
