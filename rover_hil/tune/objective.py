"""From the cases of one set of values to one number."""

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from rover_hil.config import Config
from rover_hil.config.tune_settings import ObjectiveSettings
from rover_hil.tune.rehearsal import Rehearsal

Drive = Callable[[Config, Sequence[int]], Generator[Rehearsal, None, None]]
"""Drives a mission on the sites of some seeds; gives the results in their order, as they are asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """What the cases together say about one set of values.

    Attributes:
        cost: The quantile of the cases' costs; None where the gains were refused or given up.
        at_least: What the cost is at least, from the cases driven.
        refused: Why the gains are not acceptable, and on which site; empty when they are.
        rehearsals: The cases driven: all, or up to where it was clear.
    """

    cost: float | None
    at_least: float
    refused: str
    rehearsals: tuple[Rehearsal, ...]


def evaluate(
    drive: Drive, config: Config, seeds: Sequence[int], objective: ObjectiveSettings, limit: float = math.inf
) -> Evaluation:
    """Drive the cases until the cost is known or sure to exceed `limit`, or the gains are refused."""
    rehearsals: list[Rehearsal] = []
    costs: list[float] = []
    at_least = 0.0
    refused = ""
    with closing(drive(config, seeds)) as results:
        for rehearsal in results:
            rehearsals.append(rehearsal)
            if rehearsal.refused:
                refused = f"site {rehearsal.seed}: {rehearsal.refused}"
                break
            costs.append(case_cost(rehearsal, objective))
            at_least = _least_cost(costs, len(seeds), objective)
            if at_least > limit:
                break
    is_known = len(costs) == len(seeds)
    return Evaluation(
        cost=at_least if is_known else None,
        at_least=at_least,
        refused=refused,
        rehearsals=tuple(rehearsals),
    )


def case_cost(rehearsal: Rehearsal, objective: ObjectiveSettings) -> float:
    """Return the cost of one case: each measured value in units of its reference, summed."""
    return sum(rehearsal.terms[name] / reference for name, reference in objective.references().items())


def describe(objective: ObjectiveSettings) -> str:
    """Return the objective in words."""
    terms = " + ".join(f"{name} / {reference:g}" for name, reference in objective.references().items())
    return f"{objective.quantile:g} quantile over the cases of {terms}"


def _least_cost(costs: Sequence[float], cases: int, objective: ObjectiveSettings) -> float:
    """Return what the cost of all cases will be at least when only the first are known.

    No cost is negative, and a quantile never falls when one of its values rises.
    """
    return float(np.quantile([*costs, *[0.0] * (cases - len(costs))], objective.quantile))
