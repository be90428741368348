"""Missions in which nothing would notice a yaw that is wrong."""

from dataclasses import replace
from typing import Any

import pytest

from benchmarks.safety.missions import with_fixes
from controllers.unwatched_yaw import find_unwatched_yaw
from rover_hil.config import Config, load_config

LINE = {"type": "line", "length_m": 1.0}
RECTANGLE = {"type": "rectangle", "length_m": 0.9, "width_m": 0.4}
ALONG = {"heading": "along_path"}


def unwatched(mission: dict[str, Any] | None, *, excitation: bool = False, gyro: bool = True) -> str:
    """Return what is said of a Robotino with a mission."""
    table = load_config("robotino").model_dump(by_alias=True)
    table["mission"] = mission
    table["slip"] = table["slip"] if excitation else None
    return said(Config.model_validate(table), gyro=gyro)


def said(config: Config, *, gyro: bool = True) -> str:
    roles = config.device_roles()
    return str(find_unwatched_yaw(config, roles if gyro else replace(roles, gyro=None)) or "")


@pytest.mark.parametrize("mission", [RECTANGLE, LINE, {**LINE, **ALONG}, {"type": "by_hand"}])
def test_straight_lines_with_encoders_and_gyro_alone_are_unwatched(mission: dict[str, Any]) -> None:
    what, remedy = unwatched(mission).split("; ")
    assert what == "yaw unwatched: nothing in this mission would notice that imu measures no turns"
    assert remedy.startswith("the yaw excitation ([slip] use = 'yaw_probe', ")


@pytest.mark.parametrize(
    "mission",
    [
        {**RECTANGLE, **ALONG},
        {**LINE, **ALONG, "repeat": 2},
        {**ALONG, "type": "waypoints", "points": [(0.5, 0.5)]},
        {"type": "small_turns"},
        {"type": "whole_turns"},
    ],
)
def test_turns_of_the_mission_watch_the_yaw(mission: dict[str, Any]) -> None:
    assert unwatched(mission) == ""
    without_gyro = unwatched(mission, gyro=False)
    assert without_gyro.startswith("yaw unwatched: nothing compares the turn by the wheels; a gyro, ")


@pytest.mark.parametrize("points", [[(0.0, 0.0), (1.0, 0.0)], [(0.0, 0.0)]])
def test_a_leg_without_length_is_no_turn(points: list[tuple[float, float]]) -> None:
    assert unwatched({**ALONG, "type": "waypoints", "points": points}) != ""


def test_small_bends_are_no_turns() -> None:
    bends = {**ALONG, "type": "waypoints", "points": [(1.0, 0.0), (2.0, 0.4), (3.0, 0.8)]}
    assert unwatched(bends) != ""


def test_excitation_fixes_and_headings_watch_the_yaw() -> None:
    assert unwatched(RECTANGLE, excitation=True) == ""
    config = load_config("robotino").model_copy(update={"slip": None})
    assert said(config) != ""
    assert said(with_fixes(config, 0.5)) == ""
    assert said(load_config("el-dorado")) == ""


def test_without_a_mission_nothing_is_at_stake() -> None:
    assert unwatched(None) == ""


def test_a_rover_that_cannot_be_excited_is_not_told_to() -> None:
    config = load_config("el-dorado")
    roles = replace(config.device_roles(), headings=())
    _, remedy = str(find_unwatched_yaw(config, roles)).split("; ")
    assert remedy.startswith("a compass, ")
