"""Random test scenarios: ground and noise are drawn from a seed."""

import zlib

import numpy as np

from drivers.device_settings import FrameDeviceSettings
from drivers.errors import ConfigError
from rover_hil.config import Config, validated
from rover_hil.config.tune_settings import MOST_CASES, CaseSettings
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.robotino.site import random_site
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.settings import PlantSettings, SimulationSettings

FIRST_TRAIN_SEED = 1
FIRST_HELD_OUT_SEED = FIRST_TRAIN_SEED + MOST_CASES
FIRST_RANKING_SEED = FIRST_HELD_OUT_SEED + 2 * MOST_CASES  # those between are for benchmarks of the search

INCLINATION_FACTOR = (0.5, 1.5)
STEEPEST_DEG = 40.0
WIDTH_SD = 2.0 * 1.96
"""Width of a 95 % interval over the standard deviation."""


def train_seeds(cases: CaseSettings) -> range:
    """Return the seeds of the search."""
    return range(FIRST_TRAIN_SEED, FIRST_TRAIN_SEED + cases.train)


def ranking_seeds(cases: CaseSettings) -> range:
    """Return the seeds that rank the best trials; the search does not use them."""
    return range(FIRST_RANKING_SEED, FIRST_RANKING_SEED + cases.ranking)


def held_out_seeds(cases: CaseSettings) -> range:
    """Return the seeds of the comparison; none of them is used in the search or the ranking."""
    return range(FIRST_HELD_OUT_SEED, FIRST_HELD_OUT_SEED + cases.held_out)


def with_scenario(config: Config, seed: int) -> Config:
    """Return the configuration with the ground and all noise of `seed`.

    Where [simulation] holds what recorded drives have shown, each of these numbers is drawn from its
    interval, and the site is that of the configuration. Cameras without a role are left out: nothing depends
    on them, and they take most of the time.

    Raises:
        ConfigError: The configuration has no mission or no simulation, or a number that was found has an
            interval beyond the limits of the simulation.
    """
    simulation = config.simulation
    if simulation is None or config.mission is None:
        raise ConfigError("a test scenario needs [mission] and [simulation]: add them")
    kept = {
        name: device
        for name, device in config.devices.items()
        if name in (*config.roles.names(), config.roles.camera) or not isinstance(device, FrameDeviceSettings)
    }
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(b"site"),)))
    is_found = simulation.found is not None
    drawn = _drawn(simulation, rng)
    scenario = SimulationSettings(
        seed=seed,
        plant=drawn.plant if is_found else _random_ground(simulation.plant, rng),
        devices={name: errors for name, errors in drawn.devices.items() if name in kept},
        faults=tuple(fault for fault in simulation.faults if fault.device in kept),
    )
    return config.model_copy(update={"devices": kept, "simulation": scenario})


def _drawn(simulation: SimulationSettings, rng: np.random.Generator) -> SimulationSettings:
    """Return the simulation with each number that was found drawn from its interval.

    The distribution is normal, with the ends of the interval for what is beyond them.
    """
    numbers = {
        name: float(np.clip(rng.normal(each.value, (each.high - each.low) / WIDTH_SD), each.low, each.high))
        for name, each in simulation.found_numbers.items()
    }
    if not numbers:
        return simulation
    source = "a scenario drawn from the intervals of [simulation.found]"
    return validated(SimulationSettings, simulation.with_numbers(numbers), source)


def _random_ground(plant: PlantSettings, rng: np.random.Generator) -> PlantSettings:
    """Return the plant on random ground."""
    match plant:
        case RobotinoPlantSettings() | WheelsPlantSettings():
            return plant.model_copy(update={"site": random_site(rng)})
        case ElDoradoPlantSettings(ground=ground):
            inclination_deg = min(STEEPEST_DEG, ground.inclination_deg * rng.uniform(*INCLINATION_FACTOR))
            slope = {"inclination_deg": inclination_deg, "uphill_deg": rng.uniform(-180.0, 180.0)}
            return plant.model_copy(update={"ground": ground.model_copy(update=slope)})
