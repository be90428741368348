"""`python -m tests.nature.ambiguous_ground FOLDER [--cases NAME,...] [--draws 10] [--frames 60]`."""

import argparse
import sys
from pathlib import Path

import cv2

from tests.nature.ambiguous_ground.cases import CASES, prepare
from tests.nature.ambiguous_ground.drive_files import write


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.nature.ambiguous_ground", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", default=",".join(CASES), help="names, with commas between them")
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--frames", type=int, default=60)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    cases = arguments.cases.split(",")
    unknown = [case for case in cases if case not in CASES]
    if unknown:
        parser.error(f"no such case: {', '.join(unknown)}; there are {', '.join(CASES)}")
    for case in cases:
        for draw in range(arguments.first, arguments.first + arguments.draws):
            write(prepare(case, draw, arguments.frames), arguments.folder / f"{case}_{draw}")
        sys.stderr.write(f"{case}\n")


main()
