"""[slip] in a configuration: every mistake is one sentence."""

import datetime as dt
from pathlib import Path

import pytest

from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.yaw_excitation import ExcitationSettings
from drivers.errors import ConfigError
from rover_hil.config import Config, load_config, shipped_configs
from rover_hil.doctor.configuration.config_consistency import check_consistency
from rover_hil.doctor.finding import Level
from rover_hil.ready.ages import check_ages
from tests.rover_hil.command import Command

CONFIGS = Path(__file__).parents[2] / "rover_hil" / "config" / "shipped" / "configs"
SLIP = '[slip]\nmaps = "robotino"\nuse = "yaw_probe"\n'


def edited(tmp_path: Path, *changes: tuple[str, str], name: str = "robotino") -> str:
    text = (CONFIGS / f"{name}.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "edited.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def message_of(path: str) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_the_shipped_rover_shakes_and_carries_its_maps() -> None:
    assert "robotino" in shipped_configs()
    slip = load_config("robotino").slip
    assert slip is not None
    assert slip.use == "yaw_probe"
    assert slip.excitation.frequency_hz == 2.0
    assert {surface.name for surface in slip.maps.surfaces.surfaces} >= {"table_surface", "green_surface"}


@pytest.mark.parametrize("use", ["surfaces", "yaw_probe", "linear_m", "isotonic_torque"])
def test_every_shipped_map_can_be_used_and_survives_the_log(tmp_path: Path, use: str) -> None:
    config = load_config(edited(tmp_path, ('use = "yaw_probe"', f'use = "{use}"')))
    assert config.slip is not None
    assert config.slip.use == use
    assert Config.model_validate_json(config.model_dump_json(by_alias=True)) == config


@pytest.mark.parametrize(
    ("slip", "words"),
    [
        (
            '[slip]\nmaps = "robotino"\nuse = "linear"\n',
            "slip: use is 'linear', but there are surfaces, yaw_probe, linear_m",
        ),
        (
            '[slip]\nmaps = "robotino"\nknown_surfaces = ["ice"]\n',
            "slip: known_surfaces has 'ice', but the map knows blue_surface, brown_surface",
        ),
        ('[slip]\nmaps = "none.toml"\n', "cannot read slip map none.toml: No such file or directory"),
        ("[slip]\n", "slip.maps: this key is missing; add it"),
        ('[slip]\nmap = "robotino"\n', "slip.map: unknown key; did you mean maps?"),
        (
            '[slip]\nmaps = "robotino"\n[slip.torque_correction]\nmatrix = "printed"\n',
            "slip.torque_correction.matrix: input should be 'dual', got 'printed'",
        ),
        (
            '[slip]\nmaps = "robotino"\n[slip.torque_correction]\nmatrix = "as_printed"\n',
            "slip.torque_correction.matrix: 'as_printed' was removed, it weighs yaw twice: leave matrix out",
        ),
        (
            '[slip]\nmaps = "robotino"\n[slip.torque_correction]\nbound_rad_s = 50\n',
            "slip.torque_correction.bound_rad_s: input should be less than or equal to 5, got 50",
        ),
    ],
)
def test_mistakes_are_one_sentence(tmp_path: Path, slip: str, words: str) -> None:
    assert words in message_of(edited(tmp_path, (SLIP, slip)))


def test_a_map_file_with_a_mistake_names_the_key(tmp_path: Path) -> None:
    shipped = (CONFIGS.parent / "slip_maps" / "robotino.toml").read_text(encoding="utf-8")
    broken = tmp_path / "broken.toml"
    broken.write_text(shipped.replace("gear_ratio = 16.0", "gear_ratio = 0.0"), encoding="utf-8")
    message = message_of(edited(tmp_path, ('maps = "robotino"', f'maps = "{broken}"')))
    assert "slip.maps.motor.gear_ratio: input should be greater than or equal to 1, got 0.0" in message
    broken.write_text("gear_ratio = ", encoding="utf-8")
    assert "is not valid TOML" in message_of(edited(tmp_path, ('maps = "robotino"', f'maps = "{broken}"')))


OLD_PROBE = """
[yaw_probe]
source = "drives of mine"
amplitude_rad_s = 0.35
frequency_hz = 5.0
lost = [0.0, 0.5]
slips = [0.0, 0.9]
slip_sd = 0.07
directions_rad = [0.0]
speed_range_m_s = [0.1, 0.14]
"""


def test_maps_with_a_fit_of_earlier_versions_are_read(tmp_path: Path) -> None:
    shipped = (CONFIGS.parent / "slip_maps" / "robotino.toml").read_text(encoding="utf-8")
    old = tmp_path / "old.toml"
    old.write_text(shipped + OLD_PROBE, encoding="utf-8")
    slip = load_config(edited(tmp_path, ('maps = "robotino"', f'maps = "{old}"'))).slip
    assert slip is not None
    assert slip.use == "yaw_probe"
    assert slip.excitation.frequency_hz == 2.0


def test_the_probe_needs_a_gyro(tmp_path: Path) -> None:
    without = ('gyro = "imu"\n', "")
    message = message_of(edited(tmp_path, without))
    assert "slip.use is 'yaw_probe', which needs a gyro: name one in roles.gyro, or use 'surfaces'" in message
    assert load_config(edited(tmp_path, without, ('use = "yaw_probe"', 'use = "surfaces"'))).slip is not None


STEERED = """
[[rover.wheels]]
x_m = {x}
y_m = {y}
radius_m = 0.04
{steering}
"""


def wheels_rover(*, steers: bool) -> str:
    """Return a rover of two driven wheels, with two steered ones in front where asked to."""
    text = '[rover]\nkinematics = "wheels"\n'
    for y in (-0.15, 0.15):
        text += STEERED.format(x=0.0, y=y, steering="")
        if steers:
            text += STEERED.format(x=0.3, y=y, steering="steering = { low_deg = -40, high_deg = 40 }")
    return text


@pytest.mark.parametrize(
    ("steers", "words"),
    [
        (True, "steered wheels cannot turn the rover about its centre while it travels: leave [slip] out"),
        (False, "with two driven wheels it is no better than the encoders: leave [slip] out"),
    ],
)
def test_rovers_that_the_excitation_is_not_for_are_refused_with_the_reason(
    tmp_path: Path, *, steers: bool, words: str
) -> None:
    shipped = (CONFIGS / "robotino.toml").read_text(encoding="utf-8")
    rover = shipped[shipped.index("[rover]") : shipped.index("[loop]")]
    message = message_of(edited(tmp_path, (rover, wheels_rover(steers=steers))))
    assert words in message


def test_an_unknown_gyro_is_a_warning_of_check_that_names_the_command() -> None:
    config = load_config("robotino")
    (found,) = [each for each in check_consistency(config) if each.subject == "slip.gyro_response"]
    assert found.level is Level.WARNING
    assert "calibrate imu" in found.fix
    assert config.slip is not None
    gyro = GyroResponse(source="by hand", identified_on="2026-01-01")
    for update in ({"gyro_response": gyro}, {"use": "surfaces"}):
        other = config.model_copy(update={"slip": config.slip.model_copy(update=update)})
        assert "slip.gyro_response" not in {each.subject for each in check_consistency(other)}


@pytest.mark.parametrize(
    ("date", "level"),
    [("2026-01-01", Level.OK), ("2024-01-01", Level.WARNING), ("soon", Level.WARNING)],
)
def test_the_age_of_the_gyros_constants_is_checked(date: str, level: Level) -> None:
    config = load_config("robotino")
    assert config.slip is not None
    gyro = GyroResponse(source="by hand", identified_on=date)
    dated = config.model_copy(update={"slip": config.slip.model_copy(update={"gyro_response": gyro})})
    (found,) = [each for each in check_ages(dated, dt.date(2026, 11, 27)) if each.subject == "imu"]
    assert found.level is level


def test_a_mass_that_nobody_gave_is_told() -> None:
    config = load_config("robotino")
    assert config.slip is not None
    for excitation, count in (
        (ExcitationSettings(), 1),
        (ExcitationSettings(mass_kg=4.0), 0),
        (ExcitationSettings(yaw_inertia_kg_m2=0.1), 0),
    ):
        slip = config.slip.model_copy(update={"excitation": excitation})
        findings = check_consistency(config.model_copy(update={"slip": slip}))
        assert len([each for each in findings if each.subject == "slip.excitation"]) == count


def test_identify_probe_names_what_replaced_it(command: Command) -> None:
    assert command("identify", "probe", "runs", "--out", "a.toml", "--amplitude", "0.35") != 0
    said = " ".join(command.error.split())
    assert "[slip.excitation]" in said
    assert "calibrate imu" in said


def test_a_skid_steer_rover_has_no_maps(tmp_path: Path) -> None:
    message = message_of(
        edited(tmp_path, ("[limits]", '[slip]\nmaps = "robotino"\n\n[limits]'), name="el-dorado")
    )
    assert (
        "slip: its maps are of three omnidirectional wheels, but rover.kinematics is 'skid_steer_4'"
        in message
    )
