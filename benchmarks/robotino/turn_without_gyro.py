"""How well do the wheels give the turn of the Robotino in a second without a gyro?

Run `python -m benchmarks.robotino.turn_without_gyro [--missions 6]`. Each second of simulated missions in
which the wheels turned counts: the true turn less that of rolling wheels, as a share of the root of the sum
of squares of what each wheel adds to the turn. Prints JSON: standard deviation, percentiles, greatest value.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from controllers.motion.rover_geometry import OmniRoverSettings
from drivers.clock import nanoseconds
from rover_hil.config import Config, load_config
from rover_hil.drives.drive import read_drive
from rover_hil.run.driving import run_virtual

FIRST_SEED = 900
DURATION_S = 40.0
WINDOW_S = 1.0
STEP_S = 0.5
LEAST_RAD = 0.1
"""Root of the sum of squares below which the wheels hardly turned."""


def drive_mission(seed: int, path: Path) -> Config:
    """Drive the shipped mission on another site into a log; return the configuration."""
    table = load_config("robotino").model_dump(by_alias=True)
    table["simulation"]["seed"] = seed
    config = Config.model_validate(table)
    run_virtual(config, path, DURATION_S, None)
    return config


def errors(config: Config, path: Path) -> Iterator[float]:
    """Yield the error of each second as a share."""
    assert isinstance(config.rover, OmniRoverSettings)
    turn_per_rad = config.rover.wheel_radius_m / (3.0 * config.rover.base_radius_m)
    drive = read_drive(path)
    truth = drive.true_poses()
    true_rad = np.unwrap(truth.yaw_rad)
    wheels = [drive.channels[f"position{wheel}_rad"] for wheel in (1, 2, 3)]
    window_ns, step_ns = nanoseconds(WINDOW_S), nanoseconds(STEP_S)
    for start_ns in range(int(truth.t_ns[0]), int(truth.t_ns[-1]) - window_ns, step_ns):
        ends_ns = np.array([start_ns, start_ns + window_ns])
        turned_rad = np.array([np.diff(np.interp(ends_ns, wheel.t_ns, wheel.value))[0] for wheel in wheels])
        parts_rad = turn_per_rad * turned_rad
        scale_rad = float(np.linalg.norm(parts_rad))
        if scale_rad > LEAST_RAD:
            true_turn_rad = float(np.diff(np.interp(ends_ns, truth.t_ns, true_rad))[0])
            yield (true_turn_rad - float(parts_rad.sum())) / scale_rad


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--missions", type=int, default=6)
    missions = parser.parse_args().missions
    off: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(FIRST_SEED, FIRST_SEED + missions):
            path = Path(folder) / f"{seed}.mcap"
            off += errors(drive_mission(seed, path), path)
    sizes = np.abs(off)
    percentiles = {f"{percent} %": float(np.percentile(sizes, percent)) for percent in (50, 90, 99)}
    figures = {"seconds": len(off), "sd": float(np.sqrt(np.mean(sizes**2))), "greatest": float(sizes.max())}
    print(json.dumps(figures | percentiles, indent=1))


if __name__ == "__main__":
    main()
