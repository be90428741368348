"""Which treatment of rejected trials finds acceptable values with the fewest trials.

    python -m benchmarks.tuning.constraints [--seeds 10] [--trials 80]

No missions: a function of four values in the unit cube stands for them, with twelve scenarios, driven in an
order that does not know which are hard. A trial ends at the first scenario that rejects it. Every treatment
has the same trials. Prints a line for each task and treatment: in how many studies acceptable values were
found, the median number of trials until then, and the median cost of the best values above the optimum.
"""

import argparse
import statistics

import numpy as np
from optuna.distributions import BaseDistribution
from optuna.trial import FrozenTrial, TrialState, create_trial

from rover_hil.config.tune_settings import TunableSettings
from rover_hil.drives.arrays import Array
from rover_hil.tune import search
from rover_hil.tune.journal import Attempt

SIZE, BATCH, CASES = 4, 8, 12
PARAMETERS = {f"v{index}": TunableSettings(low=0.0, high=1.0, unit="1") for index in range(SIZE)}
HARDEST = (0.18, 0.36)
"""Distance from a centre within which the hardest scenario is acceptable."""
CENTRE, OPTIMUM = np.array([0.75, 0.3, 0.6, 0.4]), np.array([0.8, 0.35, 0.55, 0.4])


def evaluate(number: int, values: dict[str, float], hardest: float) -> Attempt:
    """Return the trial of some values; like a study it stops at the first scenario that rejects them."""
    point = np.array(list(values.values()))
    limits = np.random.default_rng(0).permutation(np.linspace(hardest, 1.0, CASES))
    passed = limits > _distance(point, CENTRE)
    cost = 1.0 + 5.0 * _distance(point, OPTIMUM)
    costs = {case: cost for case in range(CASES) if passed[: case + 1].all()}
    refused = "" if passed.all() else "rejected"
    return Attempt(
        number=number,
        values=values,
        cost=None if refused else cost,
        at_least=cost * len(costs) / CASES,
        refused=refused,
        is_start=number == 0,
        case_costs=costs,
    )


def _distance(point: Array, second: Array) -> float:
    return float(np.sqrt(np.mean((point - second) ** 2)) * 2.0)


def as_pruned(attempt: Attempt, distributions: dict[str, BaseDistribution]) -> FrozenTrial:
    """Rank rejected trials below all others, by the lower bound of their cost."""
    if not attempt.refused:
        return search.as_trial(attempt, distributions)
    return create_trial(
        params=attempt.values,
        distributions=distributions,
        state=TrialState.PRUNED,
        intermediate_values={0: attempt.at_least},
    )


def as_large_cost(attempt: Attempt, distributions: dict[str, BaseDistribution]) -> FrozenTrial:
    """Give rejected trials a large cost."""
    if not attempt.refused:
        return search.as_trial(attempt, distributions)
    return create_trial(params=attempt.values, distributions=distributions, value=1000.0)


TREATMENTS: dict[str, search.AsTrial] = {
    "constraint": search.as_trial,
    "ranked last": as_pruned,
    "large cost": as_large_cost,
}


def study(
    treatment: search.AsTrial, hardest: float, seed: int, trials: int
) -> tuple[int | None, float | None]:
    """Return the trials until the first acceptable one, and the best cost above the optimum."""
    start = dict.fromkeys(PARAMETERS, 0.1)
    told = [evaluate(0, start, hardest)]
    while len(told) <= trials:
        proposals = search.propose(PARAMETERS, start, told, BATCH, seed=seed, make_trial=treatment)
        told += [evaluate(len(told) + index, values, hardest) for index, values in enumerate(proposals)]
    known = [(attempt.number, attempt.cost) for attempt in told if attempt.cost is not None]
    if not known:
        return None, None
    return known[0][0], min(cost for _, cost in known) - 1.0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--trials", type=int, default=80)
    arguments = parser.parse_args()
    points = np.random.default_rng(1).random((100_000, SIZE))
    for hardest in HARDEST:
        share = float(np.mean([_distance(point, CENTRE) < hardest for point in points]))
        task = f"{share:.2%} acceptable"
        for name, treatment in TREATMENTS.items():
            studies = [study(treatment, hardest, seed, arguments.trials) for seed in range(arguments.seeds)]
            first = [trials for trials, _ in studies if trials is not None]
            costs = [cost for _, cost in studies if cost is not None]
            print(
                f"{task}, {name}: found in {len(first)} of {arguments.seeds}"
                + (
                    f", after {statistics.median(first):.0f} trials, cost {statistics.median(costs):.2f}"
                    if first
                    else ""
                ),
                flush=True,
            )


if __name__ == "__main__":
    main()
