"""How much results change when each tuned number of a parameter object is varied by 20 %.

    python -m benchmarks.sensitivity effort [estimation ...] [--groups motor,surface] [--cases linear:500]

Computes the result of each object's cases with each of its numbers at 0.8 and at 1.2 of its value (whole
numbers change by at least 1; of levels, shares and gates near 1 the rest to 1). Prints as Markdown the
changes of a few figures; "refused" where the data are rejected then. Numbers that change no figure, and
numbers that no case reads, are listed below the table.

object               cases                     source, figures, time on one core
effort, estimation   linear|drive|yaw:SITE     `robotino.py`: rms error of the rectangle; 5 minutes for a site
scomp                SEED                      `scomp.py`: both simulated field tests
ftrace               SET:SEED:SECONDS          `ftrace.py`: development drives; half an hour
motor                free,loaded               `identify.py`: two simulated motors
slip                 shaken:SEED, a data set   `identify.py`: a simulated drive, every fifth measured run
scomp_fit            TEST:SEED                 `identify.py`: a simulated field test
gyro                 configuration             `identify.py`: a virtual run of `calibrate imu`
data, statistics,    side:SEED, drive:PLACE,   `gap.py`: verdicts on cases of `benchmarks/gap`, carts and
machines             cart:SEED, FAMILY:SEED    machines of `tests/nature/machines`
"""

import argparse
import sys

from benchmarks.sensitivity import ftrace, gap, identify, robotino, scomp
from benchmarks.sensitivity.table import print_table

SUBJECTS = {**robotino.SUBJECTS, **scomp.SUBJECTS, **ftrace.SUBJECTS, **identify.SUBJECTS, **gap.SUBJECTS}


def main() -> int:
    """Print one table for each object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("objects", nargs="+", choices=SUBJECTS, metavar="object")
    parser.add_argument("--groups", help="with commas; all of them when left out")
    parser.add_argument("--cases", help="with commas; those of the object when left out")
    given = parser.parse_args()
    groups = given.groups.split(",") if given.groups else None
    for name in given.objects:
        subject = SUBJECTS[name]
        cases = given.cases or subject.cases
        print(f"\n{name}: {cases}", flush=True)
        print_table(subject, subject.prepare(cases.split(",")), groups)
    return 0


if __name__ == "__main__":
    sys.exit(main())
