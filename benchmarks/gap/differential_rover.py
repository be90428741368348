"""Effects of `rover-hil gap rover` hidden in a differential rover by an independent simulator.

    python -m benchmarks.gap.differential_rover [--drives 6] [--duration 16] [--seed 0] [--only gyro]

The drives are those of `tests/nature/differential_drive.py`, the configuration is
docs/examples/differential.toml. Prints a table; `--only` takes the truths with this text in their names.
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np

from benchmarks.gap.drive_logs import write_log
from benchmarks.gap.rover_of_wheels import HEADER, ROOT, row, verdict_on_written
from rover_hil.config import load_config
from tests.nature.differential_drive import TrueDifferential, record

CONFIG = "docs/examples/differential.toml"
TRUTHS = {
    "as configured, within tolerances": TrueDifferential(),
    "left wheel 3 % larger": TrueDifferential(left_larger=0.03),
    "gyro shows 5 % too much": TrueDifferential(gyro_gain=1.05),
    "wheels 10 % farther apart": TrueDifferential(track_m=0.33),
    "every motion 8 % shorter by slip": TrueDifferential(slip=0.08),
    "pose 0.15 s late": TrueDifferential(pose_age_s=0.15),
    "creep across the ground by 3 % of the speed, on a stiff floor": TrueDifferential(creep=(0.0, 0.03)),
}


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--drives", type=int, default=6)
    parser.add_argument("--duration", type=float, default=16.0, help="of a drive, s")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="part of the name of a truth")
    arguments = parser.parse_args()
    os.chdir(ROOT)
    config, text = load_config(CONFIG), (ROOT / CONFIG).read_text("utf-8")
    print(HEADER, flush=True)
    for name, rover in TRUTHS.items():
        if arguments.only not in name:
            continue
        rng = np.random.default_rng(arguments.seed)

        def write(path: Path, rover: TrueDifferential = rover, rng: np.random.Generator = rng) -> None:
            write_log(path, config, record(rover, rng, duration_s=arguments.duration))

        print(row(name, verdict_on_written(text, write, arguments.drives)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
