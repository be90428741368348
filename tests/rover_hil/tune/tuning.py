"""A rover to tune, and simulated missions that answer at once."""

import math
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

import numpy as np

from rover_hil.config import Config, load_config
from rover_hil.tune.metrics import TruePath
from rover_hil.tune.simulated_mission import SimulatedMission

SHIPPED_TUNE = "# What `rover-hil tune` may change"
SHIPPED = Path(__file__).parents[3] / "rover_hil" / "config" / "shipped" / "configs"
BEST_LOOKAHEAD_M = 0.1
UNSTABLE_BELOW_M = 0.04

MISSION = """
[mission]
type = "rectangle"
length_m = 0.2
width_m = 0.1
speed_m_s = 0.15
lookahead_m = 0.5    # as first guessed
"""
TUNE = """
[tune.cases]
train = 4
ranking = 3
held_out = 6

[tune.parameters]
"mission.lookahead_m" = { low = 0.02, high = 1.0, scale = "log", unit = "m" }
"mission.heading_gain_per_s" = { low = 0.5, high = 9.0, unit = "1/s" }

[tune.objective]
path_rms_m = 0.05
closure_m = 0.1
"""


def config_text(tune: str = TUNE, mission: str = MISSION) -> str:
    """Return the shipped Robotino with a small mission and a [tune]."""
    shipped = (SHIPPED / "robotino.toml").read_text("utf-8")
    start, end = shipped.index("[mission]"), shipped.index("[limits]")
    rest = shipped[end:].partition(SHIPPED_TUNE)[0]
    return f"{shipped[:start]}{mission.lstrip()}\n{rest}\n{tune.lstrip()}"


def write_config(folder: Path, tune: str = TUNE, mission: str = MISSION) -> Path:
    """Write that configuration; return its path."""
    path = folder / "rover.toml"
    path.write_text(config_text(tune, mission), "utf-8")
    return path


def make_config(folder: Path, tune: str = TUNE, mission: str = MISSION) -> Config:
    """Return that configuration."""
    return load_config(str(write_config(folder, tune, mission)))


def lookahead_m(config: Config) -> float:
    """Return the value that the missions below depend on."""
    assert config.mission is not None
    return config.mission.lookahead_m


def answer(config: Config, seed: int) -> SimulatedMission:
    """Return a mission that is best at one look-ahead, dearer at higher seeds, unstable when too short."""
    value_m = lookahead_m(config)
    off = abs(math.log(value_m / BEST_LOOKAHEAD_M))
    refused = "oscillates" if value_m < UNSTABLE_BELOW_M else ""
    names = ("path_rms_m", "closure_m", "heading_deg", "effort_rad_s2", "duration_s")
    terms = dict.fromkeys(names, 0.01 * (1.0 + off) * (1.0 + 1e-4 * seed))
    x_m = np.linspace(0.0, 0.2, 5)
    return SimulatedMission(
        seed=seed,
        refused=refused,
        terms=terms,
        reversals_per_s=0.5,
        true_path=TruePath(x_m, 0.1 * x_m, 0.0 * x_m),
    )


class FakeRuns:
    """Answers at once, and remembers what it was asked.

    Attributes:
        driven: Look-ahead and seed of every case.
        before_case: Called before each case; may raise.
    """

    def __init__(self, before_case: Callable[[], None] = lambda: None) -> None:
        self.driven: list[tuple[float, int]] = []
        self.before_case = before_case

    def drive(self, config: Config, seeds: Sequence[int]) -> Generator[SimulatedMission, None, None]:
        """Answer for each seed when asked for it."""
        for seed in seeds:
            self.before_case()
            self.driven.append((lookahead_m(config), seed))
            yield answer(config, seed)
