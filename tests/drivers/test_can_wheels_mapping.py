"""Mapping files: what is filled in, and what is reported when something is wrong."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from drivers.can_wheels.mapping_file import SHIPPED_FOLDER, load_mapping
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.errors import ConfigError

SHIPPED = ("generic_wheel", "odrive_0_5", "odrive_0_6")

MINIMAL = """dbc = "generic_wheel.dbc"

[every_wheel]
speed = { message = "Wheel{node}_State", signal = "Speed", unit = "rad/s" }
setpoint = { message = "Wheel{node}_Setpoint", signal = "Speed", unit = "rad/s" }

[[wheel]]
node = 0
"""


def write_mapping(folder: Path, text: str) -> str:
    (folder / "generic_wheel.dbc").write_bytes((SHIPPED_FOLDER / "generic_wheel.dbc").read_bytes())
    path = folder / "rover.toml"
    path.write_text(text, "utf-8")
    return str(path)


def settings(mapping: str) -> CanWheelsSettings:
    return CanWheelsSettings(interface="virtual", channel="test", mapping=mapping)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_mapping_has_four_wheels_in_the_order_of_the_rover(name: str) -> None:
    bus = load_mapping(name)
    assert [wheel.node for wheel in bus.mapping.wheel] == [0, 1, 2, 3]
    assert all(wheel.position and wheel.current and wheel.setpoint for wheel in bus.mapping.wheel)
    assert settings(name).make_codec("wheels").wheel_count == 4


def test_node_is_filled_in_everywhere(tmp_path: Path) -> None:
    text = (
        MINIMAL
        + """
[[wheel]]
node = 3
gear_ratio = 2
speed = { message = "Wheel1_State", signal = "Speed", unit = "rpm" }

[[start]]
message = "Wheel{node}_Setpoint"
signals = { Speed = 1.5 }

[[stop]]
message = "Wheel2_Setpoint"
signals = { Speed = 0 }

[[protection]]
messages = ["Wheel{node}_State", "Drive_Status"]
counter = "Counter"
"""
    )
    mapping = load_mapping(write_mapping(tmp_path, text)).mapping
    first, second = mapping.wheel
    assert first.speed is not None
    assert (first.speed.message, first.speed.unit, first.gear_ratio) == ("Wheel0_State", "rad/s", 1.0)
    assert second.speed is not None
    assert (second.speed.message, second.speed.unit, second.gear_ratio) == ("Wheel1_State", "rpm", 2.0)
    assert second.setpoint is not None
    assert second.setpoint.message == "Wheel3_Setpoint"
    assert [frame.message for frame in mapping.start] == ["Wheel0_Setpoint", "Wheel3_Setpoint"]
    assert [frame.message for frame in mapping.stop] == ["Wheel2_Setpoint"]
    assert mapping.protection[0].messages == ("Wheel0_State", "Wheel3_State", "Drive_Status")


def test_position_span_is_the_range_of_the_signal_unless_told(tmp_path: Path) -> None:
    position = '{ message = "Wheel{node}_State", signal = "Position", unit = "deg" }'
    whole = MINIMAL.replace("speed =", f"position = {position}\nspeed =", 1)
    bus = load_mapping(write_mapping(tmp_path, whole))
    assert bus.position_span(bus.mapping.wheel[0]) == 2**20
    bus = load_mapping(write_mapping(tmp_path, whole.replace('"deg" }', '"deg", wrap = 360 }')))
    assert bus.position_span(bus.mapping.wheel[0]) == 360
    odrive = load_mapping("odrive_0_6")
    assert odrive.position_span(odrive.mapping.wheel[0]) is None


SPEED = 'speed = { message = "Wheel{node}_State", signal = "Speed", unit = "rad/s" }'
SETPOINT = 'setpoint = { message = "Wheel{node}_Setpoint", signal = "Speed", unit = "rad/s" }'
TICKS = 'position = { message = "Wheel0_State", signal = "Position", unit = "ticks" }'

WRONG = [
    (
        SPEED,
        SPEED.replace("State", "Stat"),
        "every_wheel.speed: .*'Wheel0_Stat'; did you mean 'Wheel0_State'",
    ),
    (SPEED, SPEED.replace('"Speed"', '"Sped"'), "every_wheel.speed: .*'Sped'; did you mean 'Speed'"),
    (SPEED, SPEED.replace("rad/s", "mph"), "every_wheel.speed.unit: .*'rpm'"),
    (SPEED, SPEED.replace("rad/s", "km/h"), "every_wheel.speed: give radius_m"),
    (SPEED, SPEED.replace("speed", "current"), "every_wheel.current.unit: .*'mA'"),
    (SPEED, TICKS, "every_wheel.position: give ticks_per_revolution"),
    (SPEED, "", "wheel.0: the wheel has neither position nor speed"),
    (
        SETPOINT,
        SETPOINT.replace(" }", ", fixed = { Enable = 1 } }"),
        "every_wheel.setpoint: .*no signal 'Enable'",
    ),
    (
        SETPOINT,
        SETPOINT.replace(" }", ", fixed = { Counter = 16 } }"),
        "every_wheel.setpoint: .*cannot hold 16",
    ),
    ("node = 0", "", "wheel: give one"),
    ("node = 0", "node = 0\ngear_ratio = 0", "wheel.0.gear_ratio: .*greater than 0"),
    ("node = 0", "node = 0\nsign = 2", "wheel.0.sign: "),
    ("node = 0", "node = 0\ngear = 2", "wheel.0.gear: unknown key"),
    ("node = 0", "node = 0\nfault = 3", "wheel.0.fault: "),
    ("node = 0", "node = 0\n[[wheel]]\nnode = 0", "two wheels have the node 0"),
    ("[[wheel]]", "[wheel]", "wheel: give one"),
    ("[[wheel]]", "[[wheel", "is not valid TOML"),
    ('dbc = "generic_wheel.dbc"', "", "dbc: this key is missing"),
    ("generic_wheel.dbc", "other.dbc", "dbc: no file other.dbc in the same folder"),
    ("generic_wheel.dbc", "../generic_wheel.dbc", "dbc.0: "),
    ("generic_wheel.dbc", "rover.toml", "cannot read DBC file"),
]

STATUS = 'messages = ["Drive_Status"]'
WRONG_PROTECTION = [
    (f'{STATUS}\nchecksum = "Faults"\nalgorithm = "xor8"', "0: checksum 'Faults' is not one whole byte"),
    (f'{STATUS}\nchecksum = "Checksum"', "0: checksum and algorithm belong together"),
    (f'{STATUS}\ncounter = "Counter"\ncounter_modulus = 17', "0: signal 'Counter' cannot hold 16"),
    (
        'messages = ["Wheel{node}_Sate"]\ncounter = "Counter"',
        "0: .*'Wheel0_Sate'; did you mean 'Wheel0_State'",
    ),
    ("messages = []", "0.messages: "),
]


@pytest.mark.parametrize(("old", "new", "told"), WRONG)
def test_wrong_mapping_is_refused_with_file_key_and_fix(
    tmp_path: Path, old: str, new: str, told: str
) -> None:
    assert old in MINIMAL
    path = write_mapping(tmp_path, MINIMAL.replace(old, new, 1))
    with pytest.raises(ConfigError, match=told) as caught:
        load_mapping(path)
    assert path in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "keys"),
    [
        (
            (('"rad/s"', '"mph"'), ("node = 0", "node = 0\ngear = 2")),
            ("every_wheel.speed.unit", "wheel.0.gear"),
        ),
        (
            (("_State", "_Stat"), ("_Setpoint", "_Setpont")),
            ("every_wheel.speed", "every_wheel.setpoint"),
        ),
    ],
)
def test_all_mistakes_of_a_mapping_come_at_once(
    tmp_path: Path, changes: tuple[tuple[str, str], ...], keys: tuple[str, ...]
) -> None:
    text = MINIMAL
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = write_mapping(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_mapping(path)
    lines = str(caught.value).splitlines()
    assert len(lines) == len(keys)
    assert all(line.startswith(f"{path}: {key}") for line, key in zip(lines, keys, strict=True))


@pytest.mark.parametrize(("section", "told"), WRONG_PROTECTION)
def test_wrong_protection_is_refused(tmp_path: Path, section: str, told: str) -> None:
    path = write_mapping(tmp_path, f"{MINIMAL}\n[[protection]]\n{section}\n")
    with pytest.raises(ConfigError, match=rf"rover\.toml: protection\.{told}"):
        load_mapping(path)


def test_start_message_without_signals_must_exist_too(tmp_path: Path) -> None:
    path = write_mapping(tmp_path, f'{MINIMAL}\n[[start]]\nmessage = "Clear"\nsignals = {{}}\n')
    with pytest.raises(ConfigError, match=r"start\.0: the DBC file has no message 'Clear'"):
        load_mapping(path)


def test_unknown_name_suggests_the_shipped_ones() -> None:
    with pytest.raises(
        ConfigError, match=r"no mapping 'odrive_06'.*generic_wheel.*did you mean 'odrive_0_6'"
    ):
        load_mapping("odrive_06")


def test_the_shipped_mappings_are_listed_once() -> None:
    with pytest.raises(ConfigError) as caught:
        load_mapping("nowhere.toml")
    assert str(caught.value).count("generic_wheel") == 1


def test_data_files_are_mapping_and_dbc_in_one_folder(tmp_path: Path) -> None:
    path = write_mapping(tmp_path, MINIMAL)
    mapping, dbc = settings(path).data_files()["mapping"]
    assert (mapping, dbc) == (Path(path), tmp_path / "generic_wheel.dbc")
    mapping, dbc = settings("odrive_0_5").data_files()["mapping"]
    assert mapping.name == "odrive_0_5.toml"
    assert dbc.is_file()
    assert dbc.parent == mapping.parent


def test_slcan_adapter_must_know_the_bit_rate() -> None:
    with pytest.raises(ValidationError, match="no bit_rate 300000"):
        CanWheelsSettings(interface="slcan", channel="x", bit_rate=300_000, mapping="generic_wheel")
    assert (
        CanWheelsSettings(interface="socketcan", channel="x", bit_rate=300_000, mapping="m").bit_rate
        == 300_000
    )


def test_a_mistake_of_every_wheel_is_told_once_and_that_of_a_wheel_under_it(tmp_path: Path) -> None:
    own = 'speed = { message = "Wheel1_State", signal = "Sped", unit = "rad/s" }'
    text = f"{MINIMAL.replace('_State', '_Stat')}\n[[wheel]]\nnode = 1\n{own}\n[[wheel]]\nnode = 2\n"
    with pytest.raises(ConfigError) as caught:
        load_mapping(write_mapping(tmp_path, text))
    keys = [line.split(": ")[1] for line in str(caught.value).splitlines()]
    assert keys == ["every_wheel.speed", "wheel.1.speed"]
