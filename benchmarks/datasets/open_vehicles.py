"""Open the recorded drives of other people with one command each; print what came of it.

    python -m benchmarks.datasets.open_vehicles ../shared/data/vehicles

Each kind of robot has its file of columns here, with nominal sizes. Of each set the first run is imported and
replayed; printed are the cycles, whether the replay is exact, and the root mean square distance between
estimate and true position, both from where the drive begins. No size is fitted; the order of the
wheels of omni3 is chosen by the truth of this run, so its distance is no test.
"""

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from rover_hil.drives.files.csv_table import read_csv

HERE = Path(__file__).parent
SETS = {
    "omni3": "optiodom/omni3/circular/*/*_run-01.csv.gz",
    "diff": "optiodom/diff/circular/*/*_run-01.csv.gz",
    "tricycle": "optiodom/tricyc/circular/*/*_run-01.csv.gz",
    "mower": "mower/increments.csv.gz",
}


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Return what a command of the program did."""
    command = [str(Path(sys.executable).with_name("rover-hil")), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def distance_rms_m(folder: Path) -> float:
    """Return the root mean square distance between estimate and true position, from one beginning.

    The frame of the truth is turned by its first yaw.
    """
    estimate, truth = read_csv(folder / "estimate.csv"), read_csv(folder / "truth.csv")
    times = [table.numbers(table.names[0]) for table in (estimate, truth)]
    x, y = (np.interp(times[1], times[0], estimate.numbers(f"estimate_{axis}_m")) for axis in "xy")
    true_x, true_y, yaw = (truth.numbers(name) for name in ("x_m", "y_m", "yaw_rad"))
    cos, sin = np.cos(yaw[0]), np.sin(yaw[0])
    east, north = true_x - true_x[0], true_y - true_y[0]
    error = np.hypot(x - x[0] - (cos * east + sin * north), y - y[0] - (cos * north - sin * east))
    return float(np.sqrt(np.mean(error**2)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Open all sets; returns 1 where one of them does not open and replay."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder: Path = parser.parse_args(arguments).folder
    failed = 0
    for name, pattern in SETS.items():
        file = min(folder.glob(pattern))
        with TemporaryDirectory() as place:
            log = Path(place) / "drive.mcap"
            columns = str(HERE / f"{name}.toml")
            imported = run("import", "table", str(file), "--columns", columns, "--out", str(log))
            if imported.returncode:
                failed += 1
                print(f"{name}: refused: {imported.stderr.splitlines()[-1]}")
                continue
            replayed = run("replay", str(log))
            failed += replayed.returncode != 0
            run("export", str(log), "--csv")
            print(
                f"{name}: {replayed.stdout.strip()}; rms {distance_rms_m(Path(place) / 'drive_csv'):.3f} m",
                flush=True,
            )
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
