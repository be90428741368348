"""Draw a case: a machine, its runs and what is hidden, from a seed, a class and a number alone."""

from dataclasses import dataclass, replace

import numpy as np

from tests.nature.hidden_machines.effect import Effect
from tests.nature.hidden_machines.excitation import excite
from tests.nature.hidden_machines.kinds import MACHINES
from tests.nature.hidden_machines.machine import Machine, Number, Values
from tests.nature.hidden_machines.visible import Sight

CLASSES = ("catalogue", "order", "outside", "none", "faint")
"""Of `faint` the hidden effect is of the catalogue or outside, and shows about as much as the noise."""
RATIOS, PAIR_RATIOS, FAINT_RATIOS = (0.5, 10.0), (1.5, 8.0), (0.6, 1.6)
FEW_SHARE, FEW_RUNS = 0.15, (3, 4, 4, 5, 5)
TOO_SURE = (5.0, 12.0)
"""Error of a wrong parameter, in prior standard deviations of its user."""
SAME = 16.0
"""Chi-square below which the runs do not separate two explanations."""


@dataclass(frozen=True)
class Case:
    """Runs of one machine and what is hidden in them."""

    seed: int
    kind: str
    number: int
    machine: Machine
    """With the base parameters of its user."""
    numbers: Values
    """Base parameters and conditions of nature, of shape (runs,)."""
    starts: Values
    inputs: Values
    hidden: tuple[tuple[Effect, float], ...]
    """In the order in which a signal passes them."""
    listed: tuple[Effect, ...]
    ratio: float
    """What shows of the hidden effects after a fit without them, over the noise."""
    best_other: float
    """What shows of them where the most similar other effect of the list is fitted."""
    alike: tuple[str, ...]
    """Listed effects that the runs do not separate from the hidden ones."""
    correlation: float
    """Of successive readings' noise."""

    @property
    def runs(self) -> int:
        """Return the number of runs."""
        return len(next(iter(self.inputs.values())))


def draw(seed: int, kind: str, number: int) -> Case:
    """Return the case of a seed, a class and a number."""
    rng = np.random.default_rng([seed, CLASSES.index(kind), number])
    able = [machine for machine in MACHINES if kind != "order" or machine.pairs]
    order = np.random.default_rng([seed, CLASSES.index(kind)]).permutation(len(able))
    machine = _of_user(able[int(order[number % len(able)])], rng)
    runs = int(rng.choice(FEW_RUNS)) if rng.uniform() < FEW_SHARE else int(rng.integers(6, 13))
    numbers = _numbers(machine, runs, rng)
    starts = {start.state: rng.normal(0.0, start.spread, runs) for start in machine.starts}
    inputs = {
        command.name: np.stack([excite(command, machine.samples, rng) for _ in range(runs)])
        for command in machine.inputs
    }
    correlation = float(rng.uniform(0.3, 0.8)) if rng.uniform() < 0.35 else 0.0
    chosen = _chosen(machine, kind, rng)
    numbers |= {
        effect.place: np.full(runs, number.nominal)
        for effect, _, _ in chosen
        for number in machine.numbers
        if effect.where == "parameter" and number.name == effect.place
    }
    sight = Sight(machine, numbers, starts, inputs)
    hidden = tuple((effect, sight.strength(effect, ratio, sign)) for effect, ratio, sign in chosen)
    listed = _listed(machine, hidden, rng)
    names = {effect.name for effect, _ in hidden}
    others = [effect for effect in listed if effect.name not in names]
    rests = {other.name: sight.rest(hidden, other) for other in others} if hidden else {}
    alike = tuple(name for name, (chi_square, _) in rests.items() if chi_square < SAME)
    ratio = sight.ratio(hidden) if hidden else 0.0
    machine = _too_sure(machine, hidden, rng)
    best_other = min((left for _, left in rests.values()), default=0.0)
    return Case(
        seed, kind, number, machine, numbers, starts, inputs, hidden, listed,
        ratio, best_other, alike, correlation,
    )  # fmt: skip


def rounded(value: float, digits: int) -> float:
    """Return a value as a person writes it."""
    return float(f"{value:.{digits}g}")


def _of_user(machine: Machine, rng: np.random.Generator) -> Machine:
    """Return a machine of another size."""

    def scaled(number: Number) -> Number:
        return replace(number, nominal=rounded(number.nominal * rng.uniform(0.87, 1.15), 3))

    return replace(machine, numbers=tuple(scaled(number) for number in machine.numbers))


def _numbers(machine: Machine, runs: int, rng: np.random.Generator) -> Values:
    """Return nature's base parameters, within the prior, and the conditions of each run."""
    shares = {number.name: np.clip(rng.normal(), -2.0, 2.0) * number.share_sd for number in machine.numbers}
    values: Values = {
        number.name: np.full(runs, number.nominal * (1.0 + shares[number.name])) for number in machine.numbers
    }
    for condition in machine.conditions:
        values[condition.name] = np.round(rng.uniform(condition.low, condition.high, runs), 1)
    return values


def _chosen(machine: Machine, kind: str, rng: np.random.Generator) -> list[tuple[Effect, float, float]]:
    """Return the effects that are hidden, how much each shows, and its sign."""
    if kind == "none":
        return []
    low, high = np.log({"order": PAIR_RATIOS, "faint": FAINT_RATIOS}.get(kind, RATIOS))
    if kind == "order":
        pair = list(machine.pairs[int(rng.integers(len(machine.pairs)))])
        rng.shuffle(pair)
        effects = [machine.effect(name) for name in pair]
    else:
        pools = {"catalogue": machine.catalogue, "outside": machine.outside}
        pool = pools.get(kind, (*machine.catalogue, *machine.outside))
        effects = [pool[int(rng.integers(len(pool)))]]
    result = []
    for effect in effects:
        ratio = float(np.exp(rng.uniform(low, high)))
        result.append((effect, ratio, float(rng.choice([-1.0, 1.0])) if effect.is_signed else 1.0))
    return result


def _too_sure(
    machine: Machine, hidden: tuple[tuple[Effect, float], ...], rng: np.random.Generator
) -> Machine:
    """Return a machine whose user is surer of a wrong parameter than its error allows."""
    errors = {effect.place: abs(error) for effect, error in hidden if effect.where == "parameter"}

    def stated(number: Number) -> Number:
        if number.name not in errors:
            return number
        return replace(number, share_sd=errors[number.name] / number.nominal / rng.uniform(*TOO_SURE))

    return replace(machine, numbers=tuple(stated(number) for number in machine.numbers))


def _listed(
    machine: Machine, hidden: tuple[tuple[Effect, float], ...], rng: np.random.Generator
) -> tuple[Effect, ...]:
    """Return the effects of the user's list: the hidden ones of the catalogue among four to six others."""
    own = [effect for effect, _ in hidden if effect.line]
    others = [effect for effect in machine.catalogue if effect not in own]
    order = rng.permutation(len(others))[: int(rng.integers(4, 7))]
    every = own + [others[int(k)] for k in order]
    return tuple(every[int(k)] for k in rng.permutation(len(every)))


def true_size(case: Case, effect: Effect, strength: float) -> float:
    """Return the size of an effect as documented; of a wrong parameter, its error from the nominal value."""
    if effect.where != "parameter":
        return effect.reported(strength)
    nominal = next(number.nominal for number in case.machine.numbers if number.name == effect.place)
    return float(case.numbers[effect.place][0]) + strength - nominal


def noise_rng(case: Case, variant: int) -> np.random.Generator:
    """Return the random numbers of the noise of a variant of a case."""
    return np.random.default_rng([case.seed, CLASSES.index(case.kind), case.number, 1000 + variant])


def order_of_runs(case: Case, variant: int) -> list[int]:
    """Return the order in which a variant lists the runs."""
    rng = noise_rng(case, variant)
    return [int(run) for run in rng.permutation(case.runs)] if variant else list(range(case.runs))
