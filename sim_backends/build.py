"""Builds a simulated world: a plant, and an emulator for every device of the configuration."""

import zlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np
from pydantic import TypeAdapter

from drivers.camera.settings import CameraSettings
from drivers.errors import ConfigError
from drivers.link import CameraImage
from drivers.registry import AnyDeviceSettings
from sim_backends.devices.camera import check_camera, make_camera
from sim_backends.devices.canopen_wheels import make_canopen_wheels
from sim_backends.devices.nmea_compass import make_compass
from sim_backends.devices.nmea_gnss import make_gnss
from sim_backends.devices.overhead_camera import make_overhead_camera
from sim_backends.devices.robotino3_board import make_robotino3_board
from sim_backends.devices.robotino_board import make_robotino_board
from sim_backends.devices.vectornav import make_vectornav
from sim_backends.devices.vesc import make_vesc
from sim_backends.devices.witmotion import make_imu
from sim_backends.devices.xsens import make_xsens
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from sim_backends.settings import EmulatorSettings, SimulationSettings
from sim_backends.world.faults import flip_bit, grey_lower_half, schedule_faults
from sim_backends.world.plant import CompiledPlant, Plant
from sim_backends.world.still_plant import still_plant_like
from sim_backends.world.world import EmulatedDevice, World


def _make_can_node(*arguments: Any) -> EmulatedDevice[bytes]:
    from sim_backends.devices.can_wheels import make_can_node  # what reads DBC files takes half a second

    return make_can_node(*arguments)


Devices: TypeAlias = Mapping[str, AnyDeviceSettings]
IMAGE_DEVICES: Mapping[str, Callable[..., EmulatedDevice[CameraImage]]] = {
    "camera": make_camera,
    "overhead_camera": make_overhead_camera,
}
BYTE_DEVICES: Mapping[str, Callable[..., EmulatedDevice[bytes]]] = {
    "can_wheels": _make_can_node,
    "canopen_wheels": make_canopen_wheels,
    "nmea_compass": make_compass,
    "nmea_gnss": make_gnss,
    "robotino3_board": make_robotino3_board,
    "robotino_board": make_robotino_board,
    "vectornav": make_vectornav,
    "vesc": make_vesc,
    "witmotion": make_imu,
    "xsens": make_xsens,
}
"""What makes the emulator of each type of device."""
EMULATOR: TypeAdapter[EmulatorSettings] = TypeAdapter(EmulatorSettings)


def build_world(devices: Devices, simulation: SimulationSettings, start_ns: int) -> World:
    """Build the simulated rover, and compile it: its first step would do it while time passes.

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
    if isinstance(plant, CompiledPlant):
        plant.compile()
    byte_devices: dict[str, EmulatedDevice[bytes]] = {}
    image_devices: dict[str, EmulatedDevice[CameraImage]] = {}
    for name, settings in devices.items():
        rng = _generator(simulation.seed, f"device {name}")
        fault_rng = _generator(simulation.seed, f"faults {name}")
        faults = [fault for fault in simulation.faults if fault.device == name]
        errors = _errors_of(simulation, name, settings)
        try:
            if settings.type in IMAGE_DEVICES:
                camera = IMAGE_DEVICES[settings.type](name, settings, errors, plant, rng, start_ns)
                schedule_faults(camera, faults, grey_lower_half, fault_rng, start_ns)
                image_devices[name] = camera
            else:
                device = BYTE_DEVICES[settings.type](name, settings, errors, plant, rng, start_ns)
                schedule_faults(device, faults, flip_bit, fault_rng, start_ns)
                byte_devices[name] = device
        except ConfigError as error:
            mistakes.append(str(error))
    if mistakes:
        raise ConfigError("\n".join(mistakes))
    return World(plant, byte_devices, image_devices)


def check_world(devices: Devices, simulation: SimulationSettings) -> None:
    """Check whether the simulated rover can be built, in less time: nothing is compiled, no ground is made.

    Raises:
        ConfigError: As `build_world`.
    """
    mistakes = list(find_simulation_conflicts(devices, simulation))
    if mistakes:
        raise ConfigError("\n".join(mistakes))
    plant = still_plant_like(_make_plant(simulation, 0))
    for name, settings in devices.items():
        errors = _errors_of(simulation, name, settings)
        try:
            if isinstance(settings, CameraSettings) and isinstance(errors, CameraEmulatorSettings):
                check_camera(settings, errors)
            else:
                make = {**IMAGE_DEVICES, **BYTE_DEVICES}[settings.type]
                make(name, settings, errors, plant, _generator(simulation.seed, name), 0)
        except ConfigError as error:
            mistakes.append(str(error))
    if mistakes:
        raise ConfigError("\n".join(mistakes))


def _errors_of(simulation: SimulationSettings, name: str, settings: AnyDeviceSettings) -> EmulatorSettings:
    return simulation.devices.get(name) or EMULATOR.validate_python({"type": settings.type})


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


def _generator(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()),)))
