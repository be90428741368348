"""How much the Robotino's rectangle changes when each tuned number of slip by effort or estimation is varied.

    python -m benchmarks.robotino.parameter_sensitivity [--of effort,estimation] [--groups motor,surface]
        [--kinds "linear,drive,yaw"] [--sites 1]

Drives the rectangle of `rectangle_experiment` with the slip map "linear in M", with the drive force and with
the yaw excitation, on the same random sites with the same noise, with each number of
`controllers/slip/effort/parameters.py` and `controllers/estimation/parameters.py` at 0.8 and at 1.2 of its
value (whole numbers change by at least 1). Prints as Markdown the changes of the rms distance of the estimate
from the truth (mm, mean over the sites) for each kind of compensation. Five minutes for a site on one core.
"""

import argparse
import sys
from functools import partial

import numpy as np

from benchmarks.robotino.rectangle_experiment import VERSIONS, Version, run_once
from benchmarks.sensitivity import print_table
from controllers.estimation.parameters import ESTIMATION
from controllers.slip.effort.parameters import EFFORT

OBJECTS: dict[str, object] = {"effort": EFFORT, "estimation": ESTIMATION}
LABELS = {
    "linear in M, gyro": "linear in M, mm",
    "drive force and surface, gyro": "drive force, mm",
    "yaw probe, gyro": "yaw excitation, mm",
}
USED = {LABELS[version.name]: version for version in VERSIONS if version.name in LABELS}
FIRST_SITE = 500


def score(versions: dict[str, Version], sites: int) -> dict[str, float]:
    """Return the error of the estimate with each kind of compensation, mean over the sites."""
    return {
        label: 1e3
        * float(np.mean([run_once((version, FIRST_SITE + site, 1)).estimate_m for site in range(sites)]))
        for label, version in versions.items()
    }


def main() -> int:
    """Print one table for each object of numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--of", default=",".join(OBJECTS))
    parser.add_argument("--groups", help="with commas; all of them when left out")
    parser.add_argument(
        "--kinds", default="linear,drive,yaw", help="first words of the kinds of compensation"
    )
    parser.add_argument("--sites", type=int, default=1)
    given = parser.parse_args()
    kinds = {label: version for label, version in USED.items() if label.split()[0] in given.kinds.split(",")}
    for name in given.of.split(","):
        print(f"\n{name}")
        print_table(OBJECTS[name], partial(score, kinds, given.sites), groups=given.groups)
    return 0


if __name__ == "__main__":
    sys.exit(main())
