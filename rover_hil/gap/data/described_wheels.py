"""The model of a rover's wheels, from a configuration or from what a log or a file of columns knows."""

import math
from dataclasses import dataclass

import numpy as np

from controllers.motion.rover_geometry import OmniRoverSettings, RoverSettings, WheelsRoverSettings
from controllers.motion.wheel_settings import WheelSettings
from drivers.errors import ConfigError
from rover_hil.config import Config
from sim_backends.plants.wheels.settings import PlantWheel, WheelsPlantSettings
from sim_backends.wheels_model.model import WheelsModel

OTHER_MODELS = "for a Robotino use robotino-drive, for four wheels that do not steer four-wheel-drive"


@dataclass(frozen=True, slots=True, kw_only=True)
class DescribedWheels:
    """A rover on any set of wheels.

    Attributes:
        rover: Its geometry.
        model: Of its drive.
        assumed: What no file describes and the model assumes; empty where it is described.
    """

    rover: RoverSettings
    model: WheelsModel
    assumed: str = ""


def wheels_by_config(source: str, config: Config) -> DescribedWheels:
    """Return the rover of a configuration, with the wheels, loads and ground of [simulation.plant].

    Args:
        source: The configuration, for messages.
        config: The same, read.

    Raises:
        ConfigError: Its simulated rover has no list of wheels, or a driven wheel has no encoder.
    """
    if config.simulation is None:
        return wheels_by_geometry(source, config)
    plant = config.simulation.plant
    if not isinstance(plant, WheelsPlantSettings):
        raise ConfigError(
            f"gap rover {source}: the model needs [simulation.plant] with type = 'wheels': masses, castors "
            f"and site of the rover; {OTHER_MODELS}"
        )
    _require_encoders(source, config.rover)
    return DescribedWheels(rover=config.rover, model=WheelsModel(plant))


def wheels_by_geometry(source: str, config: Config) -> DescribedWheels:
    """Return the rover of [rover] alone: of a log, whose simulated rover may have other wheels in truth.

    Loads, castors and ground are those of [simulation.plant] in the log, where it describes wheels;
    otherwise every wheel carries the same load, on the default ground.

    Args:
        source: The log, file of columns or configuration, for messages.
        config: Its configuration.

    Raises:
        ConfigError: [rover] does not give the place of each wheel, or a driven wheel has no encoder.
    """
    wheels = wheels_of(config.rover)
    if wheels is None:
        raise ConfigError(
            f"gap rover {source}: rover.kinematics = '{config.rover.kinematics}' does not give the place of "
            f"each wheel: describe the rover by a list of wheels; {OTHER_MODELS}"
        )
    _require_encoders(source, config.rover)
    plant = None if config.simulation is None else config.simulation.plant
    own = tuple(PlantWheel.model_validate(wheel.model_dump(exclude={"measured"})) for wheel in wheels)
    if isinstance(plant, WheelsPlantSettings):
        nominal = plant.model_copy(update={"wheels": own, "wheel_radius_error": 0.0})
        return DescribedWheels(rover=config.rover, model=WheelsModel(nominal))
    x_m, y_m = np.mean([(wheel.x_m, wheel.y_m) for wheel in wheels], axis=0).tolist()
    level = WheelsPlantSettings(wheels=own, centre_of_mass_x_m=x_m, centre_of_mass_y_m=y_m)
    return DescribedWheels(
        rover=config.rover,
        model=WheelsModel(level),
        assumed=f"{source} describes no loads: the model assumes the same load on each wheel, no castors and "
        f"the ground '{level.site.floor}'; a configuration with [simulation.plant] describes them",
    )


def wheels_of(rover: RoverSettings) -> tuple[WheelSettings, ...] | None:
    """Return the wheels of a rover, each with its place; None where the places are not known."""
    if isinstance(rover, WheelsRoverSettings):
        return rover.wheels
    if not isinstance(rover, OmniRoverSettings):
        return None
    places = [(angle, math.radians(angle)) for angle in rover.wheel_angles_deg]
    return tuple(
        WheelSettings(
            x_m=rover.base_radius_m * math.cos(angle_rad),
            y_m=rover.base_radius_m * math.sin(angle_rad),
            radius_m=rover.wheel_radius_m,
            angle_deg=math.remainder(angle_deg + 90.0, 360.0),
            roller_deg=90.0,
        )
        for angle_deg, angle_rad in places
    )


def _require_encoders(source: str, rover: RoverSettings) -> None:
    for number, wheel in enumerate(wheels_of(rover) or ()):
        if wheel.driven and not wheel.measured:
            raise ConfigError(
                f"gap rover {source}: rover.wheels.{number}.measured is false, but the model needs the speed "
                "of each driven wheel: this rover can only be analysed with an encoder there"
            )
