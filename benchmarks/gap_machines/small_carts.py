"""Small carts with a hidden resistance, in runs that are much alike: several effects explain them.

The truth is integrated in small steps of its own, with a friction that sticks.
"""

import math
from dataclasses import dataclass

import numpy as np

from rover_hil.gap import Array, Channel, Parameter, Port, Run, RunParameter, StateModel, effects
from rover_hil.gap.next_run.allowed import Allowed
from rover_hil.gap.next_run.planned import PlannedRun

STEP_S, PARTS = 0.05, 20
SENSOR_M_S = 0.02
MASS_KG, MASS_SPREAD = 2.0, 0.02
SPEED_M_S = 2.0
RUNS, SAMPLES = 6, 80
LAWS = {
    "viscous_friction": 1.0,
    "quadratic_drag": 2.0,
    "coulomb_friction": 0.0,
    "cubic_resistance": 3.0,
    "root_resistance": 0.5,
}
"""Power of the speed in each law; the model has no effect for the last two."""
OUTSIDE = ("cubic_resistance", "root_resistance")


@dataclass(frozen=True, kw_only=True)
class SmallCart:
    """A cart, and the runs that were made with it.

    Attributes:
        law: The hidden resistance.
        resistance_n: Its force at the usual speed.
        mass_kg: True mass.
        runs: Measured.
        allowed: What may be done next.
    """

    law: str
    resistance_n: float
    mass_kg: float
    runs: tuple[Run, ...]
    allowed: Allowed

    @property
    def is_outside(self) -> bool:
        """True where no effect of the model is the law."""
        return self.law in OUTSIDE

    def made(self, planned: PlannedRun, rng: np.random.Generator) -> Run:
        """Return a planned run, measured."""
        begin = planned.starts["first"]
        return self.measured("next", planned.run.inputs["force"], begin, rng)

    def measured(self, name: str, force: Array, begin: float, rng: np.random.Generator) -> Run:
        """Return a run, measured."""
        speeds = np.empty(force.size)
        speed = begin
        for sample, push in enumerate(force):
            speeds[sample] = speed
            for _ in range(PARTS):
                speed = self._step(speed, float(push))
        noisy = speeds + SENSOR_M_S * rng.standard_normal(force.size)
        return Run(name=name, conditions={}, inputs={"force": force}, measured={"speedometer": noisy})

    def _step(self, speed: float, push: float) -> float:
        level = self.resistance_n * (abs(speed) / SPEED_M_S) ** LAWS[self.law]
        if self.law == "coulomb_friction" and abs(speed) < 1e-9 and abs(push) <= level:
            return 0.0
        sense = math.copysign(1.0, speed if abs(speed) >= 1e-9 else push)
        after = speed + STEP_S / PARTS * (push - sense * level) / self.mass_kg
        return 0.0 if after * sense < 0.0 and self.law == "coulomb_friction" else after


def make_cart(number: int) -> SmallCart:
    """Return the cart of a number: law, size, how much its runs differ, and how much is allowed next."""
    rng = np.random.default_rng([number, 13])
    law = list(LAWS)[number % len(LAWS)]
    resistance_n = float(rng.uniform(0.2, 1.5))
    variety = float(rng.uniform(0.02, 0.3))
    width = float(rng.choice((0.2, 0.5, 2.0)))
    limits = {"low": resistance_n - width, "high": resistance_n + width}
    cart = SmallCart(
        law=law,
        resistance_n=resistance_n,
        mass_kg=MASS_KG * (1.0 + MASS_SPREAD * float(np.clip(rng.standard_normal(), -2.0, 2.0))),
        runs=(),
        allowed=Allowed.model_validate({"inputs": {"force": limits}}),
    )
    runs = []
    for index in range(RUNS):
        force = resistance_n + variety * np.repeat(rng.uniform(-1.0, 1.0, SAMPLES // 20), 20)
        begin = SPEED_M_S + float(rng.normal(0.0, 0.05))
        runs.append(cart.measured(f"run{index}", force, begin, rng))
    return SmallCart(
        law=law,
        resistance_n=resistance_n,
        mass_kg=cart.mass_kg,
        runs=tuple(runs),
        allowed=cart.allowed,
    )


def make_model() -> StateModel:
    """Return the model: a mass without resistance, and the effects that may be missing."""
    return StateModel(
        name="cart",
        states={"speed": "m/s"},
        inputs={"force": "N"},
        channels=(Channel(name="speedometer", unit="m/s", sigma=SENSOR_M_S),),
        parameters=(
            Parameter(
                name="mass", unit="kg", nominal=MASS_KG, prior_sd=MASS_SPREAD * MASS_KG, lower=0.2, upper=20.0
            ),
        ),
        derivative=lambda x, u, p, port: {"speed": port("push", u.force) / p.mass},
        start=lambda p, _: {"speed": p.first},
        output=lambda x, *_: {"speedometer": x.speed},
        step_s=STEP_S,
        run_parameters=(RunParameter(name="first", unit="m/s", prior_sd=SENSOR_M_S, channel="speedometer"),),
        ports=(Port(name="push", unit="N", force_sd=0.3),),
        port_effects=(
            effects.viscous_friction("push", velocity="speed", size=0.3),
            effects.quadratic_drag("push", velocity="speed", size=0.15),
            effects.coulomb_friction("push", velocity="speed", size=0.5, slow=0.05),
        ),
    )
