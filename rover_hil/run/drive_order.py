"""The order to move a real rover, without which no run drives one."""

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.device_settings import CanDeviceSettings, DeviceSettings


@dataclass(frozen=True, slots=True)
class DriveOrder:
    """Someone has ordered to move a real rover.

    Made only by `rover_hil.run.drive_permission`, which has asked or warned the user.

    Attributes:
        rover: Which one, in words.
    """

    rover: str


def rover_words(source: str, devices: Mapping[str, DeviceSettings]) -> str:
    """Return in words which rover a configuration drives: its file, and the port of each device."""
    places = ", ".join(f"{name} at {port_of(settings)}" for name, settings in devices.items())
    return f"the rover of {source} ({places})"


def port_of(settings: DeviceSettings) -> str:
    """Return where a device is connected: a serial port, a network interface, or the path of a camera."""
    if isinstance(settings, CanDeviceSettings):
        return settings.channel
    return str(getattr(settings, "port", None) or getattr(settings, "path", ""))
