"""Numbers of sComp: on-line odometry of the two simulated field tests of `benchmarks/four_wheels/scomp.py`.

All parameters of a rover are those that test 1 gives at the usual values. Figures are means over the seeds:
final error of both tests (m), slip angle and heading of test 2 (deg, rms). `motion.step_s` is not varied:
only the loop of a rover uses it.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.four_wheels.scomp import FIRST_SEED, TESTS, Scores, online, read, run_seed, score
from benchmarks.sensitivity.subject import Score, Subject
from controllers.slip.scomp.parameters import SCOMP, ScompParameters
from tests.nature.four_wheel_drive import Recorded

Drives = list[dict[str, tuple[Recorded, ScompParameters]]]


def prepare(seeds: Sequence[str]) -> Score:
    """Return what computes the figures of the field tests of these seeds."""
    return partial(figures, [run_seed(int(seed), TESTS) for seed in seeds])


def figures(drives: Drives) -> dict[str, float]:
    """Return the figures, mean over the seeds."""
    scores: dict[str, list[Scores]] = {name: [] for name in TESTS}
    for tests in drives:
        for name, (recorded, parameters) in tests.items():
            drive, path = read(recorded)
            scores[name].append(score(online(drive, parameters), recorded, path))
    first, second = scores["test_1"], scores["test_2"]
    return {
        "final 1, m": float(np.mean([result.final_m for result in first])),
        "final 2, m": float(np.mean([result.final_m for result in second])),
        "slip angle 2, deg": float(np.mean([result.slip_angle_deg for result in second])),
        "heading 2, deg": float(np.mean([result.heading_deg for result in second])),
    }


SUBJECTS = {
    "scomp": Subject(
        parameters=SCOMP,
        cases=",".join(str(FIRST_SEED + number) for number in range(3)),
        prepare=prepare,
        fixed=("motion.step_s",),
    )
}
