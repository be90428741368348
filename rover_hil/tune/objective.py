"""Cost of one set of values over its scenarios."""

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from rover_hil.config import Config
from rover_hil.config.tune_settings import ObjectiveSettings
from rover_hil.tune.simulated_mission import SimulatedMission

MissionRunner = Callable[[Config, Sequence[int]], Generator[SimulatedMission, None, None]]
"""Drives the mission on the scenarios of some seeds; yields the results in the order of the seeds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """Result of one set of values over its cases.

    Attributes:
        cost: The quantile of the cases' costs; None where the gains were refused or given up.
        at_least: Lower bound of the cost, from the cases driven.
        refused: Why the gains are rejected, and on which scenario; empty when they are acceptable.
        rehearsals: The cases driven: all, or up to where it was clear.
    """

    cost: float | None
    at_least: float
    refused: str
    missions: tuple[SimulatedMission, ...]


def evaluate(
    drive: MissionRunner,
    config: Config,
    seeds: Sequence[int],
    objective: ObjectiveSettings,
    limit: float = math.inf,
) -> Evaluation:
    """Drive the cases until the cost is known or certain to exceed `limit`, or the gains are rejected."""
    missions: list[SimulatedMission] = []
    costs: list[float] = []
    at_least = 0.0
    refused = ""
    with closing(drive(config, seeds)) as results:
        for mission in results:
            missions.append(mission)
            if mission.refused:
                refused = f"scenario {mission.seed}: {mission.refused}"
                break
            costs.append(case_cost(mission, objective))
            at_least = _least_cost(costs, len(seeds), objective)
            if at_least > limit:
                break
    is_known = len(costs) == len(seeds)
    return Evaluation(
        cost=at_least if is_known else None,
        at_least=at_least,
        refused=refused,
        missions=tuple(missions),
    )


def case_cost(mission: SimulatedMission, objective: ObjectiveSettings) -> float:
    """Return the cost of one case: the sum of all measured values, each divided by its reference."""
    return sum(mission.terms[name] / reference for name, reference in objective.references().items())


def describe(objective: ObjectiveSettings) -> str:
    """Return the objective as text."""
    terms = " + ".join(f"{name} / {reference:g}" for name, reference in objective.references().items())
    return f"{objective.quantile:g} quantile over the cases of {terms}"


def _least_cost(costs: Sequence[float], cases: int, objective: ObjectiveSettings) -> float:
    """Return a lower bound of the cost of all cases from the first ones.

    No cost is negative, and a quantile never falls when one of its values rises.
    """
    return float(np.quantile([*costs, *[0.0] * (cases - len(costs))], objective.quantile))
