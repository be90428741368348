"""Settings of wheel encoders and drives on a CAN bus."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from drivers.device_settings import CanDeviceSettings, DriveSettings
from drivers.driver import DriveCodec
from drivers.settings import PathText


class CanWheelsSettings(CanDeviceSettings, DriveSettings):
    """Wheel encoders and drives on one CAN bus, classic frames.

    Attributes:
        mapping: Name of a shipped mapping (generic_wheel, steered_wheel, odrive_0_5,
            odrive_0_6), or path of a TOML file from the configuration's folder.
    """

    data_file_keys = ("mapping",)

    type: Literal["can_wheels"] = "can_wheels"
    mapping: PathText

    def data_files(self) -> Mapping[str, tuple[Path, ...]]:
        """Return the mapping and its DBC files.

        Raises:
            ConfigError: The mapping is missing or wrong.
        """
        from drivers.can_wheels.mapping_file import load_mapping

        bus = load_mapping(self.mapping)
        return {"mapping": (bus.mapping_file, *bus.dbc_files)}

    def reports_supply(self) -> bool:
        """Return whether the mapping has the supply voltage.

        Raises:
            ConfigError: The mapping is missing or wrong.
        """
        from drivers.can_wheels.mapping_file import load_mapping

        return load_mapping(self.mapping).mapping.power is not None

    def make_codec(self, name: str) -> DriveCodec:
        """Build the codec of the bus called `name`.

        Raises:
            ConfigError: The mapping or its DBC file is missing or wrong.
        """
        from drivers.can_wheels.codec import CanWheelsCodec
        from drivers.can_wheels.mapping_file import load_mapping

        return CanWheelsCodec(name, load_mapping(self.mapping))
