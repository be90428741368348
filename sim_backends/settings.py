"""Settings of the simulated rover: [simulation]."""

from typing import Annotated, TypeAlias

from pydantic import Field

from drivers.settings import Settings
from sim_backends.devices.can_wheels_settings import CanNodeSettings
from sim_backends.devices.canopen_wheels import CanopenWheelsEmulatorSettings
from sim_backends.devices.nmea_compass import CompassEmulatorSettings
from sim_backends.devices.nmea_gnss import GnssEmulatorSettings
from sim_backends.devices.robotino3_board import Robotino3BoardEmulatorSettings
from sim_backends.devices.robotino_board import RobotinoBoardEmulatorSettings
from sim_backends.devices.vectornav import VectorNavEmulatorSettings
from sim_backends.devices.vesc import VescEmulatorSettings
from sim_backends.devices.witmotion import ImuEmulatorSettings
from sim_backends.devices.xsens import XsensEmulatorSettings
from sim_backends.overhead_scene.settings import OverheadCameraEmulatorSettings
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from sim_backends.world.faults import FaultSettings

PlantSettings: TypeAlias = Annotated[
    RobotinoPlantSettings | ElDoradoPlantSettings | WheelsPlantSettings, Field(discriminator="type")
]
EmulatorSettings: TypeAlias = Annotated[
    CameraEmulatorSettings
    | CanNodeSettings
    | CanopenWheelsEmulatorSettings
    | CompassEmulatorSettings
    | GnssEmulatorSettings
    | ImuEmulatorSettings
    | OverheadCameraEmulatorSettings
    | Robotino3BoardEmulatorSettings
    | RobotinoBoardEmulatorSettings
    | VectorNavEmulatorSettings
    | VescEmulatorSettings
    | XsensEmulatorSettings,
    Field(discriminator="type"),
]


class SimulationSettings(Settings):
    """The simulated rover, the errors of its devices, and what goes wrong.

    Attributes:
        seed: Seed of all random numbers; the same seed gives the same run.
        plant: The true rover and its ground.
        devices: Errors of the devices in [devices], by name; a device without an entry has the default
            errors.
        faults: What fails, and when.
    """

    seed: Annotated[int, Field(ge=0)] = 0
    plant: PlantSettings
    devices: dict[str, EmulatorSettings] = Field(default_factory=dict)
    faults: tuple[FaultSettings, ...] = ()
