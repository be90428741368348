"""Cases drawn from the families: the same family and number always give the same case."""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from tests.nature.machines import geared_axis, pendulum
from tests.nature.machines.case import Array, Case, Effect, Run, Term
from tests.nature.machines.family import Family, Plan
from tests.nature.machines.signals import random_walk_force

FAMILIES: Mapping[str, Family] = {module.FAMILY.name: module.FAMILY for module in (geared_axis, pendulum)}
SHARES = {"none": 0.35, "single": 0.30, "pair": 0.08, "outside": 0.17, "broad": 0.10}
LEVELS = (1.0, 3.0, 10.0, 30.0)
BROAD_LEVELS = (5.0, 30.0)
EXTRA_SCATTER_SHARE = 0.2
EXTRA_SCATTER = 5.0
"""Factor on the documented scatter in a case of kind `none` with extra scatter."""
SMALLEST_SIZE = 1e-4
"""Smallest share of an effect's largest size that the search tries."""
BISECTIONS = 12
SNR_PRECISION = 0.01


@dataclass(frozen=True)
class Hidden:
    """An effect with its drawn parameters; `constants` gives all of them at a share of the largest size."""

    effect: Effect | Term
    drawn: Mapping[str, float]
    sign: float

    def constants(self, share: float) -> dict[str, float]:
        if isinstance(self.effect, Term):
            return {self.effect.coefficient: self.sign * share * self.effect.largest, **self.drawn}
        sizes = {
            name: without + self.sign * share * (largest - without)
            for name, (without, largest) in self.effect.size.items()
        }
        return sizes | dict(self.drawn)


@dataclass(frozen=True)
class Machine:
    """A machine and its experiment before anything is hidden in it."""

    family: Family
    parameters: Mapping[str, float]
    plans: tuple[Plan, ...]
    run_parameters: tuple[Mapping[str, float], ...]
    starts: tuple[Mapping[str, float], ...]
    disturbances: tuple[Array, ...] = field(default_factory=tuple)

    def record(self, hidden: Mapping[str, float], force: float = 0.0) -> list[dict[str, Array]]:
        """Return each run without noise, with constants of hidden effects and a size of the disturbance."""
        nothing = self.family.nothing_hidden()
        return [
            self.family.run(plan, nothing | dict(parameters) | dict(hidden), start, force * disturbance)
            for plan, parameters, start, disturbance in zip(
                self.plans, self.run_parameters, self.starts, self.disturbances, strict=True
            )
        ]


def make_case(family: str, number: int) -> Case:
    """Return the case of a family and a number; cases from 1000 on are sealed.

    Raises:
        KeyError: The family is unknown.
    """
    chosen = FAMILIES[family]
    rng = np.random.default_rng([zlib.crc32(family.encode()), number])
    kind = str(rng.choice(list(SHARES), p=list(SHARES.values())))
    extra = kind == "none" and bool(rng.uniform() < EXTRA_SCATTER_SHARE)
    level = _draw_level(kind, rng)
    machine = _draw_machine(chosen, EXTRA_SCATTER if extra else 1.0, rng)
    hidden = _draw_hidden(chosen, kind, rng)
    plain = machine.record({})
    constants: dict[str, float] = {}
    effects: dict[str, dict[str, float]] = {}
    each: dict[str, float] = {}
    for one in hidden:
        share = _find_size(
            lambda size, one=one: _snr(chosen, plain, machine.record(one.constants(size))), level
        )
        effects[one.effect.name] = one.constants(share)
        each[one.effect.name] = _snr(chosen, plain, machine.record(effects[one.effect.name]))
        constants |= effects[one.effect.name]
    force = 0.0
    if kind == "broad":
        largest = chosen.disturbance.largest_rms
        force = largest * _find_size(
            lambda size: _snr(chosen, plain, machine.record({}, largest * size)), level
        )
    full = machine.record(constants, force)
    snr = _snr(chosen, plain, full)
    return Case(
        family=family,
        number=number,
        kind=kind,
        effects=effects,
        terms=tuple(one.effect for one in hidden if isinstance(one.effect, Term)),
        snr_target=level,
        snr=snr,
        snr_each=each,
        snr_after_refit=snr,
        extra_scatter=extra,
        parameters=machine.parameters,
        disturbance_rms=force,
        dt_s=chosen.dt_s,
        runs=tuple(_measure(chosen, machine, full, force, rng)),
        sigma={channel.name: channel.sigma for channel in chosen.channels},
        quantum={channel.name: channel.quantum for channel in chosen.channels},
    )


def _draw_level(kind: str, rng: np.random.Generator) -> float:
    level = float(rng.choice(LEVELS))
    broad = float(np.exp(rng.uniform(*np.log(BROAD_LEVELS))))
    return {"none": 0.0, "broad": broad}.get(kind, level)


def _draw_machine(family: Family, scatter: float, rng: np.random.Generator) -> Machine:
    runs = int(rng.integers(4, 9)) if rng.uniform() < 0.75 else int(rng.integers(8, 13))
    samples = int(rng.integers(200, 401))
    parameters = {one.name: one.nominal * (1.0 + one.spread * _cut_normal(rng)) for one in family.parameters}
    first = int(rng.integers(0, 4))
    plans = tuple(family.plan(rng, samples, first + index) for index in range(runs))
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
    return [_draw_one(effect, rng) for effect in chosen]


def _draw_one(effect: Effect | Term, rng: np.random.Generator) -> Hidden:
    drawn = {name: float(rng.uniform(low, high)) for name, (low, high) in effect.drawn.items()}
    signed = isinstance(effect, Effect) and effect.signed
    return Hidden(effect, drawn, float(rng.choice((-1.0, 1.0))) if signed else 1.0)


def _find_size(snr_at: Callable[[float], float], level: float) -> float:
    """Return the share of the largest size at which the ratio is `level`, or 1 if it is not reached."""
    high = 1.0
    if snr_at(high) <= level:
        return high
    low = high
    while low > SMALLEST_SIZE and snr_at(low) > level:
        high, low = low, low * 0.25
    for _ in range(BISECTIONS):
        middle = float(np.sqrt(low * high))
        reached = snr_at(middle)
        if abs(reached - level) < SNR_PRECISION * level:
            return middle
        low, high = (middle, high) if reached < level else (low, middle)
    return float(np.sqrt(low * high))


def _snr(family: Family, plain: Sequence[Mapping[str, Array]], other: Sequence[Mapping[str, Array]]) -> float:
    """Return the rms change of the output divided by sigma, in the channel where it is largest."""
    ratios = []
    for channel in family.channels:
        change = np.concatenate(
            [after[channel.name] - before[channel.name] for before, after in zip(plain, other, strict=True)]
        )
        ratios.append(float(np.sqrt(np.mean(change**2))) / channel.sigma)
    return max(ratios)


def _measure(
    family: Family, machine: Machine, full: Sequence[dict[str, Array]], force: float, rng: np.random.Generator
) -> list[Run]:
    runs = []
    for index, plan in enumerate(machine.plans):
        measured = {}
        for channel in family.channels:
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
