"""Levels of the gap test: `python -m benchmarks.gap_machines.levels [CASES]`.

Runs without a gap, made with the tests' geared axis, whose parameters do not differ between runs. The share
of cases with a probability below 5 % and 1 % should be at most 5 % and 1 %.
"""

import sys
from collections.abc import Sequence

import numpy as np

from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.evidence.gap_tests import gap_p
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.search.search import MachineSearch
from tests.rover_hil.gap.axis import axis_model, measured_runs

LEVELS = (0.05, 0.01)


def main(arguments: Sequence[str]) -> int:
    """Print the share of cases below each level."""
    cases = int(arguments[0]) if arguments else 100
    found = np.array([_p(seed) for seed in range(cases)])
    for level in LEVELS:
        print(f"p <= {level:g} in {int(np.sum(found <= level))} of {cases} cases without a gap")
    return 0


def _p(seed: int) -> float:
    model = axis_model()
    runs = measured_runs(seed=seed)
    problem = Problem(model, observe(model, runs))
    fits = MachineFits(problem, model.effects)
    base = fits.base()
    scores = MachineSearch(fits, lambda _: None).scores(base)
    return gap_p(base, problem, scores, np.random.default_rng(seed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
