"""A single wheel in a test bed, steady, at any slip and slip angle, with the effects that may be missing.

Base: `sim_backends.terramechanics.soil.any_angle_wheel` with the numbers from plate tests and books
(`cmu_sand_blind`); they were not fitted to wheel tests, and their priors are wide.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from drivers.errors import ModelError
from sim_backends.models.interface import Array, Channel, EffectCard, Run, Values
from sim_backends.models.nominal_values import NominalValues
from sim_backends.models.tables import read_tables
from sim_backends.terramechanics.soil.any_angle_wheel import (
    AnyAngleForces,
    AnyAngleSoil,
    Motion,
    any_angle_at_load,
    load_any_angle_soil,
)
from sim_backends.terramechanics.soil.library import load_wheel

CHANNELS = (
    Channel(name="drawbar_N", unit="N", tolerance=0.1),
    Channel(name="side_N", unit="N", tolerance=0.1),
    Channel(name="sinkage_mm", unit="mm", tolerance=0.2),
)
PARAMETERS, EFFECTS = read_tables(__file__)
NOMINAL = NominalValues(PARAMETERS, EFFECTS)
WHEEL, SOIL = load_wheel("cmu_smooth"), load_any_angle_soil("cmu_sand_blind")
GRIP_M = 0.002
"""Height of lugs that hold most of the soil between them."""


class SingleWheel:
    """A `Model` of a wheel that is driven at a given slip, slip angle and load.

    Forces are those on the wheel: drawbar pull forward, side force against the sideways motion.
    """

    name = "single-wheel"
    channels: tuple[Channel, ...] = CHANNELS
    condition_units: Mapping[str, str] = {
        "rim_speed_mm_s": "mm/s",
        "travel_speed_mm_s": "mm/s",
        "slip_angle_deg": "deg",
        "load_N": "N",
    }
    parameters = PARAMETERS
    effects: tuple[EffectCard, ...] = EFFECTS

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict every channel of every run; NaN where the soil cannot carry the load; see `Model`."""
        base, active = NOMINAL.fill(parameters, effects)
        rim, travel, angle, load = (
            np.array([run.conditions[name] for run in runs], dtype=np.float64)
            for name in self.condition_units
        )
        angle = np.radians(angle + active["rig_yaw"]["offset"])
        lugs = active["lugs"]["height"]
        scale = (WHEEL.radius_m + lugs) / WHEEL.radius_m
        carried = active["trench_flow"]["share"]
        motion = Motion(
            rim * scale / 1000.0,
            np.maximum(travel * np.cos(angle), 0.0) / 1000.0,
            (1.0 - carried) * travel * np.sin(angle) / 1000.0,
        )
        soil = _changed(base, active)
        wheel = WHEEL.model_copy(update={"radius_m": WHEEL.radius_m + lugs})
        try:
            sinkage, forces = any_angle_at_load(wheel, soil, motion, load)
        except ModelError:
            sinkage, forces = _nothing(len(runs))
        slip = 1.0 - travel * np.cos(angle) / np.maximum(rim, 1e-9)
        dug = active["slip_sinkage"]["depth_per_slip"] * np.clip(slip, 0.0, 1.0)
        values = {
            "drawbar_N": forces.drawbar_n,
            "side_N": -forces.side_n,
            "sinkage_mm": 1000.0 * (sinkage + dug),
        }
        return [{name: row[index : index + 1] for name, row in values.items()} for index in range(len(runs))]


def _changed(base: Values, active: Mapping[str, Values]) -> AnyAngleSoil:
    """Return the soil with the base parameters, and the effects that release one."""
    update = {item.name: float(base[item.name]) for item in PARAMETERS}
    for card in EFFECTS:
        if card.releases is not None:
            update[card.releases] += active[card.name]["change"]
    # Lugs hold soil between them: soil shears on soil.
    grip = 1.0 - math.exp(-active["lugs"]["height"] / GRIP_M)
    rim_deg = update["rim_friction_deg"]
    update["rim_friction_deg"] = rim_deg + grip * max(SOIL.friction_angle_deg - rim_deg, 0.0)
    return SOIL.model_copy(update=update)


def _nothing(count: int) -> tuple[Array, AnyAngleForces]:
    unknown = np.full(count, np.nan)
    return unknown, AnyAngleForces(unknown, unknown, unknown, unknown)


def make_model() -> SingleWheel:
    """Return the smooth wheel of the CMU test bed, blind."""
    return SingleWheel()
