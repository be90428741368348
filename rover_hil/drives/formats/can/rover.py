"""The rover of a log of a CAN bus: a whole configuration, or geometry and limits beside a mapping."""

from pathlib import Path

from drivers.can_wheels.mapping_file import load_mapping
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.errors import ConfigError
from rover_hil.config import Config, load_config, read_config_table, validated
from rover_hil.drives.formats.can.to_log import can_config
from rover_hil.drives.formats.drive import SILENT_S, WHEELS

SECTIONS = ("rover", "limits", "filter", "safety")
RATE_HZ = 50.0
"""Cycles of the estimate per second, where no configuration gives them."""


def rover_of_log(name_or_path: str, mapping: Path | None) -> Config:
    """Return the configuration that observes the drive in a log of a CAN bus.

    Args:
        name_or_path: A configuration whose wheels are on a CAN bus; with `mapping` its sections [rover],
            [limits] and [filter] are enough, and its devices are not used.
        mapping: Mapping of the wheels.

    Raises:
        ConfigError: A file is missing or wrong; one line per mistake with file, key and fix.
    """
    if mapping is None:
        table = read_config_table(name_or_path)
        if "devices" not in table and "rover" in table:
            raise ConfigError(
                f"{name_or_path} has no [devices]: give the mapping of its wheels with --map, "
                "or a whole configuration"
            )
        return can_config(load_config(name_or_path))
    bus = load_mapping(str(mapping))
    table = read_config_table(name_or_path)
    roles = {"wheels": WHEELS} | ({} if bus.mapping.yaw_rate is None else {"gyro": WHEELS})
    loop = table.get("loop", {"rate_hz": RATE_HZ})
    wheels = CanWheelsSettings(interface="virtual", channel="log", mapping=str(mapping), max_age_s=SILENT_S)
    sections: dict[str, object] = {key: table[key] for key in SECTIONS if key in table}
    whole: dict[str, object] = {
        "schema": "rover-hil-config/1",
        "loop": loop,
        "roles": roles,
        "devices": {WHEELS: wheels.model_dump()},
        **sections,
    }
    return can_config(validated(Config, whole, name_or_path))
