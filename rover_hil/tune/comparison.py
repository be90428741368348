"""Which of the best trials is taken, and its comparison with the old values on held-out scenarios."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Generic

from rover_hil.config import Config
from rover_hil.config.tune_settings import TuneSettings
from rover_hil.tune.journal import Attempt
from rover_hil.tune.objective import Evaluation, MissionRunner, RunT, evaluate
from rover_hil.tune.parameters import start_values, with_values
from rover_hil.tune.scenarios import held_out_seeds, ranking_seeds
from rover_hil.tune.simulated_mission import SimulatedMission


class Verdict(StrEnum):
    """Result of a tuning."""

    IMPROVED = "improved"
    CONFIRMED = "confirmed"
    NONE_ACCEPTABLE = "none acceptable"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison(Generic[RunT]):
    """Old and new values on the held-out cases.

    Attributes:
        start: The old values.
        tuned: The new ones; the same as `start` unless the verdict is IMPROVED.
        values: The new values by key.
        declined: Candidates that were rejected here, or not better than the start, with the reason.
    """

    verdict: Verdict
    start: Evaluation[RunT]
    tuned: Evaluation[RunT]
    values: dict[str, float]
    declined: tuple[tuple[Attempt, str], ...]


def compare(
    config: Config, tune: TuneSettings, candidates: Sequence[Attempt], drive: MissionRunner
) -> Comparison[SimulatedMission]:
    """Rank the candidates on more scenarios, then compare on the held-out ones, see `compare_by`."""
    ranked, declined = _rank(config, tune, candidates, drive)
    seeds = held_out_seeds(tune.cases)
    comparison = compare_by(
        lambda values, limit: evaluate(drive, values, seeds, tune.objective, limit),
        config,
        start_values(config, tune),
        ranked,
    )
    return replace(comparison, declined=(*declined, *comparison.declined))


def _rank(
    config: Config, tune: TuneSettings, candidates: Sequence[Attempt], drive: MissionRunner
) -> tuple[list[Attempt], list[tuple[Attempt, str]]]:
    """Return the candidates by their cost in the ranking scenarios, and those rejected there."""
    ranked: list[tuple[float, int, Attempt]] = []
    declined: list[tuple[Attempt, str]] = []
    for attempt in candidates:
        values = with_values(config, attempt.values)
        more = evaluate(drive, values, ranking_seeds(tune.cases), tune.objective)
        if more.cost is None:
            declined.append((attempt, more.refused))
        else:
            ranked.append((more.cost, attempt.number, attempt))
    return [attempt for _, _, attempt in sorted(ranked)], declined


def compare_by(
    evaluate_held_out: Callable[[Config, float], Evaluation[RunT]],
    config: Config,
    start: dict[str, float],
    candidates: Sequence[Attempt],
) -> Comparison[RunT]:
    """Accept the first candidate that no held-out case rejects, if it costs less there than the start.

    Only one is compared by its cost: of several, one would be better than the start by chance.

    Args:
        evaluate_held_out: Evaluates a configuration on the held-out cases, up to a cost that is too high.
        config: The configuration of the start.
        start: Its values.
        candidates: In the order in which they are tried.
    """
    before = evaluate_held_out(config, math.inf)
    limit = math.inf if before.cost is None else before.cost
    declined: list[tuple[Attempt, str]] = []
    for attempt in candidates:
        tuned = evaluate_held_out(with_values(config, attempt.values), limit)
        if tuned.cost is not None and tuned.cost < limit:
            return Comparison(
                verdict=Verdict.IMPROVED,
                start=before,
                tuned=tuned,
                values=attempt.values,
                declined=tuple(declined),
            )
        declined.append((attempt, tuned.refused or "not better than the start on held-out cases"))
        if not tuned.refused:
            break
    return Comparison(
        verdict=Verdict.NONE_ACCEPTABLE if before.cost is None else Verdict.CONFIRMED,
        start=before,
        tuned=before,
        values=start,
        declined=tuple(declined),
    )
