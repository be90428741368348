"""Cases drawn from the families: the same family and number always give the same case."""

import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from tests.nature.machines import circuit, geared_axis, pendulum, tanks, thermal, vehicle
from tests.nature.machines.case import Array, Case, Effect, Run, Term
from tests.nature.machines.family import Family
from tests.nature.machines.machine import Machine, Records
from tests.nature.machines.signals import random_walk_force

FAMILIES: Mapping[str, Family] = {
    module.FAMILY.name: module.FAMILY for module in (geared_axis, pendulum, tanks, thermal, circuit, vehicle)
}
SHARES = {"none": 0.35, "single": 0.30, "pair": 0.08, "outside": 0.17, "broad": 0.10}
LEVELS = (1.0, 3.0, 10.0, 30.0)
BROAD_LEVELS = (5.0, 30.0)
EXTRA_SCATTER_SHARE = 0.2
EXTRA_SCATTER = 5.0
"""Factor on the documented scatter in a case of kind `none` with extra scatter."""
SMALLEST_SIZE = 1e-4
"""Smallest share of an effect's largest size that the search tries."""
BISECTIONS = 20
SNR_PRECISION = 0.01
SEARCH_TOLERANCE = 1e-6
"""Tolerance of the integrator while a size is searched."""


@dataclass(frozen=True)
class Hidden:
    """An effect or term with its drawn parameters and the sign of its size."""

    effect: Effect | Term
    drawn: Mapping[str, float]
    sign: float

    def constants(self, share: float) -> dict[str, float]:
        """Return the constants of the truth at a share of the largest size."""
        if isinstance(self.effect, Term):
            return {self.effect.coefficient: share * self.effect.largest, **self.drawn}
        sizes = {
            name: without + self.sign * share * (largest - without)
            for name, (without, largest) in self.effect.size.items()
        }
        return sizes | dict(self.drawn)


@dataclass(frozen=True)
class Found:
    """All that is hidden: constants of each effect, and the rms of the disturbance."""

    effects: Mapping[str, Mapping[str, float]]
    force: float

    @property
    def constants(self) -> dict[str, float]:
        """Constants of all effects together."""
        return {name: value for values in self.effects.values() for name, value in values.items()}


def kind_of(family: str, number: int) -> str:
    """Return the kind of a case without making it."""
    return _draw_kind(_generator(family, number))


def make_case(family: str, number: int) -> Case:
    """Return the case of a family and a number; cases from 1000 on are sealed.

    Raises:
        KeyError: The family is unknown.
    """
    chosen = FAMILIES[family]
    rng = _generator(family, number)
    kind = _draw_kind(rng)
    extra = kind == "none" and bool(rng.uniform() < EXTRA_SCATTER_SHARE)
    level = _draw_level(kind, rng)
    machine = draw_machine(chosen, EXTRA_SCATTER if extra else 1.0, rng)
    hidden = _draw_hidden(chosen, kind, rng)
    plain = machine.record({})
    found = _find_sizes(machine, plain, hidden, level, kind)
    full = machine.record(found.constants, found.force)
    alone = {name: machine.record(values) for name, values in found.effects.items()}
    slopes = machine.sensitivities(plain)
    return Case(
        family=family,
        number=number,
        kind=kind,
        effects=found.effects,
        terms=tuple(one.effect for one in hidden if isinstance(one.effect, Term)),
        snr_target=level,
        snr=machine.snr(plain, full),
        snr_each={name: machine.snr(plain, records) for name, records in alone.items()},
        snr_after_refit=machine.snr_after_refit(plain, full, slopes),
        snr_after_refit_each={
            name: machine.snr_after_refit(plain, records, slopes) for name, records in alone.items()
        },
        extra_scatter=extra,
        parameters=machine.parameters,
        disturbance_rms=found.force,
        dt_s=chosen.dt_s,
        runs=tuple(_measure(machine, full, found.force, rng)),
        sigma={channel.name: channel.sigma for channel in chosen.channels},
        quantum={channel.name: channel.quantum for channel in chosen.channels},
    )


def _generator(family: str, number: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(family.encode()), number])


def _draw_kind(rng: np.random.Generator) -> str:
    return str(rng.choice(list(SHARES), p=list(SHARES.values())))


def _draw_level(kind: str, rng: np.random.Generator) -> float:
    level = float(rng.choice(LEVELS))
    broad = float(np.exp(rng.uniform(*np.log(BROAD_LEVELS))))
    return {"none": 0.0, "broad": broad}.get(kind, level)


def draw_machine(family: Family, scatter: float, rng: np.random.Generator) -> Machine:
    """Return a machine with its experiment; its parameters scatter `scatter` times as documented."""
    count = int(rng.integers(4, 9)) if rng.uniform() < 0.75 else int(rng.integers(8, 13))
    samples = int(rng.integers(200, 401))
    parameters = {one.name: one.nominal * (1.0 + one.spread * _cut_normal(rng)) for one in family.parameters}
    first = int(rng.integers(0, 5))
    plans = tuple(family.plan(rng, samples, first + index) for index in range(count))
    run_parameters = tuple(
        {
            one.name: parameters[one.name] * (1.0 + scatter * one.scatter * _cut_normal(rng))
            for one in family.parameters
        }
        for _ in plans
    )
    starts = tuple(
        {
            state.name: plan.conditions[f"start_{state.name}"] + state.spread * _cut_normal(rng)
            for state in family.states
        }
        for plan in plans
    )
    correlation = family.disturbance.correlation_s / family.dt_s
    series = [random_walk_force(rng, samples, correlation) for _ in plans]
    size = float(np.sqrt(np.mean(np.square(series))))
    return Machine(family, parameters, plans, run_parameters, starts, tuple(one / size for one in series))


def _cut_normal(rng: np.random.Generator) -> float:
    return float(np.clip(rng.standard_normal(), -2.0, 2.0))


def _draw_hidden(family: Family, kind: str, rng: np.random.Generator) -> list[Hidden]:
    chosen: list[Effect | Term] = []
    if kind == "outside":
        chosen = [family.outside[int(rng.integers(len(family.outside)))]]
    if kind in ("single", "pair"):
        first = family.catalogue[int(rng.integers(len(family.catalogue)))]
        others = [effect for effect in family.catalogue if effect.group != first.group]
        second = others[int(rng.integers(len(others)))]
        chosen = [first, second] if kind == "pair" else [first]
    return [draw_effect(effect, rng) for effect in chosen]


def draw_effect(effect: Effect | Term, rng: np.random.Generator) -> Hidden:
    """Return an effect with its other parameters and its sign drawn."""
    drawn = {name: float(rng.uniform(low, high)) for name, (low, high) in effect.drawn.items()}
    signed = isinstance(effect, Effect) and effect.signed
    return Hidden(effect, drawn, float(rng.choice((-1.0, 1.0))) if signed else 1.0)


def _find_sizes(machine: Machine, plain: Records, hidden: list[Hidden], level: float, kind: str) -> Found:
    effects = {
        one.effect.name: one.constants(find_size(effect_ratio(machine, plain, one), level)) for one in hidden
    }
    if kind != "broad":
        return Found(effects, 0.0)
    largest = machine.family.disturbance.largest_rms

    def disturbed(share: float) -> float:
        return machine.snr(plain, machine.record({}, largest * share, SEARCH_TOLERANCE))

    return Found(effects, largest * find_size(disturbed, level))


def effect_ratio(machine: Machine, plain: Records, hidden: Hidden) -> Callable[[float], float]:
    """Return the function from a share of the largest size to the ratio `snr`; infinite if it runs away."""

    def ratio(share: float) -> float:
        snr = machine.snr(plain, machine.record(hidden.constants(share), tolerance=SEARCH_TOLERANCE))
        return snr if math.isfinite(snr) else math.inf

    return ratio


def find_size(ratio: Callable[[float], float], level: float) -> float:
    """Return the share of the largest size at which the ratio is `level`, or 1 if it is not reached."""
    high = low = 1.0
    above = below = ratio(high)
    if above <= level:
        return high
    while below > level and low > SMALLEST_SIZE:
        high, above = low, below
        low *= 0.25
        below = ratio(low)
    for _ in range(BISECTIONS):
        # Most effects grow with a power of their size; where that fails, the middle is tried.
        way = 0.5 if below <= 0.0 else math.log(level / below) / math.log(above / below)
        middle = low * math.exp(math.log(high / low) * min(max(way, 0.1), 0.9))
        reached = ratio(middle)
        if abs(reached - level) < SNR_PRECISION * level:
            return middle
        if reached < level:
            low, below = middle, reached
        else:
            high, above = middle, reached
    return middle


def _measure(
    machine: Machine, full: list[dict[str, Array]], force: float, rng: np.random.Generator
) -> list[Run]:
    runs = []
    for index, plan in enumerate(machine.plans):
        measured = {}
        for channel in machine.family.channels:
            exact = full[index][channel.name]
            noisy = exact + channel.sigma * rng.standard_normal(exact.size)
            measured[channel.name] = np.round(noisy / channel.quantum) * channel.quantum
        runs.append(
            Run(
                name=plan.name,
                conditions=plan.conditions,
                inputs=plan.inputs,
                measured=measured,
                truth=full[index] | {"disturbance": force * machine.disturbances[index]},
                initial_state=machine.starts[index],
                parameters=machine.run_parameters[index],
            )
        )
    return runs
