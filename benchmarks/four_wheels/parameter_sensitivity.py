"""How much sComp's result changes when each of its tuned numbers is varied by 20 %.

    python -m benchmarks.four_wheels.parameter_sensitivity [--seeds 3]

Computes the on-line odometry of the two simulated field tests of `benchmarks/four_wheels/scomp.py` with each
number of `SCOMP` at 0.8 and at 1.2 of its value; all other parameters are those that test 1 gives at the
usual values. Prints as Markdown the changes of the means over the seeds: final error of both tests (m), slip
angle and heading of test 2 (deg, rms). `motion.step_s` is not varied: only the loop of a rover uses it.
"""

import argparse
import sys
from functools import partial

import numpy as np

from benchmarks.four_wheels.scomp import FIRST_SEED, TESTS, Scores, online, read, run_seed, score
from benchmarks.sensitivity import print_table
from controllers.slip.scomp.parameters import SCOMP, ScompParameters
from tests.nature.four_wheel_drive import Recorded

NOT_VARIED = ("motion.step_s",)

Drives = list[dict[str, tuple[Recorded, ScompParameters]]]


def figures(drives: Drives) -> dict[str, float]:
    """Return the figures, mean over the seeds."""
    found: dict[str, list[Scores]] = {name: [] for name in TESTS}
    for tests in drives:
        for name, (recorded, parameters) in tests.items():
            drive, path = read(recorded)
            found[name].append(score(online(drive, parameters), recorded, path))
    return {
        "final 1, m": float(np.mean([one.final_m for one in found["test_1"]])),
        "final 2, m": float(np.mean([one.final_m for one in found["test_2"]])),
        "slip angle 2, deg": float(np.mean([one.slip_angle_deg for one in found["test_2"]])),
        "heading 2, deg": float(np.mean([one.heading_deg for one in found["test_2"]])),
    }


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    drives = [run_seed(seed, TESTS) for seed in range(FIRST_SEED, FIRST_SEED + given.seeds)]
    print_table(SCOMP, partial(figures, drives), leave_out=NOT_VARIED)
    return 0


if __name__ == "__main__":
    sys.exit(main())
