"""Settings of wheel encoders and drives on a CAN bus."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.clock import Clock
from drivers.device_settings import DriveSettings
from drivers.driver import DriveCodec
from drivers.link import Link

SLCAN_BIT_RATES = (10_000, 20_000, 50_000, 83_300, 100_000, 125_000, 250_000, 500_000, 750_000, 1_000_000)


class CanWheelsSettings(DriveSettings):
    """Wheel encoders and drives on one CAN bus, classic frames.

    Attributes:
        interface: "socketcan" for a CAN controller of the Linux kernel; "slcan" for an adapter on a serial
            port with the Lawicel text protocol (one that does not reset when its port is opened); "virtual"
            for a bus inside this process.
        channel: Name of the network interface (`can0`), path of the serial port, or any name.
        bit_rate: Speed of the bus. An slcan adapter is set to it. A socketcan interface keeps what `ip link
            set can0 up type can bitrate ...` gave it: enter the same here.
        mapping: Name of a shipped mapping (generic_wheel, odrive_0_5, odrive_0_6), or path of a TOML file,
            relative to the current directory.
    """

    type: Literal["can_wheels"] = "can_wheels"
    interface: Literal["socketcan", "slcan", "virtual"]
    channel: Annotated[str, Field(min_length=1)]
    bit_rate: Annotated[int, Field(ge=10_000, le=1_000_000)] = 500_000
    mapping: Annotated[str, Field(min_length=1)]

    @model_validator(mode="after")
    def _check_bit_rate(self) -> Self:
        if self.interface == "slcan" and self.bit_rate not in SLCAN_BIT_RATES:
            known = ", ".join(str(rate) for rate in SLCAN_BIT_RATES)
            raise ValueError(f"an slcan adapter has no bit_rate {self.bit_rate}: choose one of {known}")
        return self

    def data_files(self) -> Mapping[str, tuple[Path, ...]]:
        """Return the mapping and its DBC file.

        Raises:
            ConfigError: The mapping is missing or wrong.
        """
        from drivers.can_wheels.mapping_file import load_mapping

        bus = load_mapping(self.mapping)
        return {"mapping": (bus.mapping_file, bus.dbc_file)}

    def exclusive_port(self) -> tuple[str, str] | None:
        """Return the serial port of an slcan adapter; any number of programs can use a network interface."""
        return ("channel", self.channel) if self.interface == "slcan" else None

    def make_link(self, clock: Clock) -> Link[bytes]:
        """Build the link to the bus; nothing is opened yet."""
        from drivers.can_link import CanLink

        return CanLink(self.interface, self.channel, self.bit_rate, clock, self.reconnect_limit_s)

    def make_codec(self, name: str) -> DriveCodec:
        """Build the codec of the bus called `name`.

        Raises:
            ConfigError: The mapping or its DBC file is missing or wrong.
        """
        from drivers.can_wheels.codec import CanWheelsCodec
        from drivers.can_wheels.mapping_file import load_mapping

        return CanWheelsCodec(name, load_mapping(self.mapping))
