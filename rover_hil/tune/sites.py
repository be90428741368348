"""Random test sites: other ground and other noise for every seed, the same for the same seed."""

import math
import zlib

import numpy as np

from controllers.mission import Point, corner_points
from controllers.settings import MissionSettings
from drivers.device_settings import FrameDeviceSettings
from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.tune.settings import MOST_CASES, CaseSettings
from sim_backends.four_wheel_plant import FourWheelPlantSettings
from sim_backends.robotino.settings import RobotinoDynamicPlantSettings
from sim_backends.robotino.site import random_site
from sim_backends.robotino_plant import RectanglePatch, RobotinoPlantSettings, Surface
from sim_backends.settings import PlantSettings, SimulationSettings

FIRST_TRAIN_SEED = 1
FIRST_HELD_OUT_SEED = FIRST_TRAIN_SEED + MOST_CASES

MARGIN_M = 0.3
PATCHES = (2, 6)
PATCH_SHARE = (0.2, 0.6)
FLOOR_SLIP = (0.0, 0.06)
PATCH_SLIP = (0.05, 0.35)
LOAD_PER_SLIP_A = (0.8, 1.6)
INCLINATION_FACTOR = (0.5, 1.5)
STEEPEST_DEG = 40.0


def train_seeds(cases: CaseSettings) -> range:
    """Return the seeds that the search sees."""
    return range(FIRST_TRAIN_SEED, FIRST_TRAIN_SEED + cases.train)


def held_out_seeds(cases: CaseSettings) -> range:
    """Return the seeds of the comparison; none of them is ever a training seed, however many there are."""
    return range(FIRST_HELD_OUT_SEED, FIRST_HELD_OUT_SEED + cases.held_out)


def at_site(config: Config, seed: int) -> Config:
    """Return the configuration on the site of `seed`, with all noise seeded by it too.

    Cameras without a role are left out: they steer nothing and cost most of the time.

    Raises:
        ConfigError: The configuration has no mission or no simulation.
    """
    simulation, mission = config.simulation, config.mission
    if simulation is None or mission is None:
        raise ConfigError("a test site needs [mission] and [simulation]: add them")
    kept = {
        name: device
        for name, device in config.devices.items()
        if name in config.roles.names() or not isinstance(device, FrameDeviceSettings)
    }
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(b"site"),)))
    site = SimulationSettings(
        seed=seed,
        plant=_random_ground(simulation.plant, mission, rng),
        devices={name: errors for name, errors in simulation.devices.items() if name in kept},
        faults=tuple(fault for fault in simulation.faults if fault.device in kept),
    )
    return config.model_copy(update={"devices": kept, "simulation": site})


def _random_ground(plant: PlantSettings, mission: MissionSettings, rng: np.random.Generator) -> PlantSettings:
    """Return the same rover on other ground."""
    match plant:
        case RobotinoPlantSettings():
            start = (plant.start_x_m, plant.start_y_m, math.radians(plant.start_yaw_deg))
            return plant.model_copy(update=_patchwork(_world_corners(mission, *start), rng))
        case RobotinoDynamicPlantSettings():
            return plant.model_copy(update={"site": random_site(rng)})
        case FourWheelPlantSettings(ground=ground):
            inclination_deg = min(STEEPEST_DEG, ground.inclination_deg * rng.uniform(*INCLINATION_FACTOR))
            slope = {"inclination_deg": inclination_deg, "uphill_deg": rng.uniform(-180.0, 180.0)}
            return plant.model_copy(update={"ground": ground.model_copy(update=slope)})


def _world_corners(mission: MissionSettings, x_m: float, y_m: float, yaw_rad: float) -> list[Point]:
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    return [
        (x_m + cosine * along - sine * across, y_m + sine * along + cosine * across)
        for along, across in corner_points(mission)
    ]


def _patchwork(corners: list[Point], rng: np.random.Generator) -> dict[str, object]:
    """Return a floor, and patches strewn over the area of the path.

    Softer ground slips more and asks for more current, by a factor that differs from patch to patch.
    """
    lows, highs = np.min(corners, axis=0) - MARGIN_M, np.max(corners, axis=0) + MARGIN_M
    patches: list[RectanglePatch] = []
    for _ in range(int(rng.integers(*PATCHES, endpoint=True))):
        centre, half = rng.uniform(lows, highs), 0.5 * rng.uniform(*PATCH_SHARE, 2) * (highs - lows)
        (x_min, y_min), (x_max, y_max) = (centre - half).tolist(), (centre + half).tolist()
        slip = float(rng.uniform(*PATCH_SLIP))
        patches.append(
            RectanglePatch(
                type="rectangle",
                slip=slip,
                load_current_a=slip * float(rng.uniform(*LOAD_PER_SLIP_A)),
                x_min_m=x_min,
                x_max_m=x_max,
                y_min_m=y_min,
                y_max_m=y_max,
            )
        )
    floor_slip = float(rng.uniform(*FLOOR_SLIP))
    floor = Surface(slip=floor_slip, load_current_a=floor_slip * float(rng.uniform(*LOAD_PER_SLIP_A)))
    return {"floor": floor, "patches": tuple(patches)}
