"""A single wheel in a test bed, steady, at any slip and slip angle, with the effects that may be missing.

Base: `sim_backends.terramechanics.soil.any_angle_wheel` with the numbers from plate tests and books
(`cmu_sand_blind`); they were not fitted to wheel tests, and their priors are wide. Another wheel or soil:
`SingleWheel(wheel, soil)`.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from drivers.errors import ModelError
from sim_backends.models.interface import Array, Channel, EffectCard, Parameter, Run, Values
from sim_backends.models.nominal_values import NominalValues
from sim_backends.models.single_wheel.effects import EFFECTS, rim_friction_deg
from sim_backends.terramechanics.soil.any_angle_wheel import (
    AnyAngleForces,
    AnyAngleSoil,
    Motion,
    any_angle_at_load,
    load_any_angle_soil,
)
from sim_backends.terramechanics.soil.library import WheelSettings, load_wheel

CHANNELS = (
    Channel(name="drawbar_N", unit="N", tolerance=0.1),
    Channel(name="side_N", unit="N", tolerance=0.1),
    Channel(name="sinkage_mm", unit="mm", tolerance=0.2),
)
PRIORS: Mapping[str, tuple[str, float, float, float]] = {
    "plate_modulus_pa": ("Pa/m^n", 0.8e6, 1e6, 5e7),
    "plate_exponent": ("1", 0.03, 0.8, 2.2),
    "rim_friction_deg": ("deg", 3.0, 5.0, 45.0),
    "shear_modulus_m": ("m", 0.008, 0.001, 0.1),
    "greatest_stress": ("1", 0.05, 0.1, 0.8),
    "exit_share": ("1", 0.04, 0.0, 0.6),
    "slide_number": ("1", 0.8, 0.2, 20.0),
    "push_number": ("1", 3.0, 0.0, 120.0),
    "wake_rate": ("1", 4.0, 0.0, 60.0),
    "sideways_exponent": ("1", 0.25, 0.0, 4.0),
    "wall_number": ("1", 3.0, 0.0, 60.0),
    "wall_friction": ("1", 0.08, 0.0, 1.0),
}
"""Unit, prior standard deviation, least and greatest value of the soil's numbers that are uncertain."""
MEANINGS = {
    "plate_modulus_pa": "pressure of a plate, k of k z^n",
    "plate_exponent": "n of k z^n",
    "rim_friction_deg": "friction between soil and rim",
    "shear_modulus_m": "displacement over which shear stress builds up",
    "greatest_stress": "angle of greatest stress over entry angle",
    "exit_share": "rise of the wheel behind, over the sinkage",
    "slide_number": "pressure over rho g z where soil slides past the rim",
    "push_number": "more of it where the rim pushes straight ahead",
    "wake_rate": "how fast pressure falls where the rim moves away from the soil",
    "sideways_exponent": "how soil that is sheared sideways loses bearing",
    "wall_number": "pressure over rho g z on the leading side wall",
    "wall_friction": "friction over pressure on the side wall",
}


class SingleWheel:
    """A `Model` of a wheel that is driven at a given slip, slip angle and load.

    Forces are those on the wheel: drawbar pull forward, side force against the sideways motion.

    Args:
        wheel: Wheel.
        soil: Base numbers of the soil.
    """

    name = "single-wheel"
    channels: tuple[Channel, ...] = CHANNELS
    condition_units: Mapping[str, str] = {
        "rim_speed_mm_s": "mm/s",
        "travel_speed_mm_s": "mm/s",
        "slip_angle_deg": "deg",
        "load_N": "N",
    }
    effects: tuple[EffectCard, ...] = EFFECTS

    def __init__(self, wheel: WheelSettings | None = None, soil: AnyAngleSoil | None = None) -> None:
        self._wheel = wheel or load_wheel("cmu_smooth")
        self._soil = soil or load_any_angle_soil("cmu_sand_blind")
        self.parameters: tuple[Parameter, ...] = tuple(_parameter(name, self._soil) for name in PRIORS)
        self._nominal = NominalValues(self.parameters, EFFECTS)

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict every channel of every run; NaN where the soil cannot carry the load; see `Model`."""
        base, active = self._nominal.fill(parameters, effects)
        rim, travel, angle, load = (
            np.array([run.conditions[name] for run in runs], dtype=np.float64)
            for name in self.condition_units
        )
        angle = np.radians(angle + active["rig_yaw"]["offset"])
        lugs = active["lugs"]["height"]
        scale = (self._wheel.radius_m + lugs) / self._wheel.radius_m
        carried = active["trench_flow"]["share"]
        motion = Motion(
            rim * scale / 1000.0,
            np.maximum(travel * np.cos(angle), 0.0) / 1000.0,
            (1.0 - carried) * travel * np.sin(angle) / 1000.0,
        )
        soil = self._changed(base, active)
        wheel = self._wheel.model_copy(update={"radius_m": self._wheel.radius_m + lugs})
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

    def _changed(self, base: Values, active: Mapping[str, Values]) -> AnyAngleSoil:
        update = {name: float(base[name]) for name in PRIORS}
        for card in EFFECTS:
            if card.releases is not None:
                update[card.releases] += active[card.name]["change"]
        update["rim_friction_deg"] = rim_friction_deg(
            active["lugs"], update["rim_friction_deg"], self._soil.friction_angle_deg
        )
        return self._soil.model_copy(update=update)


def _parameter(name: str, soil: AnyAngleSoil) -> Parameter:
    unit, prior_sd, lower, upper = PRIORS[name]
    return Parameter(
        name=name,
        unit=unit,
        nominal=float(getattr(soil, name)),
        prior_sd=prior_sd,
        lower=lower,
        upper=upper,
        meaning=MEANINGS[name],
    )


def _nothing(count: int) -> tuple[Array, AnyAngleForces]:
    unknown = np.full(count, np.nan)
    return unknown, AnyAngleForces(unknown, unknown, unknown, unknown)


def make_model() -> SingleWheel:
    """Return the smooth wheel of the CMU test bed, blind."""
    return SingleWheel()
