"""Write sets of drives, each drive into a folder with its name."""

import argparse
from pathlib import Path

from tests.nature.region_drives.cases import SETS, draw
from tests.nature.region_drives.write import write_case


def main() -> None:
    """Write the drives."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1, help="1 is for development, 100 and up for judgement")
    parser.add_argument("--set", choices=SETS, action="append", help="default: all")
    parser.add_argument("--most", type=int, default=1000, help="drives of each set")
    options = parser.parse_args()
    for name in options.set or SETS:
        for number in range(min(options.most, SETS[name][0])):
            case = draw(name, number, options.seed)
            write_case(case, options.folder / case.name)


if __name__ == "__main__":
    main()
