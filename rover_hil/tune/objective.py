"""Cost of one set of values over its scenarios."""

import math
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from types import MappingProxyType
from typing import Generic, TypeVar

import numpy as np

from rover_hil.config import Config
from rover_hil.config.tune_settings import ObjectiveSettings
from rover_hil.tune.simulated_mission import SimulatedMission

RunT = TypeVar("RunT")
Runner = Callable[[Config, Sequence[int]], Generator[RunT, None, None]]
"""Starts the runs of some cases; yields their results in the order of the cases."""
MissionRunner = Runner[SimulatedMission]
"""Of missions, whose cases are the seeds of scenarios."""


NO_RIVAL: Mapping[int, float] = MappingProxyType({})
FEWEST_RACED = 3
MOST_ERRORS = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation(Generic[RunT]):
    """Result of one set of values over its cases.

    Attributes:
        cost: None where the values were refused or given up.
        at_least: Lower bound of the cost, from the cases driven.
        refused: Why the values are rejected, and on which case; empty when they are acceptable.
        runs: The cases driven: all, or up to where it was clear.
        case_costs: The costs of those that were not rejected, by case.
        terms: Each measured value over the cases driven, by its name.
    """

    cost: float | None
    at_least: float
    refused: str
    runs: tuple[RunT, ...]
    case_costs: dict[int, float]
    terms: dict[str, float]


def evaluate(
    drive: MissionRunner,
    config: Config,
    seeds: Sequence[int],
    objective: ObjectiveSettings,
    limit: float = math.inf,
) -> Evaluation[SimulatedMission]:
    """Drive the cases until the cost is known or certain to exceed `limit`, or the gains are rejected."""
    with closing(drive(config, seeds)) as results:
        return evaluate_results(results, len(seeds), objective, limit)


def evaluate_results(
    results: Iterable[SimulatedMission],
    count: int,
    objective: ObjectiveSettings,
    limit: float,
    rival_costs: Mapping[int, float] = NO_RIVAL,
) -> Evaluation[SimulatedMission]:
    """Take results of cases until the cost is known, or clear as for `evaluate`, or the race is lost.

    Args:
        results: Results of cases.
        count: Number of cases in all.
        objective: How they are valued.
        limit: As for `evaluate`.
        rival_costs: Costs of the same cases with other values, by seed; the race is lost when the cases
            driven so far are dearer by more than twice the standard error of the mean difference. The same
            noise in both (common random numbers) makes the differences small.
    """
    missions: list[SimulatedMission] = []
    costs: dict[int, float] = {}
    at_least = 0.0
    refused = ""
    for mission in results:
        missions.append(mission)
        if mission.refused:
            refused = f"scenario {mission.seed}: {mission.refused}"
            break
        costs[mission.seed] = case_cost(mission, objective)
        at_least = _least_cost([*costs.values()], count, objective)
        if at_least > limit or _has_lost(costs, rival_costs):
            break
    return Evaluation(
        cost=at_least if len(costs) == count else None,
        at_least=at_least,
        refused=refused,
        runs=tuple(missions),
        case_costs=costs,
        terms=quantile_terms(missions, objective.quantile),
    )


def quantile_terms(missions: Sequence[SimulatedMission], quantile: float) -> dict[str, float]:
    """Return the quantile of each measured value over missions; empty without missions."""
    names = missions[0].terms if missions else ()
    return {
        name: float(np.quantile([mission.terms[name] for mission in missions], quantile)) for name in names
    }


def case_cost(mission: SimulatedMission, objective: ObjectiveSettings) -> float:
    """Return the cost of one case: the sum of all measured values, each divided by its reference."""
    return sum(mission.terms[name] / reference for name, reference in objective.references().items())


def describe(objective: ObjectiveSettings) -> str:
    """Return the objective as text."""
    terms = " + ".join(f"{name} / {reference:g}" for name, reference in objective.references().items())
    return f"{objective.quantile:g} quantile over the cases of {terms}"


def _has_lost(costs: Mapping[int, float], rival_costs: Mapping[int, float]) -> bool:
    more = [cost - rival_costs[seed] for seed, cost in costs.items() if seed in rival_costs]
    if len(more) < FEWEST_RACED:
        return False
    error = float(np.std(more, ddof=1)) / math.sqrt(len(more))
    return float(np.mean(more)) > MOST_ERRORS * error


def _least_cost(costs: Sequence[float], cases: int, objective: ObjectiveSettings) -> float:
    """Return a lower bound of the cost of all cases from the first ones.

    No cost is negative, and a quantile never falls when one of its values rises.
    """
    return float(np.quantile([*costs, *[0.0] * (cases - len(costs))], objective.quantile))
