"""A mission that needs faster wheels than `limits` allows is refused before anything moves."""

from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.config import Config, load_config
from rover_hil.run.checks import ROVER_CHECKS, find_too_fast

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
ROVERS = {
    "omni_3": "robotino",
    "skid_steer_4": "el-dorado",
    "crab": "el-dorado-crab",
    "differential": str(EXAMPLES / "differential.toml"),
    "mecanum": str(EXAMPLES / "mecanum.toml"),
    "six wheels": str(EXAMPLES / "six_wheels.toml"),
}
PATH = {"heading": "along_path", "speed_m_s": 0.3, "yaw_rate_limit_rad_s": 0.7}
MISSIONS: dict[str, dict[str, object]] = {
    "line": {"type": "line", "length_m": 1.0, **PATH},
    "rectangle": {"type": "rectangle", "length_m": 1.0, "width_m": 0.5, **PATH},
    "waypoints": {"type": "waypoints", "points": [[1.0, 0.0], [1.0, 1.0]], **PATH},
    "by_hand": {"type": "by_hand", "speed_m_s": 0.3, "yaw_rate_limit_rad_s": 0.7},
    "whole_turns": {"type": "whole_turns", "turn_rate_rad_s": 0.7},
    "small_turns": {"type": "small_turns", "turn_rate_rad_s": 0.7},
}


def with_mission(name: str, mission: dict[str, object], radius_share: float = 1.0) -> Config:
    table = load_config(ROVERS[name]).model_dump(by_alias=True)
    table["mission"], table["slip"] = mission, None
    table["safety"]["stall_set_point_rad_s"] = 0.01
    rover = table["rover"]
    for wheel in rover.get("wheels", [rover]):
        key = "radius_m" if "radius_m" in wheel else "wheel_radius_m"
        wheel[key] *= radius_share
    return Config.model_validate(table)


@pytest.mark.parametrize("mission", MISSIONS)
@pytest.mark.parametrize("rover", ROVERS)
def test_a_wheel_radius_that_is_an_eighth_is_refused(rover: str, mission: str) -> None:
    assert list(find_too_fast(with_mission(rover, MISSIONS[mission]))) == []
    wrong = with_mission(rover, MISSIONS[mission], 0.125)
    found = list(find_too_fast(wrong))
    assert found
    for line in found:
        assert f"radius of {wrong.rover.wheel_radius_m:g} m" in line
        assert f"above limits.wheel_speed_rad_s = {wrong.limits.wheel_speed_rad_s:g} rad/s" in line
        assert line.startswith("mission.")


def test_the_sentence_has_the_keys_and_the_numbers() -> None:
    (line,) = find_too_fast(with_mission("differential", MISSIONS["line"], 0.1))
    assert line == (
        "mission.speed_m_s = 0.3 m/s needs wheel speeds of 50 rad/s with the wheel radius of 0.006 m, above "
        "limits.wheel_speed_rad_s = 12 rad/s: correct the geometry in [rover], drive more slowly, or raise "
        "the limit to what the drives do"
    )


def test_a_speed_of_one_leg_counts() -> None:
    points = {"points": [[1.0, 0.0], [2.0, 0.0]], "speeds_m_s": [0.1, 3.0]}
    (line,) = find_too_fast(with_mission("differential", {"type": "waypoints", **PATH, **points}))
    assert line.startswith("mission.speeds_m_s = 3 m/s needs wheel speeds of 50 rad/s")


def test_a_sideways_leg_counts_by_its_own_wheels() -> None:
    """Along x the Robotino needs 0.87 of what it needs along y."""
    mission = {"type": "waypoints", "points": [[1.0, 0.0]], "speed_m_s": 0.65}
    assert list(find_too_fast(with_mission("omni_3", mission))) == []
    assert list(find_too_fast(with_mission("omni_3", {**mission, "points": [[0.0, 1.0]]})))


def test_the_yaw_excitation_comes_on_top() -> None:
    table = load_config("robotino").model_dump(by_alias=True)
    table["mission"]["speed_m_s"] = 0.58
    table["slip"] = None
    assert list(find_too_fast(Config.model_validate(table))) == []
    table["slip"] = load_config("robotino").model_dump(by_alias=True)["slip"]
    lines = list(find_too_fast(Config.model_validate(table)))
    assert lines
    assert all("and the yaw excitation need wheel speeds of 15.5 rad/s" in line for line in lines)


def test_check_refuses_it_in_one_sentence(tmp_path: Path) -> None:
    text = (EXAMPLES / "differential.toml").read_text("utf-8")
    assert "radius_m = 0.06\n" in text or "radius_m = 0.06 " in text
    (tmp_path / "rover.toml").write_text(text.replace("radius_m = 0.06", "radius_m = 0.006"), "utf-8")
    for mapping in EXAMPLES.glob("can/*"):
        (tmp_path / "can").mkdir(exist_ok=True)
        (tmp_path / "can" / mapping.name).write_bytes(mapping.read_bytes())
    with pytest.raises(ConfigError, match=r"needs wheel speeds of .* rad/s") as caught:
        load_config(str(tmp_path / "rover.toml"), ROVER_CHECKS)
    assert len(str(caught.value).splitlines()) <= 2
