"""Base of a device's settings: its keys in the configuration, and the link, codec and driver that they build.

A device's `settings.py` stays cheap to import; its codec and its link are imported when they are built.
"""

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field

from drivers.clock import Clock
from drivers.driver import Codec, DriveCodec, Driver, WheelDrive
from drivers.link import CameraImage, Link, RawTap
from drivers.settings import Settings


class DeviceSettings(Settings):
    """Settings of every device; subclasses add `type: Literal["..."]`.

    Attributes:
        max_age_s: The device counts as silent when its newest sample is older than this.
        reconnect_limit_s: Time for which the link tries to reconnect after a break; then it gives up until a
            restart.
    """

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

    port: Annotated[str, Field(min_length=1)]
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)]

    def make_link(self, clock: Clock) -> Link[bytes]:
        """Build the serial link; nothing is opened yet."""
        from drivers.serial_link import SerialLink

        return SerialLink(self.port, self.baud_rate, clock, self.reconnect_limit_s)

    def exclusive_port(self) -> tuple[str, str]:
        """Return the serial port."""
        return "port", self.port


class DriveSettings(ByteDeviceSettings):
    """A device that also turns wheels."""

    @abstractmethod
    def make_codec(self, name: str) -> DriveCodec:
        """Build the codec of the drive called `name`."""

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
