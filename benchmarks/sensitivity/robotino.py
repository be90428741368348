"""Numbers of slip by effort and of the estimation: error of the Robotino's rectangle.

Drives the rectangle of `rectangle_experiment` with the slip map "linear in M", with the drive force or with
the yaw excitation, on the same random sites with the same noise. The figure is the rms distance of the
estimate from the truth in mm, mean over the sites of a kind.
"""

from collections import defaultdict
from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.robotino.rectangle_experiment import VERSIONS, run_once
from benchmarks.sensitivity.subject import Score, Subject
from controllers.estimation.parameters import ESTIMATION
from controllers.slip.effort.parameters import EFFORT

KINDS = {
    "linear": ("linear in M, gyro", "linear in M, mm"),
    "drive": ("drive force and surface, gyro", "drive force, mm"),
    "yaw": ("yaw excitation, gyro", "yaw excitation, mm"),
}
CASES = "linear:500,drive:500,yaw:500"


def prepare(cases: Sequence[str]) -> Score:
    """Return what computes the error of the estimate with each kind of compensation."""
    sites: dict[str, list[int]] = defaultdict(list)
    for case in cases:
        kind, site = case.split(":")
        sites[kind].append(int(site))
    return partial(figures, sites)


def figures(sites: dict[str, list[int]]) -> dict[str, float]:
    """Return the error with each kind of compensation, mean over its sites."""
    versions = {version.name: version for version in VERSIONS}
    errors = {}
    for kind, numbers in sites.items():
        name, label = KINDS[kind]
        errors_m = [run_once((versions[name], site, 1)).estimate_m for site in numbers]
        errors[label] = 1e3 * float(np.mean(errors_m))
    return errors


SUBJECTS = {
    "effort": Subject(parameters=EFFORT, cases=CASES, prepare=prepare),
    "estimation": Subject(parameters=ESTIMATION, cases=CASES, prepare=prepare),
}
