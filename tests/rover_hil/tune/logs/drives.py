"""Short drives of a rover with a noisy compass and gyro, and configurations that tune its filter."""

import math
from importlib import resources
from pathlib import Path

from controllers.motion.settings import WaypointsMission
from rover_hil.config import Config, load_config
from rover_hil.run.driving import run_virtual

COMPASS_DEG = 4.0
COMPASS_RAD = math.radians(COMPASS_DEG)
GYRO_RAD_S = math.radians(1.5)
DRIVE_S = 10.0
GUESSED_RAD = 0.3
"""Of the compass, in the configuration of the sample."""
PARAMETERS = """
[tune.logs.parameters]
"filter.heading_noise_rad" = { low = 0.03, high = 0.4, scale = "log", unit = "rad" }
"""


def config_text(parameters: str = PARAMETERS) -> str:
    """Return the configuration of the sample `noise`, whose noise was guessed too large."""
    text = resources.files("rover_hil.sample").joinpath("noisy.toml").read_text("utf-8")
    return text.partition("# What `tune logs`")[0] + parameters


def write_config(folder: Path, parameters: str = PARAMETERS) -> Path:
    """Write that configuration; return its path."""
    path = folder / "rover.toml"
    path.write_text(config_text(parameters), "utf-8")
    return path


def write_drives(folder: Path, seeds: range) -> list[Path]:
    """Write a log for each seed; return their paths."""
    config = load_config(str(write_config(folder)))
    mission = WaypointsMission(
        type="waypoints", points=((0.8, 0.0), (0.8, 0.8)), speed_m_s=0.2, heading="along_path"
    )
    paths = [folder / f"{seed}.mcap" for seed in seeds]
    for seed, path in zip(seeds, paths, strict=True):
        run_virtual(with_seed(config, seed).model_copy(update={"mission": mission}), path, DRIVE_S, None)
    return paths


def with_seed(config: Config, seed: int) -> Config:
    """Return the configuration with another seed of all noise."""
    simulation = config.require_simulation().model_copy(update={"seed": seed})
    return config.model_copy(update={"simulation": simulation})
