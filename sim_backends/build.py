"""Builds a simulated world: a plant, and an emulator for every device of the configuration."""

import zlib
from collections.abc import Iterator, Mapping
from typing import TypeAlias

import numpy as np
from pydantic import TypeAdapter

from drivers.camera.settings import CameraSettings
from drivers.device_settings import FrameDeviceSettings
from drivers.errors import ConfigError
from drivers.link import CameraImage
from drivers.registry import AnyDeviceSettings
from sim_backends.devices.camera import check_camera
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from sim_backends.settings import EmulatorSettings, SimulationSettings, emulator_of
from sim_backends.world.faults import flip_bit, grey_lower_half, schedule_faults
from sim_backends.world.plant import CompiledPlant, Plant
from sim_backends.world.still_plant import still_plant_like
from sim_backends.world.world import EmulatedDevice, World

Devices: TypeAlias = Mapping[str, AnyDeviceSettings]
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
            device = emulator_of(settings.type)(name, settings, errors, plant, rng, start_ns)
            if isinstance(settings, FrameDeviceSettings):
                schedule_faults(device, faults, grey_lower_half, fault_rng, start_ns)
                image_devices[name] = device
            else:
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
                rng = _generator(simulation.seed, name)
                emulator_of(settings.type)(name, settings, errors, plant, rng, 0)
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
