"""Fit each robot on one half of its recordings, validate it on the other half, and print and write that."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.datasets.reference_fit.fit import EndError, end_error, jackknife, solve, start_values
from benchmarks.datasets.reference_fit.models import ROBOTS, Robot, Values
from benchmarks.datasets.reference_fit.recordings import Recording, halves

RESULTS = Path(__file__).with_name("results.json")
COMMAND = "python -m benchmarks.datasets.reference_fit ../shared/data/vehicles/optiodom"


def of_robot(robot: Robot, fitted: Sequence[Recording], validated: Sequence[Recording]) -> dict[str, Any]:
    """Return numbers with intervals, and end errors with them and with the nominal geometry."""
    start = start_values(robot, fitted)
    values = solve(robot, fitted, {}, start)
    numbers = jackknife(robot, fitted, values)
    other = solve(robot, validated, {}, values)
    return {
        "numbers": {
            name: {**asdict(number), "nominal": robot.nominal.get(name), "on_the_other_half": other[name]}
            for name, number in numbers.items()
        },
        "fitted": [recording.name for recording in fitted],
        "end_errors_validation": {
            recording.name: asdict(end_error(robot, recording, values)) for recording in validated
        },
        "summary": {
            "fitted": _summary(robot, validated, values),
            "nominal, marker fitted": _summary(robot, validated, start),
        },
    }


def _summary(robot: Robot, recordings: Sequence[Recording], values: Values) -> dict[str, float]:
    errors: list[EndError] = [end_error(robot, recording, values) for recording in recordings]
    distances = [error.distance_m for error in errors]
    return {
        "recordings": len(errors),
        "distance_rms_m": float(np.sqrt(np.mean(np.square(distances)))),
        "distance_median_m": float(np.median(distances)),
        "distance_greatest_m": max(distances),
        "yaw_rms_rad": float(np.sqrt(np.mean([error.yaw_rad**2 for error in errors]))),
    }


def main() -> None:
    """Fit, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    results: dict[str, Any] = {"command": COMMAND}
    for name, robot in ROBOTS.items():
        result = results[name] = of_robot(robot, *halves(options.folder / name))
        print(f"{name}: {len(result['fitted'])} recordings fitted")
        for key, number in result["numbers"].items():
            nominal = "-" if number["nominal"] is None else f"{number['nominal']:.5f}"
            print(
                f"  {key:20} {number['value']:9.5f} ({number['low']:.5f} to {number['high']:.5f}),",
                f"nominal {nominal}, other half {number['on_the_other_half']:.5f}",
            )
        for kind, summary in result["summary"].items():
            print(f"  end errors with {kind}:", ", ".join(f"{k} {v:.4g}" for k, v in summary.items()))
    options.out.write_text(json.dumps(results, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
