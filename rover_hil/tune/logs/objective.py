"""Cost of one set of values over logs: accuracy and consistency, pooled."""

import math
from collections.abc import Iterable, Sequence
from statistics import NormalDist

import numpy as np

from rover_hil.config.tune_settings import LogObjectiveSettings
from rover_hil.drives.arrays import Array
from rover_hil.tune.logs.replayed_log import ReplayErrors
from rover_hil.tune.objective import Evaluation

LEAST_INNOVATIONS = 20
"""A kind of measurement with fewer innovations in all logs says nothing."""
MEDIAN_OF_SQUARE = NormalDist().inv_cdf(0.75) ** 2
"""Median of chi-square with one degree of freedom."""
WORST_RATIO = 1e6


def evaluate_logs(
    results: Iterable[ReplayErrors], objective: LogObjectiveSettings
) -> Evaluation[ReplayErrors]:
    """Take the results of all logs; refused where one of them is."""
    logs = tuple(results)
    refused = next((f"log {log.name}: {log.refused}" for log in logs if log.refused), "")
    terms = {} if refused else pooled_terms(logs)
    cost = 0.0 if refused else log_cost(terms, objective)
    return Evaluation(
        cost=None if refused else cost,
        at_least=cost,
        refused=refused,
        runs=logs,
        case_costs={},
        terms=terms,
    )


def log_cost(terms: dict[str, float], objective: LogObjectiveSettings) -> float:
    """Return the cost: the sum of all measured values, each divided by its reference."""
    return sum(terms[name] / reference for name, reference in objective.references().items() if name in terms)


def describe_logs(objective: LogObjectiveSettings) -> str:
    """Return the objective as text."""
    return " + ".join(f"{name} / {reference:g}" for name, reference in objective.references().items())


def pooled_terms(logs: Sequence[ReplayErrors]) -> dict[str, float]:
    """Return the measured values over logs, by the names of the objective; see there.

    `nis` and `whiteness` are missing where no kind of measurement has enough innovations.
    """
    position_m = np.concatenate([log.position_m for log in logs])
    yaw_rad = np.concatenate([log.yaw_rad for log in logs])
    terms = {
        "position_m": math.sqrt(float(np.mean(position_m**2))),
        "heading_deg": math.degrees(math.sqrt(float(np.mean(yaw_rad**2)))),
        "nees": _mean_distance(mean_nees(logs).values()),
    }
    kinds = consistency(logs)
    if kinds:
        terms["nis"] = _mean_distance(ratio for ratio, _ in kinds.values())
        terms["whiteness"] = float(np.mean([abs(correlation) for _, correlation in kinds.values()]))
    return terms


def mean_nees(logs: Sequence[ReplayErrors]) -> dict[str, float]:
    """Return the mean NEES over its dimension of position and yaw, 1 where the covariance is right."""
    position = np.concatenate([log.position_nees for log in logs])
    yaw = np.concatenate([log.yaw_nees for log in logs])
    return {"position": _bounded(float(np.mean(position))), "yaw": _bounded(float(np.mean(yaw)))}


def consistency(logs: Sequence[ReplayErrors]) -> dict[str, tuple[float, float]]:
    """Return the scale of the squared innovations, 1 where it is as reported, and their correlation, by kind.

    The scale is that of the median, so that single outliers do not count.
    """
    names = sorted({name for log in logs for name in log.innovations})
    by_kind: dict[str, tuple[float, float]] = {}
    for name in names:
        series = [log.innovations[name] for log in logs if name in log.innovations]
        values = np.concatenate(series)
        if values.size >= LEAST_INNOVATIONS:
            ratio = float(np.median(values**2)) / MEDIAN_OF_SQUARE
            by_kind[name] = (_bounded(ratio), _correlation(series))
    return by_kind


def _correlation(series: Sequence[Array]) -> float:
    """Return the correlation of successive values, not across the ends of series."""
    # An outlier would be most of both sums.
    bounded = [np.clip(values, -3.0, 3.0) for values in series]
    squares = sum(float(values @ values) for values in bounded)
    return sum(float(values[1:] @ values[:-1]) for values in bounded) / squares if squares else 0.0


def _mean_distance(ratios: Iterable[float]) -> float:
    """Return the mean absolute logarithm."""
    return float(np.mean([abs(math.log(ratio)) for ratio in ratios]))


def _bounded(ratio: float) -> float:
    return min(WORST_RATIO, max(1.0 / WORST_RATIO, ratio))
