"""Comparison of old and new values on held-out scenarios."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from rover_hil.config import Config
from rover_hil.config.tune_settings import TuneSettings
from rover_hil.tune.journal import Attempt
from rover_hil.tune.objective import Evaluation, MissionRunner, evaluate
from rover_hil.tune.parameters import start_values, with_values
from rover_hil.tune.scenarios import held_out_seeds


class Verdict(StrEnum):
    """Result of a tuning."""

    IMPROVED = "improved"
    CONFIRMED = "confirmed"
    NONE_ACCEPTABLE = "none acceptable"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Old and new values on the held-out cases.

    Attributes:
        start: The old values.
        tuned: The new ones; the same as `start` unless the verdict is IMPROVED.
        values: The new values by key.
        declined: Candidates that were not taken, with the reason.
    """

    verdict: Verdict
    start: Evaluation
    tuned: Evaluation
    values: dict[str, float]
    declined: tuple[tuple[Attempt, str], ...]


def compare(
    config: Config, tune: TuneSettings, candidates: Sequence[Attempt], drive: MissionRunner
) -> Comparison:
    """Accept the first candidate that no held-out case rejects and that costs less there than the start."""
    seeds = held_out_seeds(tune.cases)
    start = evaluate(drive, config, seeds, tune.objective)
    limit = math.inf if start.cost is None else start.cost
    declined: list[tuple[Attempt, str]] = []
    for attempt in candidates:
        tuned = evaluate(drive, with_values(config, attempt.values), seeds, tune.objective, limit)
        if tuned.cost is not None and tuned.cost < limit:
            return Comparison(
                verdict=Verdict.IMPROVED,
                start=start,
                tuned=tuned,
                values=attempt.values,
                declined=tuple(declined),
            )
        declined.append((attempt, tuned.refused or "not better than the start on held-out scenarios"))
    return Comparison(
        verdict=Verdict.NONE_ACCEPTABLE if start.cost is None else Verdict.CONFIRMED,
        start=start,
        tuned=start,
        values=start_values(config, tune),
        declined=tuple(declined),
    )
