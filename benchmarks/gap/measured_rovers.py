"""`rover-hil gap rover` on the circles of measured robots, beside the reference fit of their trajectories.

    python -m benchmarks.gap.measured_rovers DATA [--runs 6] [--robot diff]

DATA holds `diff`, `omni3` and `tricyc` of the optiodom recordings. The rover is that of their file of columns
in rover_hil/drives/presets. The reference was fitted and stored before the first comparison
(`benchmarks.gap.reference_rovers`). The rear wheels of the tricycle have neither a motor nor a sensor.
"""

import argparse
import json
import os
from pathlib import Path

import numpy as np

from benchmarks.gap.rover_of_wheels import ROOT, verdict_of
from rover_hil.drives.formats.described_rover import load_rover

REFERENCE = Path(__file__).parent / "references" / "optiodom_circles.json"
ROBOTS = ("diff", "omni3", "tricyc")


def circles(data: Path, robot: str, runs: int) -> list[Path]:
    """Return recordings of a robot, at most this many, from all of them evenly."""
    files = sorted((data / robot).rglob("*_run-??.csv.gz"))
    chosen = np.unique(np.linspace(0, len(files) - 1, min(len(files), runs)).round().astype(int))
    return [files[index] for index in chosen]


def main() -> None:
    """Print the verdicts and the reference."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--robot", choices=ROBOTS, help="one of them only")
    arguments = parser.parse_args()
    data = arguments.data.resolve()
    os.chdir(ROOT)
    reference = json.loads(REFERENCE.read_text("utf-8"))
    for robot in ROBOTS:
        if arguments.robot not in (None, robot):
            continue
        columns = f"optiodom_{robot}"
        radius_m = load_rover(columns).rover.wheel_radius_m
        chosen = circles(data, robot, arguments.runs)
        verdict = verdict_of(columns, chosen)
        print(f"\n{robot}, {len(chosen)} runs, {verdict['seconds']:.0f} s: {verdict['verdict']}")
        print(verdict["sentence"])
        print(json.dumps(verdict["effects"]))
        for one in verdict.get("base_parameters", []):
            low, high = one["ci95"]
            print(
                f"  {one['name']} {one['value']:.5f} ({low:.5f} to {high:.5f}), pull {one['pull']:+.1f}"
                f"{', named' if one['is_named'] else ''} {one['why']}"
            )
        for name, row in reference[robot]["parameters"].items():
            share = f", {row['value'] / radius_m - 1.0:+.4f}" if name.startswith("radius") else ""
            print(f"  reference {name} {row['value']:.5f} ({row['low']:.5f} to {row['high']:.5f}){share}")


if __name__ == "__main__":
    main()
