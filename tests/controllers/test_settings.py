"""The ranges of the settings catch wrong units and shapes that no rover has."""

from typing import Any

import pytest
from pydantic import ValidationError

from controllers.settings import ControlSettings

GOOD: dict[str, Any] = {
    "rover": {"kinematics": "omni3", "wheel_radius_m": 0.04, "base_radius_m": 0.125},
    "limits": {"wheel_speed_rad_s": 12.0, "wheel_acceleration_rad_s2": 10.0},
    "mission": {"type": "rectangle", "length_m": 0.9, "width_m": 0.4, "speed_m_s": 0.1},
}


def with_value(table: str, key: str, value: object) -> dict[str, Any]:
    return {**GOOD, table: {**GOOD.get(table, {}), key: value}}


def test_the_robotino_is_accepted_with_the_papers_wheel_angles() -> None:
    settings = ControlSettings.model_validate(GOOD)
    assert settings.rover.kinematics == "omni3"
    assert settings.rover.wheel_angles_deg == (60.0, 180.0, 300.0)
    assert settings.safety.expiry_s == 0.15


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        pytest.param("rover", "wheel_radius_m", 40.0, id="millimetres"),
        pytest.param("rover", "base_radius_m", 125.0, id="millimetres of the base"),
        pytest.param("rover", "wheel_angles_deg", [1.047, 3.142, 5.236], id="radians"),
        pytest.param("rover", "wheel_angles_deg", [0.0, 120.0, 365.0], id="two wheels at one place"),
        pytest.param("mission", "length_m", 900.0, id="millimetres of path"),
        pytest.param("mission", "speed_m_s", 100.0, id="millimetres per second"),
        pytest.param("mission", "position_tolerance_m", 10.0, id="millimetres of tolerance"),
        pytest.param("limits", "wheel_speed_rad_s", 3000.0, id="rpm of the motor"),
        pytest.param("filter", "heading_noise_rad", 2.0, id="degrees"),
        pytest.param("safety", "expiry_s", 150.0, id="milliseconds"),
        pytest.param("safety", "expiry", 0.15, id="unknown key"),
        pytest.param("filter", "gate_probability", float("nan"), id="not a number"),
    ],
)
def test_wrong_units_and_unknown_keys_are_refused(table: str, key: str, value: object) -> None:
    with pytest.raises(ValidationError, match=key):
        ControlSettings.model_validate(with_value(table, key, value))


@pytest.mark.parametrize(("speed_m_s", "is_refused"), [(0.0201, False), (0.0199, True)])
def test_a_mission_too_slow_for_a_stall_to_be_noticed_is_refused(speed_m_s: float, is_refused: bool) -> None:
    slow = with_value("mission", "speed_m_s", speed_m_s)
    if is_refused:
        with pytest.raises(ValidationError, match=r"stall_set_point_rad_s is 0.5 rad/s.* at 0.497 rad/s"):
            ControlSettings.model_validate(slow)
    else:
        ControlSettings.model_validate(slow)
    ControlSettings.model_validate({**slow, "safety": {"stall_set_point_rad_s": 0.4}})
