"""The simulated OptiOdom robots agree with closed forms and write the files of the published sets."""

import ast
import gzip
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.nature.optiodom_motion import (
    CIRCLE_M,
    KINDS,
    ROBOTS,
    STRAIGHT_M,
    Geometry,
    TrueRobot,
    body_of,
    commands,
    draw,
    record,
    wheels_for,
    write,
)

Array = NDArray[np.float64]


def exact(name: str, **changes: object) -> TrueRobot:
    """Return a robot as published, without noise."""
    robot = TrueRobot(
        name=name,
        geometry=ROBOTS[name].nominal,
        wheel_noise_m_sqrt_m=0.0,
        position_noise_m=0.0,
        yaw_noise_rad=0.0,
    )
    return replace(robot, **changes)  # type: ignore[arg-type]


def poses_of(robot: TrueRobot, kind: str) -> Array:
    return record(robot, commands(kind, is_left=True), np.random.default_rng(2)).pose


@pytest.mark.parametrize("name", ROBOTS)
def test_wheels_and_body_are_inverse(name: str) -> None:
    geometry = ROBOTS[name].nominal
    twist = (0.2, 0.05 if name == "omni3" else 0.0, 0.3)
    assert body_of(name, geometry, wheels_for(name, geometry, twist)) == pytest.approx(twist)
    spot = (0.0, 0.0, -0.4)
    assert body_of(name, geometry, wheels_for(name, geometry, spot)) == pytest.approx(spot, abs=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_straight_line_has_its_length_with_any_scrub(name: str) -> None:
    nominal = ROBOTS[name].nominal
    larger = Geometry(radii_m=tuple(1.02 * radius for radius in nominal.radii_m), size_m=nominal.size_m)
    pose = poses_of(exact(name, geometry=larger, lost=0.2), "straight")
    # Forward, back and forward again.
    assert math.hypot(*(pose[-1] - pose[0])[:2]) == pytest.approx(1.02 * STRAIGHT_M, rel=1e-3)
    assert pose[:, 2] == pytest.approx(pose[0, 2], abs=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_circle_has_its_radius_and_rotation(name: str, lost: float) -> None:
    pose = poses_of(exact(name, lost=lost), "circle")
    edge = ROBOTS[name].edge_m
    kept = 1.0 - lost * edge**2 / (edge**2 + CIRCLE_M**2)
    assert pose[-1, 2] - pose[0, 2] == pytest.approx(2.0 * math.tau * kept, rel=3e-3)
    middle = pose[len(pose) // 4 : len(pose) // 2]
    chord = math.hypot(*(middle[-1] - middle[0])[:2])
    radius = 0.5 * chord / math.sin(0.5 * (middle[-1, 2] - middle[0, 2]))
    assert abs(radius) == pytest.approx(CIRCLE_M / kept, rel=1e-3)


@pytest.mark.parametrize("name", ROBOTS)
def test_rotation_on_the_spot_loses_its_share(name: str) -> None:
    pose = poses_of(exact(name, lost=0.1), "spot")
    assert pose[-1, 2] - pose[0, 2] == pytest.approx(0.9 * 3.0 * math.tau, rel=2e-3)
    assert np.abs(pose[:, :2] - pose[0, :2]).max() < 1e-4


@pytest.mark.parametrize("name", ROBOTS)
def test_square_closes_without_scrub_only(name: str) -> None:
    closed, opened = (poses_of(exact(name, lost=lost), "square") for lost in (0.0, 0.05))
    assert closed[-1, :2] == pytest.approx(closed[0, :2], abs=0.01)
    assert closed[-1, 2] - closed[0, 2] == pytest.approx(2.0 * math.tau, abs=0.03)
    assert opened[-1, 2] - opened[0, 2] == pytest.approx(0.95 * 2.0 * math.tau, abs=0.03)


def test_another_track_makes_another_rotation() -> None:
    wider = Geometry(radii_m=(0.042, 0.042), size_m=0.22)
    pose = poses_of(exact("diff", geometry=wider), "spot")
    assert pose[-1, 2] - pose[0, 2] == pytest.approx(3.0 * math.tau / 1.1, rel=2e-3)


def test_zero_of_the_steering_bends_a_line() -> None:
    bent = Geometry(radii_m=(0.0325,), size_m=0.15, steering_zero_rad=0.05)
    forward = [(10.0, 0.15, 0.0, 0.0)]
    pose = record(exact("tricyc", geometry=bent), forward, np.random.default_rng(2)).pose
    driven = 0.15 * math.cos(0.05) * (10.0 - 0.15)
    assert pose[-1, 2] - pose[0, 2] == pytest.approx(driven * math.tan(0.05) / 0.15, rel=0.01)


@pytest.mark.parametrize("name", ROBOTS)
def test_readings_are_whole_counts_of_what_the_wheels_turned(name: str) -> None:
    robot = exact(name, marker=(0.03, -0.02, 1.0))
    run = record(robot, commands("straight", is_left=True), np.random.default_rng(2))
    wheels = run.readings[:, : len(robot.geometry.radii_m)]
    assert np.array_equal(wheels, np.round(wheels))
    rim = wheels_for(name, robot.geometry, (1.0, 0.0, 0.0))[: wheels.shape[1]]
    counts = STRAIGHT_M * rim / robot.geometry.radii_m * robot.kind.ticks_per_turn / math.tau
    assert wheels.sum(axis=0) == pytest.approx(counts, rel=2e-3, abs=2.0)
    cos, sin = np.cos(run.pose[:, 2]), np.sin(run.pose[:, 2])
    assert run.marker[:, 0] == pytest.approx(run.pose[:, 0] + 0.03 * cos + 0.02 * sin)
    assert run.marker[:, 1] == pytest.approx(run.pose[:, 1] + 0.03 * sin - 0.02 * cos)
    assert np.cos(run.marker[:, 2] - run.pose[:, 2]) == pytest.approx(math.cos(1.0))


@pytest.mark.parametrize("name", ROBOTS)
def test_files_have_the_form_of_the_published_ones(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    robot = draw(name, 0.05, rng)
    runs = [record(robot, commands(kind, is_left=False), rng) for kind in KINDS[:2]]
    write(tmp_path, "1", robot, runs)
    assert len(list(tmp_path.iterdir())) == 5
    table = np.loadtxt(tmp_path / "1_run-02.csv.gz", delimiter=",")
    columns = {"diff": 6, "omni3": 7, "tricyc": 6}
    assert table.shape == (len(runs[1].t_s), columns[name])
    assert np.diff(table[:, 0]) == pytest.approx(robot.kind.row_s)
    assert np.abs(table[:, 3]).max() <= math.pi
    raw = gzip.decompress((tmp_path / "1_run-02_odo.csv.gz").read_bytes()).decode()
    assert raw.startswith("\ufeff")
    numbers = np.array([[float(cell) for cell in row.split(",")] for row in raw[1:].splitlines()])
    assert np.abs(numbers[:, 1:]).sum() == pytest.approx(np.abs(table[:, 4:]).sum())
    metadata = gzip.decompress((tmp_path / "1_metadata.csv.gz").read_bytes()).decode().splitlines()
    assert metadata[0].startswith(f"type,{name}")
    assert len({row.count(",") for row in metadata}) == 1


def test_it_imports_nothing_of_the_program() -> None:
    path = Path(__file__).with_name("optiodom_motion.py")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        for name in names:
            assert name.split(".")[0] not in {"rover_hil", "controllers", "drivers", "sim_backends"}
