"""Wheels, geometry and marker of three robots by a plain fit of trajectories, without the product.

    python -m benchmarks.gap.reference_rovers DATA [--json FILE]

DATA holds `diff`, `tricyc` and `omni3` of the optiodom recordings. Wheel ticks are integrated over stretches
of 4 s; where the marker ends, seen from where it began, is fitted to the motion capture. Free are the wheels,
the geometry, and place and yaw of the marker on the robot. The 95 % interval is that of the jackknife over
runs.
"""

import argparse
import csv
import gzip
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import least_squares

STRETCH_S = 4.0
ENDS_S = 2.0
"""Beginning and end of a record that are not used: the robot stands there or changes its speed."""
MOST_RUNS = 12
START_SIZES = (0.005, 0.005, 0.02)
"""First guess of the errors of a stretch: along m, across m, yaw rad."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """One of the three.

    Attributes:
        names: Of the parameters of wheels and geometry; those of the marker follow.
        nominal: Their values by the data sheet.
        motion: Returns forward m, left m and turn rad of each cycle from ticks and parameters.
    """

    names: tuple[str, ...]
    nominal: tuple[float, ...]
    motion: Callable[[Array, Array], Array]


MARKER = ("marker_x_m", "marker_y_m", "marker_yaw_rad")


def _differential(ticks: Array, values: Array) -> Array:
    right_m, left_m = (ticks[:, index] * 2.0 * np.pi / (43.7 * 64.0) * values[index] for index in (0, 1))
    return np.stack(((right_m + left_m) / 2.0, 0.0 * right_m, (right_m - left_m) / values[2]), axis=1)


def _tricycle(ticks: Array, values: Array) -> Array:
    radius_m, base_m, offset_rad = values
    way_m, angle = ticks[:, 0] * 2.0 * np.pi / 1600.0 * radius_m, ticks[:, 1] + offset_rad
    return np.stack((way_m * np.cos(angle), 0.0 * way_m, way_m * np.sin(angle) / base_m), axis=1)


def _omnidirectional(ticks: Array, values: Array) -> Array:
    ways_m = ticks * 2.0 * np.pi / (12.0 * 1024.0) * values[:3]
    # The signs of the ticks count a turn to the left as negative.
    angles = np.radians((210.0, -30.0, 90.0))
    along = np.stack((-np.cos(angles), -np.sin(angles), np.full(3, values[3])), axis=1)
    motion: Array = -ways_m @ np.linalg.inv(along).T
    return motion


ROBOTS: Mapping[str, Robot] = {
    "diff": Robot(
        names=("radius_right_m", "radius_left_m", "track_m"),
        nominal=(0.042, 0.042, 0.2),
        motion=_differential,
    ),
    "tricyc": Robot(
        names=("radius_m", "wheel_base_m", "steering_offset_rad"),
        nominal=(0.0325, 0.15, 0.0),
        motion=_tricycle,
    ),
    "omni3": Robot(
        names=("radius_1_m", "radius_2_m", "radius_3_m", "centre_distance_m"),
        nominal=(0.051, 0.051, 0.051, 0.195),
        motion=_omnidirectional,
    ),
}


def read_run(path: Path) -> Array:
    """Return the rows of a record: time, x, y, yaw, ticks."""
    with gzip.open(path, "rt") as file:
        return np.array([[float(one) for one in row if one] for row in csv.reader(file)])


def runs_of(folder: Path) -> list[Array]:
    """Return at most twelve runs, evenly over the records."""
    files = sorted(one for one in folder.rglob("*_run-??.csv.gz"))
    chosen = np.unique(np.linspace(0, len(files) - 1, min(len(files), MOST_RUNS)).round().astype(int))
    return [read_run(files[index]) for index in chosen]


def stretches_of(run: Array) -> list[Array]:
    """Return pieces of equal duration; each begins with the last row of the one before."""
    run = run[(run[:, 0] > run[0, 0] + ENDS_S) & (run[:, 0] < run[-1, 0] - ENDS_S)]
    rows = round(STRETCH_S / float(np.median(np.diff(run[:, 0]))))
    return [run[index : index + rows + 1] for index in range(0, len(run) - rows, rows)]


def _between(pose: Array, later: Array) -> Array:
    """Return a later pose as the earlier one sees it."""
    turn = (later[2] - pose[2] + np.pi) % (2.0 * np.pi) - np.pi
    dx, dy = later[0] - pose[0], later[1] - pose[1]
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    return np.array((cosine * dx + sine * dy, cosine * dy - sine * dx, turn))


def _body_end(motion: Array) -> Array:
    """Return the pose at the end of a path whose cycles are short arcs."""
    yaw = np.concatenate(([0.0], np.cumsum(motion[:, 2])))
    middle = (yaw[:-1] + yaw[1:]) / 2.0
    x_m = np.sum(np.cos(middle) * motion[:, 0] - np.sin(middle) * motion[:, 1])
    y_m = np.sum(np.sin(middle) * motion[:, 0] + np.cos(middle) * motion[:, 1])
    return np.array((x_m, y_m, yaw[-1]))


def _marker_end(body: Array, marker: Array) -> Array:
    """Return the pose of the marker at the end, as it was at the start."""
    x_m, y_m, turn = marker
    cosine, sine = np.cos(body[2]), np.sin(body[2])
    end = np.array((body[0] + cosine * x_m - sine * y_m, body[1] + sine * x_m + cosine * y_m, turn + body[2]))
    return _between(marker, end)


def errors(robot: Robot, pieces: Sequence[Array], values: Array) -> Array:
    """Return measured minus integrated end of each stretch: stretches x (along, across, yaw)."""
    count = len(robot.names)
    found = []
    for piece in pieces:
        body = _body_end(robot.motion(piece[1:, 4:], values[:count]))
        seen = _between(piece[0, 1:4], piece[-1, 1:4])
        error = seen - _marker_end(body, values[count:])
        error[2] = (error[2] + np.pi) % (2.0 * np.pi) - np.pi
        found.append(error)
    return np.array(found)


def fit(robot: Robot, pieces: Sequence[Array], start: Array, sizes: Array) -> Array:
    """Return the parameters that fit the stretches best."""
    scale = np.array([*(abs(one) or 0.1 for one in robot.nominal), 0.05, 0.05, 0.1])
    found = least_squares(
        lambda shares: (errors(robot, pieces, shares * scale) / sizes).ravel(),
        start / scale,
        loss="soft_l1",
        f_scale=3.0,
    )
    values: Array = found.x * scale
    return values


def reference(name: str, folder: Path) -> dict[str, object]:
    """Return the fitted parameters of a robot with intervals, and the errors before and after."""
    robot = ROBOTS[name]
    by_run = [stretches_of(run) for run in runs_of(folder / name)]
    pieces = [one for run in by_run for one in run]
    nominal = np.array([*robot.nominal, 0.0, 0.0, 0.0])
    sizes = np.array(START_SIZES)
    for _ in range(2):
        values = fit(robot, pieces, nominal, sizes)
        sizes = np.sqrt(np.mean(errors(robot, pieces, values) ** 2, axis=0))
    left_out = np.array(
        [
            fit(
                robot,
                [one for other, run in enumerate(by_run) if other != index for one in run],
                values,
                sizes,
            )
            for index in range(len(by_run))
        ]
    )
    count = len(by_run)
    spread = np.sqrt(
        (count - 1) / count * np.sum((np.array(left_out) - np.mean(left_out, axis=0)) ** 2, axis=0)
    )
    half = float(stats.t.ppf(0.975, count - 1)) * spread
    return {
        "runs": count,
        "stretches": len(pieces),
        "parameters": {
            one: {"nominal": first, "value": value, "low": value - width, "high": value + width}
            for one, first, value, width in zip(
                (*robot.names, *MARKER), nominal.tolist(), values.tolist(), half.tolist(), strict=True
            )
        },
        "error_nominal": np.sqrt(np.mean(errors(robot, pieces, nominal) ** 2, axis=0)).tolist(),
        "error_fitted": sizes.tolist(),
    }


def main() -> None:
    """Print a table of each robot."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    tables = {name: reference(name, arguments.data) for name in ROBOTS}
    for name, table in tables.items():
        print(
            f"{name}: {table['runs']} runs, {table['stretches']} stretches; errors of a stretch (m, m, rad)"
        )
        print(f"  nominal {table['error_nominal']}, fitted {table['error_fitted']}")
        parameters = table["parameters"]
        assert isinstance(parameters, dict)
        for one, row in parameters.items():
            interval = f"{row['low']:.5f} to {row['high']:.5f}"
            print(f"  {one} {row['value']:.5f} ({interval}), nominal {row['nominal']}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(tables, indent=2) + "\n", "utf-8")


if __name__ == "__main__":
    main()
