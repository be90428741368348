"""Short drives of the dynamic Robotino for its tests."""

import math

import numpy as np

from drivers.clock import nanoseconds
from sim_backends.plants.robotino.plant import RobotinoPlant
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.robotino.site import Site
from sim_backends.world.plant import Truth

START_NS = 1_000_000_000
RADIUS_M = 0.040
OFFSET_M = 0.125
STEP_RAD_S = 27 * math.tau / 60 / 16
SIN_60 = math.sqrt(3) / 2


def on(site: Site | str, **changes: object) -> RobotinoPlantSettings:
    return RobotinoPlantSettings.model_validate({"site": site, **changes})


def plant(rover: RobotinoPlantSettings, seed: int = 1) -> RobotinoPlant:
    return RobotinoPlant(rover, np.random.default_rng(seed), START_NS)


def drive(rover: RobotinoPlantSettings, speeds: tuple[float, ...], duration_s: float, seed: int = 1) -> Truth:
    moving = plant(rover, seed)
    moving.set_wheel_speeds(speeds)
    moving.advance(START_NS + nanoseconds(duration_s))
    return moving.truth()


def ahead(speed_m_s: float) -> tuple[float, float, float]:
    return (-SIN_60 * speed_m_s / RADIUS_M, 0.0, SIN_60 * speed_m_s / RADIUS_M)


def mean_currents(rover: RobotinoPlantSettings, speeds: tuple[float, ...]) -> list[float]:
    moving = plant(rover)
    moving.set_wheel_speeds(speeds)
    samples = []
    for t_ms in range(1000, 3000, 7):
        moving.advance(START_NS + t_ms * 1_000_000)
        samples.append(np.abs(moving.truth().motor_current_a))
    return np.mean(samples, axis=0).tolist()  # type: ignore[no-any-return]
