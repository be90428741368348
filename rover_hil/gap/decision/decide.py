"""The one decision: which explanation is right, and with what probability.

Every explanation that the search visited predicts each unit of observation from the others. The units are
weighted at random (Bayesian bootstrap, Rubin 1981). In each draw the winner is the smallest explanation
within the tolerance of the best; the probability of an explanation is the share of the draws that it wins.
Of explanations of one size the winner is drawn by their odds in that draw, so that explanations that the runs
hardly distinguish are not decided by chance.
This is how stacking compares predictive distributions (Yao et al., Bayesian Analysis 13, 2018), with the
winner where it has weights, since effects are named and not averaged.

"None of these" wins a draw where the winner leaves more than the tolerance and the same explanation with an
unknown correlated force at the ports predicts the units better.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rover_hil.gap.data.problem import Observations, Problem
from rover_hil.gap.decision.structure import force_densities
from rover_hil.gap.evidence.evidence import MachineFit, Names
from rover_hil.gap.evidence.units import Predicted, Units, observation_units, predict_units
from rover_hil.gap.fit.base_parameters import far_parameters
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array, Machine

NONE = -1
"""Winner of a draw in which no explanation is right."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """An explanation.

    Attributes:
        names: Its effects, sorted; the last may be a law in no list.
        machine: The model that has them.
        fit: To the runs.
        is_listed: All its effects are effects of the model.
        tried: Laws of its kind that are compared; together they are as probable before as one of the list.
    """

    names: Names
    machine: Machine
    fit: MachineFit
    is_listed: bool
    tried: int = 1

    @property
    def moved(self) -> list[str]:
        """The base parameters that it says are far from what was known of them; none beside another law."""
        if not self.is_listed:
            return []
        released = [card.releases for card in self.machine.effects if card.name in self.names]
        return [*far_parameters(self.fit.fit), *(name for name in released if name is not None)]

    @property
    def size(self) -> int:
        """Its effects, and the base parameters that it moves far from what was known of them."""
        return size_of_fit(self.fit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Explanations with their probabilities.

    Attributes:
        candidates: The explanations.
        units: Of observation.
        winners: Number of the explanation that wins each draw, or `NONE`.
        best: Number of the one that wins most draws, with or without an unknown force beside it.
        kept: Effects of the winners to the share of the draws in which the winner has the effect, with an
            unknown force beside it, and the effect explains most of what would be left without it.
    """

    candidates: tuple[Candidate, ...]
    units: Units
    winners: NDArray[np.intp]
    best: int
    kept: Mapping[str, float] = field(default_factory=dict)

    @property
    def chosen(self) -> Candidate:
        """The explanation that wins most draws, with or without an unknown force beside it."""
        return self.candidates[self.best]

    @property
    def none(self) -> float:
        """Probability that none of the explanations is right."""
        return float(np.mean(self.winners == NONE))

    def share(self, index: int) -> float:
        """Return the probability of an explanation."""
        return float(np.mean(self.winners == index))

    def probability(self, effect: str) -> float:
        """Return the probability of an effect: the share of the draws whose winner contains it."""
        alone = sum(self.share(one) for one, item in enumerate(self.candidates) if effect in item.names)
        return alone + self.kept.get(effect, 0.0)

    def base_probability(self, parameter: str) -> float:
        """Return the share of the draws whose winner moves a base parameter far from what was known of it.

        An effect that sets the parameter free moves it, too: this is the same explanation.
        """
        return sum(self.share(one) for one, item in enumerate(self.candidates) if parameter in item.moved)

    def ranked(self) -> list[tuple[float, Candidate]]:
        """Return the explanations that win a draw, the most probable first."""
        shares = [(self.share(one), item) for one, item in enumerate(self.candidates)]
        return sorted((pair for pair in shares if pair[0] > 0.0), key=lambda pair: -pair[0])

    def members(self) -> list[Candidate]:
        """Return the smallest set of explanations that is right with 95 %; fewer if "none" is likely."""
        total = 0.0
        found: list[Candidate] = []
        for share, item in self.ranked():
            if total >= MACHINES.decide.whole_set * (1.0 - self.none):
                break
            total += share
            if item.names not in [one.names for one in found]:  # else the same effects in another order
                found.append(item)
        return found


def decide(problem: Problem, candidates: Sequence[Candidate], best: MachineFit) -> Decision:
    """Return the decision between explanations; `best` gives the correlation time of the errors."""
    units = observation_units(problem, best)
    predicted = [predict_units(one.fit, units) for one in candidates]
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(units.count), MACHINES.decide.draws)
    densities = units.count * weights @ np.stack([one.densities for one in predicted]).T
    # Their prior probabilities: of the kind of law, and of base parameters away from nominal.
    excess = np.stack([_excess(one, weights) for one in predicted], axis=1)
    densities -= [math.log(one.tried) + 0.5 * one.fit.pulls for one in candidates]
    luck = rng.gumbel(size=densities.shape)
    sizes = np.array([one.size for one in candidates])
    tolerances = _tolerances(problem.observations)
    winners = winners_of(densities, excess, sizes, tolerances, best.evidence.least_gain, luck)
    chosen = int(np.argmax(np.bincount(winners, minlength=len(candidates))))
    winner = candidates[chosen]
    kept: dict[str, float] = {}
    forced = force_densities(problem, winner.machine, winner.fit, units)
    if forced is not None:
        plain, with_force = forced
        each = np.arange(winners.size)
        is_large = (excess[each, winners] > tolerances**2).any(axis=1)
        is_better = weights @ (with_force - plain) > 0.0
        is_none = is_large & is_better
        kept = kept_effects(candidates, excess, winners, is_none)
        winners = np.where(is_none, NONE, winners)
    return Decision(candidates=tuple(candidates), units=units, winners=winners, best=chosen, kept=kept)


def kept_effects(
    candidates: Sequence[Candidate], excess: Array, winners: NDArray[np.intp], is_none: NDArray[np.bool_]
) -> dict[str, float]:
    """Return the share of the draws in which the winner has an effect that explains most, beside a force."""
    found: dict[str, float] = {}
    for index in np.unique(winners[is_none]):
        is_own = is_none & (winners == index)
        for name in candidates[index].names:
            part = _without(candidates, candidates[index], name)
            if part is not None:
                is_most = is_own & _explains_most(excess[:, index], excess[:, part])
                found[name] = found.get(name, 0.0) + float(np.mean(is_most))
    return found


def _without(candidates: Sequence[Candidate], one: Candidate, effect: str) -> int | None:
    """Return the number of an explanation without one of its effects; None where it was not visited."""
    names = tuple(name for name in one.names if name != effect)
    places = [place for place, item in enumerate(candidates) if item.is_listed and item.names == names]
    return places[0] if places else None


def _explains_most(after: Array, before: Array) -> NDArray[np.bool_]:
    """Return the draws in which nine tenths of the error of some channel are taken away."""
    shares = (before - after) / np.maximum(before, 1e-300)
    is_most = (shares >= MACHINES.verdict.whole) & (before > 0.0)
    return np.asarray(is_most.any(axis=1), dtype=np.bool_)


def _excess(predicted: Predicted, weights: Array) -> Array:
    """Return the squared model error of each channel in each draw, in units of its noise."""
    counts = np.maximum(weights @ predicted.counts, 1e-300)
    found: Array = weights @ predicted.squares / counts - 1.0
    return found


def _tolerances(observations: Observations) -> Array:
    """Return the tolerance of each channel, in units of its noise."""
    return np.array(
        [
            (one.tolerance or MACHINES.budget.tolerance * one.noise_sd) / one.noise_sd
            for one in observations.channels
        ]
    )


def size_of_fit(found: MachineFit) -> int:
    """Return the number of its effects, and of the base parameters far from what was known of them."""
    return len(found.names) + len(far_parameters(found.fit))


def is_same_law(one: MachineFit, other: MachineFit, base: MachineFit) -> bool:
    """Return True where two explanations change the predictions of the base model alike."""
    first, second = base.errors - one.errors, base.errors - other.errors
    length = float(np.linalg.norm(first) * np.linalg.norm(second))
    return abs(float(first @ second)) > MACHINES.terms.same_law * length


def winners_of(
    densities: Array,
    excess: Array,
    sizes: Array,
    tolerances: Array,
    least_gain: float | None,
    luck: Array,
) -> NDArray[np.intp]:
    """Return the smallest explanation within the tolerance of the best in each draw.

    Args:
        densities: Logarithms of the predictive densities: draws x explanations.
        excess: Squared model errors in units of the noise: draws x explanations x channels.
        sizes: Of the explanations.
        tolerances: Of the channels, in units of their noise.
        least_gain: What each effect must gain in twice the logarithm of the density; None where the error of
            each channel is compared with its tolerance.
        luck: Standard Gumbel numbers, which draw the winner among explanations of one size by its odds.
    """
    each = np.arange(densities.shape[0])
    best = np.argmax(densities, axis=1)
    if least_gain is None:
        worse = excess - excess[each, best][:, None]
        allowed = np.maximum(tolerances**2, MACHINES.search.share * np.maximum(excess, 0.0))
        is_within = np.asarray((worse <= allowed).all(axis=2), dtype=np.bool_)
    else:
        fewer = np.maximum(sizes[best][:, None] - sizes[None, :], 0)
        is_within = densities[each, best][:, None] - densities <= 0.5 * least_gain * fewer
    is_within[each, best] = True
    # The best of those of the least size: a step in size outweighs any density.
    least = np.where(is_within, sizes[None, :], sizes.max() + 1).min(axis=1)
    is_least = is_within & (sizes[None, :] == least[:, None])
    found: NDArray[np.intp] = np.argmax(np.where(is_least, densities + luck, -np.inf), axis=1)
    return found
