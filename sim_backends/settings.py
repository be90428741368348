"""What the configuration says about the simulated rover: [simulation]."""

from typing import Annotated, TypeAlias

from pydantic import Field

from drivers.settings import Settings
from sim_backends.camera import CameraEmulatorSettings
from sim_backends.can_node import CanNodeSettings
from sim_backends.compass import CompassEmulatorSettings
from sim_backends.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.faults import FaultSettings
from sim_backends.imu import ImuEmulatorSettings
from sim_backends.overhead_camera import OverheadCameraEmulatorSettings
from sim_backends.robotino.settings import RobotinoPlantSettings
from sim_backends.robotino_board import RobotinoBoardEmulatorSettings

PlantSettings: TypeAlias = Annotated[
    RobotinoPlantSettings | ElDoradoPlantSettings, Field(discriminator="type")
]
EmulatorSettings: TypeAlias = Annotated[
    CameraEmulatorSettings
    | CanNodeSettings
    | CompassEmulatorSettings
    | ImuEmulatorSettings
    | OverheadCameraEmulatorSettings
    | RobotinoBoardEmulatorSettings,
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
