"""Builds a simulated world: a plant, and an emulator for every device of the configuration."""

import zlib
from collections.abc import Iterator, Mapping
from typing import TypeAlias, TypeVar, cast

import numpy as np

from drivers.camera.settings import CameraSettings
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.canopen_wheels.settings import CanopenWheelsSettings
from drivers.errors import ConfigError
from drivers.link import CameraImage
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.nmea_gnss.settings import NmeaGnssSettings
from drivers.overhead_camera.settings import OverheadCameraSettings
from drivers.registry import AnyDeviceSettings
from drivers.robotino3_board.settings import Robotino3BoardSettings
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.vectornav.settings import VectorNavSettings
from drivers.vesc.settings import VescSettings
from drivers.witmotion.settings import WitMotionSettings
from drivers.xsens.settings import XsensSettings
from sim_backends.devices.camera import make_camera
from sim_backends.devices.can_wheels import CanNodeSettings, make_can_node
from sim_backends.devices.canopen_wheels import CanopenWheelsEmulatorSettings, make_canopen_wheels
from sim_backends.devices.nmea_compass import CompassEmulatorSettings, make_compass
from sim_backends.devices.nmea_gnss import GnssEmulatorSettings, make_gnss
from sim_backends.devices.overhead_camera import make_overhead_camera
from sim_backends.devices.robotino3_board import Robotino3BoardEmulatorSettings, make_robotino3_board
from sim_backends.devices.robotino_board import RobotinoBoardEmulatorSettings, make_robotino_board
from sim_backends.devices.vectornav import VectorNavEmulatorSettings, make_vectornav
from sim_backends.devices.vesc import VescEmulatorSettings, make_vesc
from sim_backends.devices.witmotion import ImuEmulatorSettings, make_imu
from sim_backends.devices.xsens import XsensEmulatorSettings, make_xsens
from sim_backends.overhead_scene.settings import OverheadCameraEmulatorSettings
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from sim_backends.settings import EmulatorSettings, SimulationSettings
from sim_backends.world.faults import flip_bit, grey_lower_half, schedule_faults
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice, World

Devices: TypeAlias = Mapping[str, AnyDeviceSettings]
ByteSensor: TypeAlias = (
    NmeaCompassSettings | NmeaGnssSettings | VectorNavSettings | WitMotionSettings | XsensSettings
)
ByteDevice: TypeAlias = (
    ByteSensor
    | CanWheelsSettings
    | CanopenWheelsSettings
    | Robotino3BoardSettings
    | RobotinoBoardSettings
    | VescSettings
)
EmulatorT = TypeVar("EmulatorT", bound=EmulatorSettings)
"""A device whose settings are missing in `EmulatorSettings` is an error of types at its `_errors_of`."""


def build_world(devices: Devices, simulation: SimulationSettings, start_ns: int) -> World:
    """Build the simulated rover.

    Each device, its faults and the plant draw from generators of their own, so that adding a device does
    not change the others.

    Args:
        devices: The devices of the configuration, by name.
        simulation: The rover, the errors of its devices, and the faults.
        start_ns: When the simulation starts.

    Raises:
        ConfigError: The simulation names devices that do not exist, or its rover does not fit them; one line
            per mistake.
    """
    mistakes = list(find_simulation_conflicts(devices, simulation))
    if mistakes:
        raise ConfigError("\n".join(mistakes))
    plant = _make_plant(simulation, start_ns)
    byte_devices: dict[str, EmulatedDevice[bytes]] = {}
    image_devices: dict[str, EmulatedDevice[CameraImage]] = {}
    for name, settings in devices.items():
        rng = _generator(simulation.seed, f"device {name}")
        fault_rng = _generator(simulation.seed, f"faults {name}")
        faults = [fault for fault in simulation.faults if fault.device == name]
        try:
            if isinstance(settings, CameraSettings | OverheadCameraSettings):
                camera = _make_image_device(name, settings, simulation, plant, rng, start_ns)
                schedule_faults(camera, faults, grey_lower_half, fault_rng, start_ns)
                image_devices[name] = camera
            else:
                device = _make_byte_device(name, settings, simulation, plant, rng, start_ns)
                schedule_faults(device, faults, flip_bit, fault_rng, start_ns)
                byte_devices[name] = device
        except ConfigError as error:
            mistakes.append(str(error))
    if mistakes:
        raise ConfigError("\n".join(mistakes))
    return World(plant, byte_devices, image_devices)


def find_simulation_conflicts(
    devices: Mapping[str, AnyDeviceSettings | None], simulation: SimulationSettings
) -> Iterator[str]:
    """Yield the simulated devices that do not exist or have another type, each with its fix.

    Args:
        devices: The devices of the configuration by name; None for one whose settings are not valid.
        simulation: The simulated rover.
    """
    named = [(f"devices.{name}", name) for name in simulation.devices]
    named += [(f"faults.{index}.device", fault.device) for index, fault in enumerate(simulation.faults)]
    for key, name in named:
        if name not in devices:
            yield f"simulation.{key}: [devices] has no '{name}': name one of {', '.join(devices)}"
    for name, emulator in simulation.devices.items():
        device = devices.get(name)
        if device is not None and device.type != emulator.type:
            yield f"simulation.devices.{name}.type: must be '{device.type}', as in [devices]"


def _make_plant(simulation: SimulationSettings, start_ns: int) -> Plant:
    rng = _generator(simulation.seed, "plant")
    match simulation.plant:
        case RobotinoPlantSettings() as dynamic:
            from sim_backends.plants.robotino.plant import RobotinoPlant  # numba takes a second to load

            return RobotinoPlant(dynamic, rng, start_ns)
        case ElDoradoPlantSettings() as four_wheels:
            from sim_backends.plants.el_dorado.plant import ElDoradoPlant

            return ElDoradoPlant(four_wheels, rng, start_ns)
        case WheelsPlantSettings() as any_wheels:
            from sim_backends.plants.wheels.plant import WheelsPlant

            return WheelsPlant(any_wheels, rng, start_ns)


def _make_image_device(
    name: str,
    device: CameraSettings | OverheadCameraSettings,
    simulation: SimulationSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[CameraImage]:
    match device:
        case CameraSettings():
            camera = _errors_of(CameraEmulatorSettings, name, device, simulation)
            return make_camera(name, device, camera, plant, rng, start_ns)
        case OverheadCameraSettings():
            overhead = _errors_of(OverheadCameraEmulatorSettings, name, device, simulation)
            return make_overhead_camera(name, device, overhead, plant, rng, start_ns)


def _make_byte_device(
    name: str,
    device: ByteDevice,
    simulation: SimulationSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    match device:
        case CanWheelsSettings():
            node = _errors_of(CanNodeSettings, name, device, simulation)
            return make_can_node(name, device, node, plant, rng, start_ns)
        case CanopenWheelsSettings():
            drives = _errors_of(CanopenWheelsEmulatorSettings, name, device, simulation)
            return make_canopen_wheels(name, device, drives, plant, rng, start_ns)
        case Robotino3BoardSettings():
            board_3 = _errors_of(Robotino3BoardEmulatorSettings, name, device, simulation)
            return make_robotino3_board(name, device, board_3, plant, rng)
        case RobotinoBoardSettings():
            board = _errors_of(RobotinoBoardEmulatorSettings, name, device, simulation)
            return make_robotino_board(name, device, board, plant, rng, start_ns)
        case VescSettings():
            vesc = _errors_of(VescEmulatorSettings, name, device, simulation)
            return make_vesc(name, device, vesc, plant, rng, start_ns)
        case sensor:
            return _make_sensor(name, sensor, simulation, plant, rng, start_ns)


def _make_sensor(
    name: str,
    device: ByteSensor,
    simulation: SimulationSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    match device:
        case NmeaCompassSettings():
            compass = _errors_of(CompassEmulatorSettings, name, device, simulation)
            return make_compass(name, device, compass, plant, rng, start_ns)
        case NmeaGnssSettings():
            gnss = _errors_of(GnssEmulatorSettings, name, device, simulation)
            return make_gnss(name, device, gnss, plant, rng, start_ns)
        case VectorNavSettings():
            vectornav = _errors_of(VectorNavEmulatorSettings, name, device, simulation)
            return make_vectornav(name, device, vectornav, plant, rng, start_ns)
        case WitMotionSettings():
            imu = _errors_of(ImuEmulatorSettings, name, device, simulation)
            return make_imu(name, device, imu, plant, rng, start_ns)
        case XsensSettings():
            xsens = _errors_of(XsensEmulatorSettings, name, device, simulation)
            return make_xsens(name, device, xsens, plant, rng, start_ns)


def _errors_of(
    kind: type[EmulatorT], name: str, device: AnyDeviceSettings, simulation: SimulationSettings
) -> EmulatorT:
    """Return the errors of a device, the default ones when the configuration has none."""
    return cast("EmulatorT", kind.model_validate(simulation.devices.get(name) or {"type": device.type}))


def _generator(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()),)))
