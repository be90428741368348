"""Effects that have one sign only are found far from where base parameters imitate them."""

from dataclasses import replace

import numpy as np

from rover_hil.config import load_config
from rover_hil.gap.data.problem import Point, Problem, observe
from rover_hil.gap.fit.called_machine import CalledMachine
from rover_hil.gap.fit.machine_fit import MachineFits
from sim_backends.models.interface import Array, Run
from sim_backends.models.parameter_key import ParameterKey
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.wheels_model.model import WheelsModel

DRIVES, WINDOWS, WINDOW_S, SEED = 4, 40, 0.2, 5
RESISTANCE = "rolling_resistance"


def drives(model: WheelsModel, rng: np.random.Generator) -> list[Run]:
    """Return arcs forwards and backwards, as wheel speeds only."""
    found = []
    for number in range(DRIVES):
        ahead = np.repeat(rng.uniform(0.8, 2.0, 4) * rng.choice((-1.0, 1.0), 4), WINDOWS // 4)
        turning = np.repeat(rng.uniform(-0.3, 0.3, 4), WINDOWS // 4)
        sides = [
            np.convolve(ahead * (1.0 + sign * turning), np.ones(5) / 5.0, "same") for sign in (-1.0, 1.0)
        ]
        wheels = {
            f"wheel_{one}_rad_s": sides[one % 2].astype(np.float64) for one in range(1, model.wheel_count + 1)
        }
        t_s = (WINDOW_S * np.arange(WINDOWS)).astype(np.float64)
        inputs: dict[str, Array] = {"t_s": t_s, "heading_rad": np.zeros(WINDOWS), **wheels}
        found.append(
            Run(name=f"drive {number}", conditions={"speed_m_s": float(np.mean(ahead))}, inputs=inputs)
        )
    return found


def test_a_resistance_of_the_ground_is_not_left_to_softer_ground() -> None:
    """Softer ground, a base parameter, imitates it near the start: one fit must begin at a great one."""
    settings = load_config("docs/examples/differential.toml").require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    site = settings.site.model_copy(update={"floor": "gray", "roughness": 0.0, "patches": ()})
    model, rng = WheelsModel(settings.model_copy(update={"site": site})), np.random.default_rng(SEED)
    runs = drives(model, rng)
    tables = model.predict(runs, {}, {RESISTANCE: {"share": 0.15}})
    measured = [
        replace(
            run, measured={name: values + rng.normal(0.0, 0.002, values.size) for name, values in one.items()}
        )
        for run, one in zip(runs, tables, strict=True)
    ]
    channels = tuple(replace(one, sigma=0.002) for one in model.channels)
    machine = CalledMachine(model, measured, channels)
    problem, key = Problem(machine, observe(machine, measured)), ParameterKey(effect=RESISTANCE, name="share")
    fits = MachineFits(problem, machine.effects)
    found = fits.best((RESISTANCE,), {}, fits.base().fit.point)
    at_truth: Point = {key: 0.15}
    (reference,) = MachineFits(problem, machine.effects).fit_all(
        [((RESISTANCE,), {}, at_truth)], is_near=True
    )
    assert found.cost < reference.cost + 1.0, (found.fit.point[key], reference.fit.point[key])
