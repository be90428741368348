"""Samples that are logs of simulated drives, and configurations."""

from importlib import resources
from pathlib import Path

import numpy as np

from controllers.motion.settings import WaypointsMission
from rover_hil.config import Config, load_config, read_config_text
from rover_hil.config.entry import with_entry
from rover_hil.console.options import LOG_NAME
from rover_hil.run.driving import run_virtual
from sim_backends.plants.robotino.site import load_site
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.settings import PlantSettings

RUN_S = 15.0
SAND_S = 10.0
FLOOR_S = 12.0
WHEELS_S = 20.0
NOISE_S = 45.0
NOISE_LOGS = 6
FIRST_NOISE_SEED = 100
SCHEMA_LINE = "#:schema"
FLOORS = ("brown", "gray")
WHEELS_SPEEDS_M_S = (0.12, 0.16, 0.2, 0.24)
WHEELS_CORNERS_M = ((0.8, 0.0), (0.8, 0.6), (-0.2, 0.6), (0.3, -0.4))
LARGER = 1.03
"""The left wheel of the sample `wheels` is larger than its configuration states by this factor."""


def write_rover(folder: Path) -> None:
    """Write a copy of the shipped configuration of the Robotino."""
    lines = read_config_text("robotino").splitlines(keepends=True)
    text = "".join(line for line in lines if not line.startswith(SCHEMA_LINE))
    (folder / "my_rover.toml").write_text(text, "utf-8")


def write_runs(folder: Path) -> None:
    """Write the folders of two runs of the Robotino."""
    config = load_config("robotino")
    _drive(config, folder / "runs" / "first", RUN_S)
    slower = with_entry(read_config_text("robotino"), "mission", "heading_gain_per_s", 2.0)
    changed = folder / "second.toml"
    changed.write_text(slower, "utf-8")
    _drive(load_config(str(changed)), folder / "runs" / "second", RUN_S)
    changed.unlink()


def write_sand(folder: Path) -> None:
    """Write the folder of a run on sand."""
    _drive(load_config("el-dorado"), folder / "runs" / "sand", SAND_S)


def write_floors(folder: Path) -> None:
    """Write logs of straight drives in different directions, in a folder per floor."""
    config = load_config("robotino").model_copy(update={"slip": None})
    for floor in FLOORS:
        for number in range(4):
            angle_rad = np.radians(25.0 + 30.0 * number)
            end = (2.0 * float(np.cos(angle_rad)), 2.0 * float(np.sin(angle_rad)))
            mission = WaypointsMission(type="waypoints", points=(end,), speed_m_s=0.15)
            place = "floors_test" if number == 3 else "floors"
            path = folder / place / floor / f"{number}.mcap"
            path.parent.mkdir(parents=True, exist_ok=True)
            here = _on_floor(config, floor, seed=number).model_copy(update={"mission": mission})
            run_virtual(here, path, FLOOR_S, None)


def write_wheels(folder: Path) -> None:
    """Write a configuration of two driven wheels, and logs of a rover that differs from it."""
    path = folder / "my_wheels.toml"
    path.write_text(resources.files(__package__).joinpath(path.name).read_text("utf-8"), "utf-8")
    config = load_config(str(path))
    simulation = config.require_simulation()
    plant = _with_larger_wheel(simulation.plant)
    (folder / "drives").mkdir()
    for number, speed_m_s in enumerate(WHEELS_SPEEDS_M_S):
        side = 1.0 if number % 2 else -1.0
        mission = WaypointsMission(
            type="waypoints",
            points=tuple((x_m, side * y_m) for x_m, y_m in WHEELS_CORNERS_M),
            speed_m_s=speed_m_s,
            heading="along_path",
        )
        true = simulation.model_copy(update={"seed": number, "plant": plant})
        driven = config.model_copy(update={"mission": mission, "simulation": true})
        run_virtual(driven, folder / "drives" / f"{number}.mcap", WHEELS_S, None)


def write_noise(folder: Path) -> None:
    """Write a configuration whose filter noise was guessed, and logs of this rover."""
    path = folder / "noisy.toml"
    path.write_text(resources.files(__package__).joinpath(path.name).read_text("utf-8"), "utf-8")
    config = load_config(str(path))
    simulation = config.require_simulation()
    (folder / "noise").mkdir()
    for number in range(NOISE_LOGS):
        here = simulation.model_copy(update={"seed": FIRST_NOISE_SEED + number})
        run_virtual(
            config.model_copy(update={"simulation": here}), folder / "noise" / f"{number}.mcap", NOISE_S, None
        )


def _with_larger_wheel(plant: PlantSettings) -> PlantSettings:
    if not isinstance(plant, WheelsPlantSettings):
        raise TypeError(plant)
    left, *others = plant.wheels
    larger = left.model_copy(update={"radius_m": LARGER * left.radius_m})
    return plant.model_copy(update={"wheels": (larger, *others)})


def _on_floor(config: Config, floor: str, *, seed: int) -> Config:
    simulation = config.require_simulation()
    plant = simulation.plant.model_copy(update={"site": load_site(f"floor_{floor}")})
    return config.model_copy(
        update={"simulation": simulation.model_copy(update={"plant": plant, "seed": seed})}
    )


def _drive(config: Config, folder: Path, duration_s: float) -> None:
    folder.mkdir(parents=True)
    run_virtual(config, folder / LOG_NAME, duration_s, None)
