"""Reads a configuration, and the files that become part of it."""

from difflib import get_close_matches
from importlib import resources
from importlib.abc import Traversable
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from controllers.ground_motion.rig import RigFile
from drivers.errors import ConfigError
from drivers.files import is_file, parse_json, parse_toml, read_text
from drivers.registry import AnyDeviceSettings
from drivers.settings import read_toml
from rover_hil.config.error_text import describe_mistakes, join_lines, validated
from rover_hil.config.moved_keys import rename_sections
from rover_hil.config.schema import SCHEMA_RULES, Config, Draft, Rule, find_conflicts

SHIPPED = resources.files("rover_hil.config") / "shipped"
SHIPPED_CONFIGS = SHIPPED / "configs"
SCHEMA_NAME = "rover-hil-config.schema.json"
"""The JSON schema of a configuration, beside the shipped ones; `make reference` writes it."""

Table = dict[str, object]
KeyPath = tuple[str, str]


def shipped_configs() -> tuple[str, ...]:
    """Return the names of the shipped configurations."""
    names = (item.name for item in SHIPPED_CONFIGS.iterdir())
    return tuple(sorted(Path(name).stem for name in names if name.endswith(".toml")))


def load_config(name_or_path: str, rules: tuple[Rule, ...] = ()) -> Config:
    """Read a configuration by the name of a shipped one or the path of a TOML file.

    Args:
        name_or_path: Name or path.
        rules: What it must fulfil in addition to the schema.

    Raises:
        ConfigError: The file cannot be read, is not TOML, or holds mistakes; one line per mistake with file,
            key and fix.
    """
    table = read_config_table(name_or_path)
    rename_sections(table)
    if name_or_path not in shipped_configs():
        _find_beside(table, Path(name_or_path).parent)
    _simulate_the_same_wheels(table)
    unreadable = _inline_files(table)
    try:
        config = Config.model_validate(table)
    except ValidationError as error:
        details = error.errors()
        mistakes = [
            *describe_mistakes([detail for detail in details if _is_shown(detail, unreadable)], table),
            *(f"{'.'.join(path)}: {message}" for path, message in unreadable.items()),
            *find_conflicts(_draft_of(table, details), (*SCHEMA_RULES, *rules)),
        ]
        raise ConfigError(join_lines(name_or_path, mistakes)) from error
    conflicts = find_conflicts(Draft.complete(config), rules)
    if conflicts:
        raise ConfigError(join_lines(name_or_path, conflicts))
    return config


def schema_text() -> str:
    """Return the JSON schema of a configuration, for editors."""
    return (SHIPPED_CONFIGS / SCHEMA_NAME).read_text("utf-8")


def load_slip_map(name_or_path: str) -> Table:
    """Return the content of a file of slip maps by the name of a shipped one or its path, not yet checked.

    Raises:
        ConfigError: The file cannot be read, or is not TOML.
    """
    return _load_table("slip map", SHIPPED / "slip_maps" / f"{name_or_path}.toml", name_or_path)


def read_rig(path: Path) -> RigFile:
    """Return the rig in a file.

    Raises:
        ConfigError: The file cannot be read, or holds mistakes; one line per mistake with file, key and fix.
    """
    return validated(RigFile, _load_table("rig file", path, str(path)), str(path))


def read_config_text(name_or_path: str) -> str:
    """Return the text of a configuration, given as for `load_config`.

    Raises:
        ConfigError: The file cannot be read.
    """
    if name_or_path in shipped_configs():
        return (SHIPPED_CONFIGS / f"{name_or_path}.toml").read_text("utf-8")
    path = Path(name_or_path)
    try:
        return read_text(path)
    except IsADirectoryError:
        raise ConfigError(f"{path} is a folder; give the TOML file in it") from None
    except FileNotFoundError:
        shipped = shipped_configs()
        close = get_close_matches(name_or_path, shipped, n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise ConfigError(
            f"no configuration {path}: give a TOML file or one of {', '.join(shipped)}{hint}"
        ) from None
    except OSError as error:
        raise ConfigError(f"cannot read configuration {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"cannot read configuration {path}: {error}") from error


def read_config_table(name_or_path: str) -> Table:
    """Return the table of a configuration, given as for `load_config`, not yet checked.

    Raises:
        ConfigError: The file cannot be read, or is not TOML.
    """
    text = read_config_text(name_or_path)
    try:
        return parse_toml(text)
    except ValueError as error:
        raise ConfigError(f"{name_or_path} is not valid TOML: {error}") from error


def _load_table(what: str, shipped: Traversable, name_or_path: str) -> Table:
    """Return the object in a shipped file, or, where there is none, in the file at a path."""
    path = shipped if isinstance(shipped, Path) and is_file(shipped) else Path(name_or_path)
    is_json = shipped.name.endswith(".json")
    if not is_json:
        return read_toml(path, f"{what} {name_or_path}", "name a shipped one or a file")
    try:
        table = parse_json(read_text(path))
    except OSError as error:
        raise ConfigError(
            f"cannot read {what} {name_or_path}: {error.strerror}; name a shipped one or a file"
        ) from error
    except ValueError as error:
        raise ConfigError(f"{what} {name_or_path} is not valid JSON: {error}") from error
    if not isinstance(table, dict):
        raise ConfigError(f"{what} {name_or_path} must hold an object with keys")
    return table


def _simulate_the_same_wheels(table: Table) -> None:
    """Give a simulated rover without wheels of its own those of the section [rover]."""
    rover, simulation = table.get("rover"), table.get("simulation")
    plant = simulation.get("plant") if isinstance(simulation, dict) else None
    if (
        isinstance(rover, dict)
        and isinstance(plant, dict)
        and plant.get("type") == "wheels"
        and "wheels" in rover
    ):
        plant.setdefault("wheels", _without_encoders(rover["wheels"]))


def _without_encoders(wheels: object) -> object:
    """Return wheels as a plant takes them: whether a wheel has an encoder is of no effect on its motion."""
    if not isinstance(wheels, list):
        return wheels
    return [
        {key: value for key, value in wheel.items() if key != "measured"}
        if isinstance(wheel, dict)
        else wheel
        for wheel in wheels
    ]


def _find_beside(table: Table, folder: Path) -> None:
    """Let file names that a configuration holds count from its own folder, where the file is there.

    Any other name stays: it is that of a shipped file, or counts from the current folder as in earlier
    versions.
    """
    simulation, devices = table.get("simulation"), table.get("devices")
    sections: list[tuple[object, tuple[str, ...]]] = [
        (table.get(section), tuple(key for name, key, _, _ in INLINED if name == section))
        for section in dict.fromkeys(name for name, _, _, _ in INLINED)
    ]
    sections.append((simulation.get("plant") if isinstance(simulation, dict) else None, ("site",)))
    if isinstance(devices, dict):
        sections += [(device, ("mapping", "calibration", "path")) for device in devices.values()]
    for settings, keys in sections:
        for key in keys if isinstance(settings, dict) else ():
            name = settings.get(key) if isinstance(settings, dict) else None
            if isinstance(name, str) and isinstance(settings, dict) and _is_beside(folder, name, key):
                settings[key] = str(folder / name)


def _is_beside(folder: Path, name: str, key: str) -> bool:
    try:
        return is_file(folder / name) or (key == "path" and (folder / name).is_dir())
    except (OSError, ValueError):
        return False


INLINED = (
    ("filter", "motor_fields", "motor fields", "motor_fields/{}.toml"),
    ("slip", "maps", "slip map", "slip_maps/{}.toml"),
    ("slip", "gyro_response", "gyro response", "gyro_responses/{}.toml"),
    ("slip", "learned_bracket", "learned bracket", "learned_brackets/{}.toml"),
    ("scomp", "parameters", "parameters", "scomp_parameters/{}.toml"),
    ("scomp", "rig", "rig file", "rigs/{}.json"),
    ("ground_motion", "rig", "rig file", "rigs/{}.json"),
)
"""Section, key, what the file is, and where the shipped ones are."""


def _inline_files(table: Table) -> dict[KeyPath, str]:
    """Put the content of files in the place of their names, so that a log holds all it needs.

    Returns:
        Per key of a file that cannot be read the reason.
    """
    unreadable: dict[KeyPath, str] = {}
    for section, key, what, pattern in INLINED:
        settings = table.get(section)
        name = settings.get(key) if isinstance(settings, dict) else None
        if not isinstance(settings, dict) or not isinstance(name, str):
            continue
        try:
            settings[key] = _load_table(what, SHIPPED / pattern.format(name), name)
        except ConfigError as error:
            unreadable[section, key] = str(error)
    return unreadable


def _is_shown(detail: ErrorDetails, unreadable: dict[KeyPath, str]) -> bool:
    """Return False for what is reported otherwise: a file's name instead of its content, and conflicts."""
    return detail["loc"][:2] not in unreadable and bool(detail["loc"] or detail["type"] != "value_error")


def _draft_of(table: Table, details: list[ErrorDetails]) -> Draft:
    """Return the valid sections, and of the devices the valid ones."""
    broken = {str(part) for detail in details for part in detail["loc"][:1]}
    sections: dict[str, object] = {}
    for name, field in Config.model_fields.items():
        key = field.alias or name
        if key in broken:
            continue
        adapter: TypeAdapter[object] = TypeAdapter(field.rebuild_annotation())
        default = field.get_default(call_default_factory=True, validated_data={})
        sections[name] = adapter.validate_python(table[key]) if key in table else default
    devices = table.get("devices")
    broken_devices = frozenset(
        str(detail["loc"][1]) for detail in details if detail["loc"][:1] == ("devices",) and detail["loc"][1:]
    )
    if isinstance(devices, dict):
        device_adapter: TypeAdapter[AnyDeviceSettings] = TypeAdapter(AnyDeviceSettings)
        sections["devices"] = {
            name: device_adapter.validate_python(device)
            for name, device in devices.items()
            if name not in broken_devices
        }
    config = Config.model_construct(None, **sections)
    return Draft(config, frozenset(sections), broken_devices)
