"""The reference fit finds the numbers of simulated robots, and differs by kind of motion where scrub does."""

import math

import numpy as np
import pytest

from benchmarks.datasets.reference_fit.fit import end_error, solve, start_values
from benchmarks.datasets.reference_fit.models import MARKER, ROBOTS
from benchmarks.datasets.reference_fit.recordings import Recording
from tests.nature.optiodom_motion import Geometry, TrueRobot, commands, record

GEOMETRIES = {
    "diff": Geometry(radii_m=(0.0425, 0.0415), size_m=0.205),
    "omni3": Geometry(radii_m=(0.0515, 0.0505, 0.051), size_m=0.19),
    "tricyc": Geometry(radii_m=(0.033,), size_m=0.155, steering_zero_rad=-0.02),
}
NAMES = {
    "diff": ("radius_right_m", "radius_left_m", "track_m"),
    "omni3": ("radius_0_m", "radius_1_m", "radius_2_m", "base_m"),
    "tricyc": ("radius_m", "wheelbase_m", "steering_zero_rad"),
}


def recordings(robot: TrueRobot, *kinds: str) -> list[Recording]:
    rng = np.random.default_rng(4)
    directions = (0.0, math.pi / 3.0) if robot.name == "omni3" else (0.0,)
    runs = [
        record(robot, commands(kind, is_left=left, direction=direction), rng)
        for kind in kinds
        for left in (False, True)
        for direction in directions
    ]
    return [
        Recording(
            "", run.t_s, np.column_stack((run.marker[:, :2], np.unwrap(run.marker[:, 2]))), run.readings
        )
        for run in runs
    ]


def fitted(robot: TrueRobot, *kinds: str) -> dict[str, float]:
    model = ROBOTS[robot.name]
    driven = recordings(robot, *kinds)
    return solve(model, driven, {}, start_values(model, driven))


@pytest.mark.parametrize("name", GEOMETRIES)
def test_it_finds_the_numbers_of_a_robot_without_scrub(name: str) -> None:
    geometry = GEOMETRIES[name]
    robot = TrueRobot(name=name, geometry=geometry, marker=(0.04, -0.03, 0.5))
    values = fitted(robot, "straight", "circle")
    expected = [*geometry.radii_m, geometry.size_m]
    expected += [geometry.steering_zero_rad] if name == "tricyc" else []
    assert [values[key] for key in NAMES[name]] == pytest.approx(expected, rel=5e-3, abs=1e-3)
    assert [values[key] for key in MARKER] == pytest.approx([0.04, -0.03, 0.5], abs=0.005)
    errors = [end_error(ROBOTS[name], each, values) for each in recordings(robot, "square")]
    assert max(error.distance_m for error in errors) < 0.05


def test_scrub_makes_the_track_differ_by_kind_of_motion() -> None:
    robot = TrueRobot(name="diff", geometry=GEOMETRIES["diff"], lost=0.1)
    track = {kind: fitted(robot, "straight", kind)["track_m"] for kind in ("circle", "spot")}
    assert track["spot"] == pytest.approx(0.205 / 0.9, rel=0.01)
    assert track["circle"] == pytest.approx(0.205 / (1.0 - 0.1 * 0.01 / (0.01 + 0.49)), rel=0.01)
