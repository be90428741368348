"""A simulated Robotino with the effects of a model file: the plant's own numbers become those of the file."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from controllers.motion.rover_geometry import OmniRoverSettings
from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.gap.data.load import load_model
from rover_hil.gap.output.model_file import ExtendedModel, read_model_file
from sim_backends.models.interface import Values
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.settings import SimulationSettings


class _Known(NamedTuple):
    """What a rule may use.

    Attributes:
        effect: Parameters of the effect.
        base: Base parameters of the model.
        plant: The plant as it was.
        rover: What the controller believes.
    """

    effect: Values
    base: Values
    plant: RobotinoPlantSettings
    rover: OmniRoverSettings


Rule = Callable[[_Known], Mapping[str, float]]
"""Returns the plant's settings, by their place, that an effect sets."""


def _back_emf(known: _Known) -> Mapping[str, float]:
    constant = known.base["motor_constant_v_s_rad"] + known.effect["change"]
    return {"motor.torque_constant_nm_per_a": constant, "motor.speed_constant_v_s_per_rad": constant}


def _stiffness(known: _Known) -> Mapping[str, float]:
    from sim_backends.plants.robotino.dynamics import BRIDGE_COUNTS

    loop = known.plant.speed_loop
    tick_rad_s = math.tau / loop.ticks_per_turn * loop.rate_hz
    volts_per_rad_s = known.base["stiffness_v_s_rad"] + known.effect["change"]
    return {"speed_loop.gain": volts_per_rad_s * tick_rad_s * BRIDGE_COUNTS / known.plant.battery_v}


RULES: Mapping[str, Mapping[str, Rule]] = {
    "robotino-motor": {
        "coulomb_friction": lambda known: {"motor.friction_nm": known.effect["torque"]},
        "viscous_friction": lambda known: {"motor.viscous_nm_s": known.effect["per_speed"]},
        "winding_resistance": lambda known: {
            "motor.resistance_ohm": known.base["resistance_ohm"] + known.effect["change"]
        },
        "load_inertia": lambda known: {
            "motor.inertia_kg_m2": known.base["inertia_kg_m2"] + known.effect["change"]
        },
        "back_emf": _back_emf,
        "loop_stiffness": _stiffness,
        "loop_delay": lambda known: {"speed_loop.set_point_delay_s": known.effect["time"]},
    },
    "robotino-drive": {
        "wheel_radius": lambda known: {
            "wheel_radius_m": known.rover.wheel_radius_m * (1.0 + known.effect["error"])
        },
        "base_radius": lambda known: {
            "wheel_offset_m": known.rover.base_radius_m * (1.0 + known.effect["error"])
        },
    },
}
"""By model and effect; an effect that is not here has no number in the plant."""


def extend_simulation(config: Config, path: Path) -> tuple[SimulationSettings, list[str]]:
    """Return the simulation of a configuration with the effects of a model file, and what was changed.

    Base parameters of the file change nothing: they are within what was known before.

    Args:
        config: Its simulated rover must be a Robotino.
        path: A model file of `robotino-motor` or `robotino-drive`.

    Raises:
        ConfigError: Another rover, another model, or an effect that the plant has no number for.
    """
    file = read_model_file(path)
    rules = RULES.get(file.base)
    if rules is None:
        raise ConfigError(
            f"{path}: a model of {file.base} cannot be simulated; use one of {', '.join(RULES)}"
        )
    plant = None if config.simulation is None else config.simulation.plant
    if (
        config.simulation is None
        or not isinstance(plant, RobotinoPlantSettings)
        or not isinstance(config.rover, OmniRoverSettings)
    ):
        raise ConfigError(f"{path}: a model of {file.base} needs a configuration with a simulated Robotino")
    model = ExtendedModel(load_model(file.base), file)
    cannot = [name for name in model.active if name not in rules]
    if cannot:
        raise ConfigError(
            f"{path}: the simulated Robotino has no {' and no '.join(cannot)}; it can have {', '.join(rules)}"
        )
    values = {item.name: item.nominal for item in model.parameters}
    changes: dict[str, float] = {}
    for name in model.active:
        effect = {
            key.removeprefix(f"{name}."): value for key, value in values.items() if key.startswith(f"{name}.")
        }
        changes |= rules[name](_Known(effect, values, plant, config.rover))
    changed = _with(plant, changes, path)
    changed_values = [f"{place}: {_at(plant, place):.4g} -> {_at(changed, place):.4g}" for place in changes]
    return config.simulation.model_copy(update={"plant": changed}), changed_values


def _with(plant: RobotinoPlantSettings, changes: Mapping[str, float], path: Path) -> RobotinoPlantSettings:
    table = plant.model_dump()
    for place, value in changes.items():
        *folders, name = place.split(".")
        inner = table[folders[0]] if folders else table
        inner[name] = value
    try:
        return RobotinoPlantSettings.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(
            f"{path}: simulation.plant.{where} would be {first['input']}: {first['msg']}"
        ) from error


def _at(plant: RobotinoPlantSettings, place: str) -> float:
    value: object = plant
    for part in place.split("."):
        value = getattr(value, part)
    if not isinstance(value, float):
        raise AssertionError(f"{place} is a number")
    return value
