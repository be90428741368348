"""Robots, grounds and sensors beside the usual ones: the judge of recorded drives names no wrong cause."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rover_hil.drives.quality.judge import drive_findings
from tests.nature.judged_drives import (
    CAR,
    DIFF,
    HEAVY,
    SKID4,
    TRICYCLE,
    Ground,
    Leg,
    Robot,
    Sensors,
    Table,
    record,
    tour,
)
from tests.rover_hil.command import Command

Fault = Callable[[Table], None]
SKID = Ground(slip=(0.0, 0.08), turning=(0.5, 0.8))
SPOT: list[Leg] = [(2, 0, 0, 0), (8, 0, 0, 0.7), (2, 0, 0, 0), (9, 0, 0, -0.6), (2, 0, 0, 0), (6, 0, 0, 0.9)]
WEAVE: list[Leg] = [(2, 0, 0, 0), *[(2.0, 0.5, 0.0, (-1) ** place * 0.25) for place in range(15)]]
ROAD: list[Leg] = [(100.0, 0.5, 0.0, 0.0)]
POSE = Sensors(truth="pose")
ARM = Sensors(truth="pose", arm_m=0.25 + 0.15j, marker_deg=20.0)


def scaled(factor: float, *names: str) -> Fault:
    def fault(table: Table) -> None:
        for name in names:
            table.columns[name] = table.columns[name] * factor

    return fault


def exchanged(*pairs: tuple[str, str]) -> Fault:
    def fault(table: Table) -> None:
        for first, second in pairs:
            table.columns[first], table.columns[second] = table.columns[second], table.columns[first]

    return fault


def wide_track(table: Table) -> None:
    for wheel in table.spec["rover"]["wheels"]:
        wheel["y_m"] *= 1.4


def found_in(
    command: Command,
    robot: Robot,
    sensors: Sensors,
    ground: Ground | None = None,
    fault: Fault | None = None,
    legs: list[Leg] | None = None,
) -> list[str]:
    rng = np.random.default_rng(5)
    table = record(robot, legs or tour(robot, rng), ground or Ground(), sensors, rng)
    if fault is not None:
        fault(table)
    arguments = table.write(Path("drive"))
    assert command("import", *arguments, "--out", "drive.mcap", "--no-estimate") == 0, command.error
    return [finding.text for finding in drive_findings(Path("drive.mcap"))]


@pytest.mark.parametrize(
    ("robot", "sensors", "ground", "legs"),
    [
        pytest.param(DIFF, POSE, None, SPOT, id="rotations on the spot go nowhere"),
        pytest.param(DIFF, ARM, None, SPOT, id="a marker beside the origin goes round"),
        pytest.param(SKID4, Sensors(), SKID, SPOT, id="slip in turning is no part of a drive"),
        pytest.param(DIFF, Sensors(truth="place", truth_m=0.015), None, WEAVE, id="a path that hardly bends"),
        pytest.param(DIFF, Sensors(truth="place", bias_deg_s=1.0), None, ROAD, id="a biased gyro on a road"),
        pytest.param(CAR, Sensors(fixes="geodetic"), Ground(turning=(0.92, 1.0)), None, id="understeer"),
    ],
)
def test_a_sound_drive_has_no_finding(
    command: Command, robot: Robot, sensors: Sensors, ground: Ground | None, legs: list[Leg] | None
) -> None:
    assert found_in(command, robot, sensors, ground, legs=legs) == []


@pytest.mark.parametrize(
    ("robot", "sensors", "ground", "fault", "words"),
    [
        pytest.param(
            SKID4,
            POSE,
            SKID,
            exchanged(("a0", "a1"), ("a2", "a3")),
            "left and right exchanged",
            id="sides of four wheels",
        ),
        pytest.param(DIFF, POSE, None, wide_track, r"0\.7\d* times as wide", id="a track is no radius"),
        pytest.param(
            DIFF, POSE, None, scaled(-1.0, "truth_yaw"), "yaw of the ground truth has the opp", id="yaw"
        ),
        pytest.param(
            DIFF, POSE, None, exchanged(("truth_x", "truth_y")), "x and y of the ground truth", id="x and y"
        ),
        pytest.param(
            CAR, Sensors(fixes="geodetic"), None, scaled(3.6, "a0", "a1"), r"0\.2\d+ times as far", id="km/h"
        ),
        pytest.param(
            HEAVY, Sensors(fixes="geodetic"), None, scaled(0.4, "a0", "a1"), r"2\.\d+ times as far", id="gear"
        ),
        pytest.param(TRICYCLE, POSE, None, scaled(-1.0, "steer"), "steering reversed", id="steering"),
    ],
)
def test_the_cause_is_reported(
    command: Command, robot: Robot, sensors: Sensors, ground: Ground | None, fault: Fault, words: str
) -> None:
    (first, *_) = found_in(command, robot, sensors, ground, fault)
    assert re.search(words, first), first
