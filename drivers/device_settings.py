"""Base of a device's settings: its keys in the configuration, and the link, codec and driver that they build.

A device's `settings.py` stays cheap to import; its codec and its link are imported when they are built.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from drivers.clock import Clock
from drivers.driver import Codec, DriveCodec, Driver, WheelDrive
from drivers.emergency_stop import EmergencyStop, PortKind, StopPort
from drivers.link import CameraImage, Link, RawTap
from drivers.settings import PathText, Settings

SLCAN_BIT_RATES = (10_000, 20_000, 50_000, 83_300, 100_000, 125_000, 250_000, 500_000, 750_000, 1_000_000)


class DeviceSettings(Settings):
    """Settings of every device; subclasses add `type: Literal["..."]`.

    Attributes:
        max_age_s: The device counts as silent when its newest sample is older than this.
        reconnect_limit_s: Time for which the link tries to reconnect after a break; then it gives up until a
            restart.
    """

    data_file_keys: ClassVar[tuple[str, ...]] = ()
    """Keys that name a data file: the keys that `data_files` may return."""

    max_age_s: Annotated[float, Field(gt=0, le=10)] = 0.15
    reconnect_limit_s: Annotated[float, Field(ge=0, le=3600)] = 60.0

    def data_files(self) -> Mapping[str, tuple[Path, ...]]:
        """Return the data files that these settings name, by settings key.

        The file that the key names comes first, files it refers to by bare name in the same folder after it.
        They are kept in every log, so that a replay does not depend on files that have changed since.
        """
        return {}

    def exclusive_port(self) -> tuple[str, str] | None:
        """Return key and path of the port that only one device can open; None where devices may share it."""
        return None

    def reports_supply(self) -> bool:
        """Return whether the device reports its supply voltage.

        Raises:
            ConfigError: A data file that the settings name is missing or wrong.
        """
        return False


class ByteDeviceSettings(DeviceSettings):
    """A device that sends bytes: serial chunks or CAN frames."""

    @abstractmethod
    def make_link(self, clock: Clock) -> Link[bytes]:
        """Build the link to the real device; nothing is opened yet."""

    @abstractmethod
    def make_codec(self, name: str) -> Codec[bytes]:
        """Build the codec of the device called `name`.

        Raises:
            ConfigError: A data file that the settings name is missing or wrong.
        """

    @abstractmethod
    def stop_port(self) -> StopPort:
        """Return the port as another process opens it to stop the device."""

    def make_driver(
        self, name: str, link: Link[bytes], clock: Clock, tap: RawTap | None = None
    ) -> Driver[bytes]:
        """Put a driver on a link, whether real, simulated or replayed."""
        return Driver(name, link, self.make_codec(name), clock, max_age_s=self.max_age_s, tap=tap)


class SerialDeviceSettings(ByteDeviceSettings):
    """A byte device on a serial port, 8N1.

    Attributes:
        port: Path of the port; prefer `/dev/serial/by-id/...`, it survives a replug.
        baud_rate: Line speed in bit/s.
    """

    port: PathText
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)]

    def make_link(self, clock: Clock) -> Link[bytes]:
        """Build the serial link; nothing is opened yet."""
        from drivers.serial_link import SerialLink

        return SerialLink(self.port, self.baud_rate, clock, self.reconnect_limit_s)

    def stop_port(self) -> StopPort:
        """Return the serial port."""
        return StopPort(PortKind.SERIAL, self.port, self.baud_rate)

    def exclusive_port(self) -> tuple[str, str]:
        """Return the serial port."""
        return "port", self.port


class CanDeviceSettings(ByteDeviceSettings):
    """A byte device on a CAN bus, classic frames.

    Attributes:
        interface: "socketcan" for a CAN controller of the Linux kernel; "slcan" for an adapter on a serial
            port with the Lawicel text protocol (one that does not reset when its port is opened); "virtual"
            for a bus inside this process.
        channel: Name of the network interface (`can0`), path of the serial port, or any name.
        bit_rate: Speed of the bus. An slcan adapter is set to it. A socketcan interface keeps what `ip link
            set can0 up type can bitrate ...` gave it: enter the same here.
    """

    interface: Literal["socketcan", "slcan", "virtual"]
    channel: PathText
    bit_rate: Annotated[int, Field(ge=10_000, le=1_000_000)] = 500_000

    @model_validator(mode="after")
    def _check_bit_rate(self) -> Self:
        if self.interface == "slcan" and self.bit_rate not in SLCAN_BIT_RATES:
            known = ", ".join(str(rate) for rate in SLCAN_BIT_RATES)
            raise ValueError(f"an slcan adapter has no bit_rate {self.bit_rate}: choose one of {known}")
        return self

    def exclusive_port(self) -> tuple[str, str] | None:
        """Return the serial port of an slcan adapter; any number of programs can use a network interface."""
        return ("channel", self.channel) if self.interface == "slcan" else None

    def make_link(self, clock: Clock) -> Link[bytes]:
        """Build the link to the bus; nothing is opened yet."""
        from drivers.can.link import CanLink

        return CanLink(self.interface, self.channel, self.bit_rate, clock, self.reconnect_limit_s)

    def stop_port(self) -> StopPort:
        """Return the bus; one inside this process cannot be reached from another."""
        if self.interface == "virtual":
            return StopPort(PortKind.NONE, self.channel)
        return StopPort(PortKind(self.interface), self.channel)


class DriveSettings(ByteDeviceSettings):
    """A device that also turns wheels."""

    def wheel_age_s(self, request_period_s: float) -> float | None:
        """Return how old the wheels' positions are at their time stamp; None where it is unknown.

        Args:
            request_period_s: Time between two requests of the host.
        """
        return None

    @abstractmethod
    def make_codec(self, name: str) -> DriveCodec:
        """Build the codec of the drive called `name`."""

    def make_emergency_stop(self) -> EmergencyStop:
        """Return how another process stops this drive.

        Raises:
            ConfigError: A data file that the settings name is missing or wrong.
        """
        return EmergencyStop(self.stop_port(), tuple(self.make_codec("").encode_emergency_stop()))

    def make_driver(
        self, name: str, link: Link[bytes], clock: Clock, tap: RawTap | None = None
    ) -> WheelDrive:
        """Put a driver on a link, whether real, simulated or replayed."""
        return WheelDrive(name, link, self.make_codec(name), clock, max_age_s=self.max_age_s, tap=tap)


class FrameDeviceSettings(DeviceSettings):
    """A device that delivers camera frames."""

    @abstractmethod
    def make_link(self, clock: Clock) -> Link[CameraImage]:
        """Build the link to the real camera, folder or video file; nothing is opened yet."""

    @abstractmethod
    def make_codec(self, name: str) -> Codec[CameraImage]:
        """Build the codec of the camera called `name`."""

    def make_driver(
        self, name: str, link: Link[CameraImage], clock: Clock, tap: RawTap | None = None
    ) -> Driver[CameraImage]:
        """Put a driver on a link, whether real, simulated or replayed."""
        return Driver(name, link, self.make_codec(name), clock, max_age_s=self.max_age_s, tap=tap)


def check_nodes(nodes: Sequence[int], **host: int) -> None:
    """Check that each node of a bus belongs to one wheel.

    Args:
        nodes: Of the wheels.
        host: Key and number of the node of this program.

    Raises:
        ValueError: A node is used twice.
    """
    repeated = next((node for node in nodes if nodes.count(node) > 1), None)
    if repeated is not None:
        raise ValueError(f"two wheels have the node {repeated}: give each its own")
    for key, node in host.items():
        if node in nodes:
            raise ValueError(f"{key} {node} is the node of a wheel: choose another")
