"""Fitted numbers of estimators against the simplest rule, on floors that they were not fitted on.

    python -m benchmarks.gates.rivals [--first 500] [--floors 20]

- Recognition of surfaces (`RecognitionParameters`): the surfaces of the shipped map against encoders.
- Learning of slip over force (`LearningParameters`), with an excitation that rests for 3 s: against one that
  does not rest.
- Turn by the wheels in a gap of the gyro (`gap_turn_error`): the error of a turn in place by 90 degrees.
"""

import argparse
from collections.abc import Callable
from itertools import product

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.gates.floors import NATURE_NAMES, Way, configure_version, drive_config, row_of
from controllers.estimation.parameters import ESTIMATION
from controllers.motion.rover_geometry import OmniRoverSettings
from drivers.clock import nanoseconds
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor
from tests.nature.floors import NATURES

TURN_RAD, TURN_RAD_S, STEP_S = np.radians(90.0), 0.35, 0.01


def encoders(seed: int) -> Config:
    """Return the rover with encoders and gyro."""
    return configure_version("encoders and gyro", seed)


def surfaces(seed: int) -> Config:
    """Return the rover that recognises the surfaces of its map."""
    return _with_slip(configure_version("shipped", seed), {"use": "surfaces"})


def excited(seed: int) -> Config:
    """Return the rover with the excitation and a calibrated gyro."""
    return configure_version("calibrated gyro", seed)


def learned(seed: int) -> Config:
    """Return the same, whose excitation rests while what it learned is valid."""
    return _with_slip(excited(seed), {"learn": True, "excitation_rest_s": 3.0})


def _with_slip(config: Config, update: dict[str, object]) -> Config:
    assert config.slip is not None
    return config.model_copy(update={"slip": config.slip.model_copy(update=update)})


WAYS: tuple[Callable[[int], Config], ...] = (encoders, surfaces, excited, learned)


def drive_way(nature: str, number: int, seed: int) -> Way:
    """Drive a floor in one of the ways."""
    return drive_config(WAYS[number](seed), nature, seed)[0]


def turn_error(name: str, seed: int) -> float:
    """Return by which share of the wheels' turn a turn in place is wrong."""
    nature = next(each for each in NATURES if each.name == name)
    rover = configure_version("shipped", seed).rover
    assert isinstance(rover, OmniRoverSettings)
    plant = nature.plant(nature.draw_floor(seed), np.random.default_rng(seed), 0)
    arm = rover.base_radius_m / rover.wheel_radius_m
    for step in range(round(TURN_RAD / TURN_RAD_S / STEP_S)):
        plant.set_wheel_speeds([TURN_RAD_S * arm] * 3)
        plant.advance(nanoseconds(STEP_S * (step + 1)))
    truth = plant.truth()
    return 1.0 - float(truth.yaw_rad / (np.mean(truth.wheel_position_rad) / arm))


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--floors", type=int, default=20)
    add_cluster_option(parser)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.floors)
    jobs = list(product(NATURE_NAMES, range(len(WAYS)), seeds))
    with open_executor(arguments.cluster) as pool:
        results = pool.map(drive_way, *zip(*jobs, strict=True))
        ways = list(track(results, "floors", total=len(jobs), console=Console(stderr=True)))
        turns = list(product(NATURE_NAMES, seeds))
        errors = np.abs(list(pool.map(turn_error, *zip(*turns, strict=True))))
    driven = dict(zip(jobs, ways, strict=True))
    for number, way in enumerate(WAYS):
        for nature in NATURE_NAMES:
            print(f"{way.__name__}, {nature}: {row_of([driven[nature, number, seed] for seed in seeds])}")
    deviation = ESTIMATION.pose.gap_turn_error
    print(f"turn by the wheels: error {np.sqrt(np.mean(errors**2)):.2f} rms, {errors.max():.2f} at most")
    for each in (deviation, 1.0):
        print(f"{np.mean(errors <= 2.0 * each):.0%} within two deviations of {each:g}")


if __name__ == "__main__":
    main()
