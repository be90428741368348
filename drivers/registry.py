"""Every device the configuration may name; a new device adds its settings class here."""

from typing import Annotated, TypeAlias, get_args

from pydantic import Field

from drivers.camera.settings import CameraSettings
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.canopen_wheels.settings import CanopenWheelsSettings
from drivers.device_settings import DeviceSettings
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.nmea_gnss.settings import NmeaGnssSettings
from drivers.overhead_camera.settings import OverheadCameraSettings
from drivers.robotino3_board.settings import Robotino3BoardSettings
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.vectornav.settings import VectorNavSettings
from drivers.vesc.settings import VescSettings
from drivers.witmotion.settings import WitMotionSettings
from drivers.xsens.settings import XsensSettings

AnyDeviceSettings: TypeAlias = Annotated[
    CameraSettings
    | CanWheelsSettings
    | CanopenWheelsSettings
    | NmeaCompassSettings
    | NmeaGnssSettings
    | OverheadCameraSettings
    | Robotino3BoardSettings
    | RobotinoBoardSettings
    | VectorNavSettings
    | VescSettings
    | WitMotionSettings
    | XsensSettings,
    Field(discriminator="type"),
]


def device_types() -> tuple[type[DeviceSettings], ...]:
    """Return the settings classes of all devices."""
    union, *_ = get_args(AnyDeviceSettings)
    return get_args(union)
