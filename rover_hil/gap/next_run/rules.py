"""What the decision would be, given the squared errors of left-out runs.

It is made as in `decide`, for many simulated outcomes of new runs at once, but simpler in three ways: the
explanations are those of the list, fitted again with the new runs by linearisation; all channels together
have one tolerance, the default one; "none of these" wins wherever the winner leaves more than it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_hil.gap.decision.decide import size_of_fit, winners_of
from rover_hil.gap.evidence.units import log_densities
from rover_hil.gap.next_run.hypotheses import Hypothesis
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """What the decision would be, for each simulated outcome.

    Attributes:
        is_alone: By named explanation and outcome: this one is named.
        is_whole: Something is left that none of them explains is improbable.
    """

    is_alone: Flags
    is_whole: Flags


def simulated_decisions(hypotheses: Sequence[Hypothesis], table: Array, number: Array) -> Kept:
    """Return which explanations would be named with new runs.

    Args:
        hypotheses: The explanations; the last, "something else", has the fit without effects.
        table: Squared errors of all runs when they are left out: explanation x outcome x run.
        number: Values of each run.
    """
    named, outcomes = len(hypotheses) - 1, table.shape[1]
    draws = MACHINES.decision.weights
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(number.size), draws)
    table = table[:named]
    densities = number.size * np.einsum("eor,dr->ode", log_densities(table, number), weights)
    luck = np.broadcast_to(rng.gumbel(size=(draws, named)), densities.shape)
    squares = np.einsum("eor,dr->ode", table, weights)
    excess = squares / (weights @ number)[None, :, None] - 1.0
    winners = winners_of(
        densities.reshape(-1, named),
        excess.reshape(-1, named, 1),
        np.array([size_of_fit(one.fit) for one in hypotheses[:named]]),
        np.array([MACHINES.budget.tolerance]),
        hypotheses[0].fit.evidence.least_gain,
        luck.reshape(-1, named),
    )
    left = np.take_along_axis(excess.reshape(-1, named), winners[:, None], axis=1)[:, 0]
    is_none = (left > MACHINES.budget.tolerance**2).reshape(outcomes, draws)
    winners = winners.reshape(outcomes, draws)
    shares = [np.mean((winners == index) & ~is_none, axis=1) for index in range(named)]
    return Kept(
        is_alone=np.stack(shares) >= MACHINES.decide.named,
        is_whole=is_none.mean(axis=1) <= 1.0 - MACHINES.decide.named,
    )
