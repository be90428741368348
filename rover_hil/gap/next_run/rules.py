"""Which explanations the search would keep, given the squared errors of left-out runs.

The rules compare left-out runs as `MachineSearch` does, for many simulated outcomes of new runs at once.
They are simpler in five ways:

- The best explanation is the one with the smallest merit; no effects are added, dropped or swapped.
- The evidence for each effect (its share of the error, agreeing runs, scatter of its strength, bounds) is not
  examined, so that neither the best nor an alternative is rejected by an objection.
- Alternatives are those of the list only; the search also fits similar effects.
- Explanations are fitted again with the new runs by linearisation only.
- Closure is that of left-out runs, not of locked ones; the tolerance is the default one, over all channels.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from rover_hil.gap.next_run.hypotheses import Hypothesis
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """What the search would answer, for each simulated outcome.

    Attributes:
        is_alone: By named explanation and outcome: only this one is left.
        is_whole: The best leaves the noise of the sensors, or closes the gap but for a tolerable rest.
    """

    is_alone: Flags
    is_whole: Flags


def kept_by_search(hypotheses: Sequence[Hypothesis], table: Array, number: Array) -> Kept:
    """Return which explanations would be left with new runs.

    Args:
        hypotheses: The explanations; the last, "something else", has the fit without effects.
        table: Squared errors of all runs when they are left out: explanation x outcome x run.
        number: Values of each run.
    """
    outcomes = table.shape[1]
    merits = np.sum(number * np.log(table / number), axis=2)
    total = float(number.sum())
    within = table.sum(axis=2) <= total * (1.0 + 3.0 * math.sqrt(2.0 / total))
    named = len(hypotheses) - 1
    best = np.argmin(merits[:named], axis=0)
    alone = np.zeros((named, outcomes), dtype=np.bool_)
    for index in range(named):
        stays = np.zeros(outcomes, dtype=np.bool_)
        for other in range(named):
            if other != index and len(hypotheses[other].fit.names) == len(hypotheses[index].fit.names):
                gains = merits[-1] - merits[[other, index]]
                is_as_good = gains[0] >= MACHINES.search.set_share * gains[1]
                stays |= within[other] | (is_as_good & _are_equal(table[other], table[index], number))
        alone[index] = (best == index) & ~stays
    each = np.arange(outcomes)
    excess = np.maximum(table.sum(axis=2) - total, 1e-9)
    is_closed = 1.0 - excess[best, each] / excess[-1] >= MACHINES.verdict.whole
    is_whole = within[best, each] | (is_closed & _is_rest_small(table[best, each] / number - 1.0))
    return Kept(is_alone=alone, is_whole=is_whole)


def _is_rest_small(squares: Array) -> Flags:
    """Return where the bound of the model error over runs is below the tolerance.

    Args:
        squares: Squared model errors in units of the sensor noise: outcome x run.
    """
    runs = squares.shape[1]
    if runs < 2:
        return np.zeros(squares.shape[0], dtype=np.bool_)
    error = np.std(squares, axis=1, ddof=1) / math.sqrt(runs)
    upper = squares.mean(axis=1) + float(stats.t.ppf(MACHINES.budget.level, runs - 1)) * error
    found: Flags = upper <= MACHINES.budget.tolerance**2
    return found


def _are_equal(one: Array, other: Array, counts: Array) -> Flags:
    """Return where left-out runs do not find one clearly worse than the other, nor better.

    This is `Evidence.is_equal` for many outcomes at once.
    """
    differences = np.log(one / other) * np.sqrt(counts)
    runs = differences.shape[1]
    if runs < 2:
        return np.ones(differences.shape[0], dtype=np.bool_)
    spread = np.std(differences, axis=1, ddof=1) / math.sqrt(runs)
    found: Flags = np.abs(differences.mean(axis=1)) / np.maximum(spread, 1e-12) < float(
        stats.t.ppf(0.5 + 0.5 * MACHINES.search.set_level, runs - 1)
    )
    return found
