"""A cart on a slope as nature makes it: forces balanced by bisection, apart from every model of it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

SLOPES_AND_MASSES = ((10.0, 23.8), (15.0, 23.8), (20.0, 23.8), (20.0, 33.8))
ROLLS = (0.0, 5.0, 10.0, 15.0, 20.0)
COLUMNS = ("slip", "slip_angle_deg", "sinkage_up_mm", "sinkage_down_mm", "torque_up_nm", "torque_down_nm")
NOISE = {
    "slip": 0.004,
    "slip_angle_deg": 0.25,
    "sinkage_up_mm": 1.0,
    "sinkage_down_mm": 1.0,
    "torque_up_nm": 0.04,
    "torque_down_nm": 0.06,
}
PRIOR_SD = {"friction": 1.0, "shear": 2.0, "softness": 0.02, "height": 5.0, "rolling": 0.01}


@dataclass(frozen=True, kw_only=True)
class Nature:
    """What is true. Degrees, millimetres, newtons; the last group is what a model may not know."""

    friction: float = 38.0
    shear: float = 36.0
    softness: float = 0.35
    height: float = 280.0
    rolling: float = 0.12
    creep: float = 0.0
    creep_onset: float = 13.0
    offset: float = 0.0
    heading: float = 0.0
    yaw: float = 0.0
    digging: float = 0.0
    radius: float = 0.0
    stick: float = 0.0
    """Out of every catalogue: sinkage that grows with roll, mm per deg."""
    swing: float = 0.0
    """Out of every catalogue: slip that follows the sine of the roll."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """How it is measured."""

    replicates: int = 3
    noise: float = 1.0
    kind: str = "white"
    setting_deg: float = 0.15
    conditions: Sequence[tuple[float, float]] = SLOPES_AND_MASSES
    rolls: Sequence[float] = ROLLS
    quantum: Mapping[str, float] = field(default_factory=dict)


def some_nature(rng: np.random.Generator, **hidden: float) -> Nature:
    """Draw base parameters as well as they are known, and add what is hidden."""
    nominal = Nature()
    drawn = {
        name: getattr(nominal, name) + spread * float(np.clip(rng.standard_normal(), -2.0, 2.0))
        for name, spread in PRIOR_SD.items()
    }
    for name, change in hidden.items():
        drawn[name] = drawn.get(name, getattr(nominal, name)) + change
    return Nature(**drawn)


def steady_state(nature: Nature, slope_deg: float, roll_deg: float, mass_kg: float) -> dict[str, float]:
    """Return what a perfect instrument would show."""
    tilt, lean, turn = (math.radians(one) for one in (slope_deg, roll_deg, nature.heading))
    weight = mass_kg * 9.81
    normal = weight * math.cos(tilt)
    moment = nature.height * math.tan(tilt - lean) - nature.offset
    loads = [0.25 * normal * (1.0 - side * 2.0 * moment / 550.0) for side in (1.0, -1.0)]
    pull_side = weight * math.sin(tilt) * math.cos(turn) / normal
    pull_side -= math.tan(lean) * (1.0 + nature.offset / 550.0)
    pull_ahead = nature.rolling + math.tan(tilt) * math.sin(turn)
    pull = math.sqrt(pull_side**2 + pull_ahead**2)
    slide = _slide(pull, math.tan(math.radians(nature.friction)), nature.shear)
    slip = 0.4 * slide * pull_ahead / pull
    drift = math.degrees(-math.atan2(1.2 * slide * pull_side, pull))
    # Loose soil creeps as soon as the slope passes its onset, smoothly.
    drift -= nature.creep * math.log1p(math.exp((slope_deg - nature.creep_onset) * 2.0)) / 2.0
    slip = 1.0 - (1.0 - slip) * (1.0 + nature.radius / 100.0)
    slip += nature.swing * math.sin(6.0 * lean)
    dug = nature.digging * max(slip, 0.0) + nature.stick * roll_deg
    torque = [0.097 * load * (pull_ahead + 0.2 * slide) for load in loads]
    sinkage = [nature.softness * load + dug for load in loads]
    return dict(zip(COLUMNS, (slip, drift + nature.yaw, *sinkage, *torque), strict=True))


def _slide(pull: float, friction: float, shear: float) -> float:
    """Return where the soil's shear stress carries the pull, by bisection."""
    share = min(pull, 0.97 * friction)
    low, high = 0.0, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        carried = friction * (1.0 - math.exp(-60.0 * middle / shear))
        low, high = (middle, high) if carried < share else (low, middle)
    return 0.5 * (low + high)


def measure(nature: Nature, experiment: Experiment, rng: np.random.Generator) -> list[dict[str, float | str]]:
    """Return a table of runs: conditions as they were meant, values as they were measured."""
    rows: list[dict[str, float | str]] = []
    errors = _errors(
        len(experiment.conditions) * len(experiment.rolls) * experiment.replicates, experiment, rng
    )
    for number, (slope, mass) in enumerate(experiment.conditions, start=1):
        for roll in experiment.rolls:
            for replicate in range(1, experiment.replicates + 1):
                error = errors[len(rows)]
                wobble = experiment.setting_deg * rng.standard_normal(2)
                true = steady_state(nature, slope + wobble[0], roll + wobble[1], mass)
                row: dict[str, float | str] = {"run": f"c{number}_p{roll:g}_r{replicate}"}
                row |= {"slope_deg": slope, "roll_deg": roll, "mass_kg": mass}
                for place, name in enumerate(COLUMNS):
                    value = true[name] + NOISE[name] * experiment.noise * float(error[place])
                    step = experiment.quantum.get(name, 0.0)
                    row[name] = round(value / step) * step if step else value
                rows.append(row)
    return rows


def _errors(count: int, experiment: Experiment, rng: np.random.Generator) -> NDArray[np.float64]:
    if experiment.kind == "heavy":
        return rng.standard_t(3, (count, len(COLUMNS))) / math.sqrt(3.0)
    return rng.standard_normal((count, len(COLUMNS)))
