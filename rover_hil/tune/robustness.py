"""How the cost changes on a rover that is not quite the simulated one."""

from dataclasses import dataclass

from rover_hil.config import Config
from rover_hil.config.tune_settings import TuneSettings
from rover_hil.tune.objective import MissionRunner, evaluate
from rover_hil.tune.scenarios import held_out_seeds
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.settings import PlantSettings

MOST_SCENARIOS = 6
RESISTANCE_SHARE = 0.15
PAYLOAD_SHARE = 0.2
LATENCY_S = 0.02
LATENCY = f"latency {1000 * LATENCY_S:+.0f} ms"


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedRover:
    """Costs on the same held-out scenarios with one property of the rover changed.

    Attributes:
        change: What was changed; empty for the rover as configured.
        before: Cost of the old values; None where they are rejected.
        after: Cost of the new values, likewise.
    """

    change: str
    before: float | None
    after: float | None


def try_changed_rovers(
    before: Config, after: Config, tune: TuneSettings, drive: MissionRunner
) -> tuple[ChangedRover, ...]:
    """Drive old and new values on changed rovers, on at most six of the held-out scenarios.

    The ground needs no change of its own: each scenario has another one.
    """
    seeds = held_out_seeds(tune.cases)[:MOST_SCENARIOS]
    return tuple(
        ChangedRover(
            change=change,
            before=evaluate(drive, _with_plant(before, plant), seeds, tune.objective).cost,
            after=evaluate(drive, _with_plant(after, plant), seeds, tune.objective).cost,
        )
        for change, plant in changed_plants(before.require_simulation().plant).items()
    )


def changed_plants(plant: PlantSettings) -> dict[str, PlantSettings]:
    """Return the plant itself, and with other motors, latency and payload, by the name of the change."""
    plants: dict[str, PlantSettings] = {"": plant}
    heavier = {"mass_kg": plant.mass_kg * (1.0 + PAYLOAD_SHARE)}
    match plant:
        case RobotinoPlantSettings(motor=motor, speed_loop=loop):
            for sign in (-1.0, 1.0):
                resistance_ohm = motor.resistance_ohm * (1.0 + sign * RESISTANCE_SHARE)
                changed = motor.model_copy(update={"resistance_ohm": resistance_ohm})
                name = f"motor resistance {100 * sign * RESISTANCE_SHARE:+.0f} %"
                plants[name] = plant.model_copy(update={"motor": changed})
            late = {"set_point_delay_s": loop.set_point_delay_s + LATENCY_S}
            plants[LATENCY] = plant.model_copy(update={"speed_loop": loop.model_copy(update=late)})
        case WheelsPlantSettings(set_point_delay_s=delay_s):
            plants[LATENCY] = plant.model_copy(update={"set_point_delay_s": delay_s + LATENCY_S})
        case ElDoradoPlantSettings(speed_lag_s=lag_s):
            plants[LATENCY] = plant.model_copy(update={"speed_lag_s": lag_s + LATENCY_S})
    plants[f"payload {100 * PAYLOAD_SHARE:+.0f} %"] = plant.model_copy(update=heavier)
    return plants


def _with_plant(config: Config, plant: PlantSettings) -> Config:
    simulation = config.require_simulation().model_copy(update={"plant": plant})
    return config.model_copy(update={"simulation": simulation})
