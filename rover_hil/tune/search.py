"""Which values are tried next: optuna's tree-structured Parzen estimator (Bergstra 2011).

Rejected values have no cost. That values are acceptable is a constraint: rejected ones are worse than all
acceptable ones, and the less so the more cases they passed. The search is made anew from the trials before,
and depends on nothing else.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence

from drivers.errors import ConfigError
from rover_hil.config.tune_settings import TunableSettings
from rover_hil.tune.journal import Attempt

try:
    import optuna
    from optuna.distributions import BaseDistribution, FloatDistribution
    from optuna.exceptions import ExperimentalWarning
    from optuna.trial import FrozenTrial, TrialState, create_trial
except ModuleNotFoundError as missing:
    raise ConfigError("tuning needs optuna: install rover-hil[tune]") from missing

AsTrial = Callable[[Attempt, dict[str, BaseDistribution]], FrozenTrial]
MOST_TRIALS = 1_000_000

Proposer = Callable[
    [Mapping[str, TunableSettings], Mapping[str, float], Sequence[Attempt], int], list[dict[str, float]]
]
"""Returns so many sets of values, from the ranges, the start values and the trials of earlier batches."""


def as_trial(attempt: Attempt, distributions: dict[str, BaseDistribution]) -> FrozenTrial:
    """Return a trial of optuna; one without a cost ranks by the cases driven, a rejected one below all."""
    if attempt.cost is not None:
        return create_trial(params=attempt.values, distributions=distributions, value=attempt.cost)
    driven = len(attempt.case_costs)
    return create_trial(
        params=attempt.values,
        distributions=distributions,
        state=TrialState.PRUNED,
        intermediate_values={driven: attempt.at_least},
        constraints={"rejected": 1.0 / (1.0 + driven)} if attempt.refused else None,
    )


def propose(
    parameters: Mapping[str, TunableSettings],
    start: Mapping[str, float],
    told: Sequence[Attempt],
    count: int,
    *,
    seed: int = 0,
    make_trial: AsTrial = as_trial,
) -> list[dict[str, float]]:
    """Return the values of the next batch, see `Proposer`.

    Those of one batch keep away from each other: each is taken as bad while the next is proposed.

    Another `seed` gives other values. `make_trial` returns a trial for optuna.
    """
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    distributions: dict[str, BaseDistribution] = {
        key: FloatDistribution(parameter.low, parameter.high, log=parameter.scale == "log")
        for key, parameter in parameters.items()
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        sampler = optuna.samplers.TPESampler(seed=MOST_TRIALS * seed + len(told), constant_liar=True)
    study = optuna.create_study(sampler=sampler)
    study.add_trials([make_trial(attempt, distributions) for attempt in told])
    return [study.ask(distributions).params for _ in range(count)]
