"""How large is the 95 % region of sound drives, next to that of an earlier version of the program?

    git worktree add ../before COMMIT
    python -m benchmarks.datasets.region_area ../shared/data/vehicles --before ../before [--seconds 60]

Each drive is imported by both versions from the same table and the same file of columns, without its truth;
those without a gyro get one, the turn of the truth with noise. Printed is the area of the region of the
place at the end, in m2, and the ratio of the root mean squares of the areas over the whole drive. A tricycle
without encoders at its rear wheels can be described only by the present version. Exit code 1 where a ratio is
above 1.2.
"""

import argparse
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np

from benchmarks.datasets.planted_faults import (
    TRUTH,
    Array,
    Measured,
    beginning,
    car,
    differential,
    mower,
    omnidirectional,
    runs_of,
    write_table,
)
from benchmarks.datasets.wrong_sensors import CHI2_95, with_gyro
from rover_hil.recording.reader import LogReader

BAR = 1.2


def drives(folder: Path) -> Iterator[Measured]:
    """Yield sound drives."""
    for path in runs_of(folder, "diff")[:3]:
        yield with_gyro(differential(path))
    for path in runs_of(folder, "omni3")[:3]:
        yield with_gyro(omnidirectional(path))
    mowed = mower(folder)
    yield Measured(mowed.name, mowed.columns, mowed.sections.replace(TRUTH, ""), mowed.motion, mowed.wheels)
    yield with_gyro(car(folder))


def areas_m2(tree: Path, place: Path) -> Array:
    """Import the table of a folder with the version in `tree`; return the area in each cycle."""
    log = place / "drive.mcap"
    log.unlink(missing_ok=True)
    command = ("import", "table", "drive.csv", "--columns", "columns.toml", "--out", "drive.mcap")
    run = f"import sys; sys.argv[0] = 'rover-hil'; from {_entry(tree)} import main; sys.exit(main())"
    environment = {**os.environ, "PYTHONPATH": str(tree.resolve())}
    subprocess.run(
        (sys.executable, "-c", run, *command), cwd=place, env=environment, check=True, capture_output=True
    )
    areas = []
    for message in LogReader(log).messages():
        if message.topic == "/estimate":
            xx, xy, _, yy, _, _ = cast("dict[str, Any]", message.json())["estimate"]["covariance"]
            areas.append(math.pi * CHI2_95 * math.sqrt(max(0.0, xx * yy - xy * xy)))
    return np.array(areas)


def _entry(tree: Path) -> str:
    """Return the module of the command in a version."""
    line = next(
        line
        for line in (tree / "pyproject.toml").read_text("utf-8").splitlines()
        if line.startswith("rover-hil = ")
    )
    return line.split('"')[1].split(":")[0]


def main() -> int:
    """Run; returns 1 where the bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--before", type=Path, required=True, help="folder of the earlier version")
    parser.add_argument("--only", default="")
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    worst = 0.0
    with TemporaryDirectory() as name:
        place = Path(name)
        for drive in drives(options.folder):
            if options.only not in drive.name:
                continue
            write_table(beginning(drive, options.seconds), place)
            before, now = (areas_m2(tree, place) for tree in (options.before, Path(__file__).parents[2]))
            ratio = float(np.sqrt(np.mean(now**2) / np.mean(before**2)))
            worst = max(worst, ratio)
            print(
                f"{drive.name:34} at the end {before[-1]:.4g} m2, now {now[-1]:.4g} m2;",
                f"whole drive {ratio:.3f} times",
                flush=True,
            )
    print(f"greatest ratio {worst:.3f}, bar {BAR}")
    return int(worst > BAR)


if __name__ == "__main__":
    sys.exit(main())
