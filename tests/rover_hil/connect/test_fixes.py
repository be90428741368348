"""Pose fixes over ROS 2: what is used, and a run that they correct."""

import math
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from drivers.clock import nanoseconds, wall_time_ns
from rover_hil.config.ros2_settings import POSE_FIX
from rover_hil.connect.ros2.connection import Ros2Connection
from rover_hil.connect.ros2.fixes import Fix, read_fix
from rover_hil.connect.ros2.mapping import header, turned
from rover_hil.connect.ros2.messages import (
    Point,
    Pose,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    TFMessage,
    Twist,
    Vector3,
)
from tests.rover_hil.connect.by_hand import (
    Scripted,
    Steps,
    drive,
    estimates_of,
    hand_config,
    replays_exactly,
)

if TYPE_CHECKING:
    from rover_hil.connect.ros2.node import Node

NOW_NS = 1_800_000_000_000_000_000
ARRIVAL_NS = 5_000_000_000


def message(
    x_m: float = 1.0,
    y_m: float = 2.0,
    yaw_rad: float = 0.5,
    *,
    sd_m: float = 0.01,
    sd_rad: float = 0.02,
    time_ns: int = NOW_NS,
    frame: str = "map",
) -> PoseWithCovarianceStamped:
    covariance = [0.0] * 36
    covariance[0] = covariance[7] = sd_m**2
    covariance[35] = sd_rad**2
    pose = Pose(Point(x_m, y_m), turned(yaw_rad))
    return PoseWithCovarianceStamped(header(time_ns, frame), PoseWithCovariance(pose, covariance))


def read(made: PoseWithCovarianceStamped) -> Fix | str:
    return read_fix(made, "map", ARRIVAL_NS, NOW_NS)


def test_a_fix_has_its_place_its_uncertainty_and_the_time_of_its_stamp() -> None:
    fix = read(message(time_ns=NOW_NS - nanoseconds(0.3)))
    assert isinstance(fix, Fix)
    sample = fix.sample(nanoseconds(1.0))
    assert sample.device == POSE_FIX
    assert (sample.x_m, sample.y_m) == (1.0, 2.0)
    assert sample.yaw_rad == pytest.approx(0.5)
    assert sample.position_std_m == pytest.approx(0.01)
    assert sample.yaw_std_rad == pytest.approx(0.02)
    assert sample.t_ns == ARRIVAL_NS - nanoseconds(1.0)
    assert sample.t_ns - sample.t_capture_ns == nanoseconds(0.3)


def test_a_fix_without_a_stamp_is_of_its_arrival_and_one_that_claims_too_much_is_not_believed() -> None:
    fix = read(message(time_ns=0, sd_m=1e-9, sd_rad=1e-9))
    assert isinstance(fix, Fix)
    assert fix.age_ns == 0
    assert (fix.position_std_m, fix.yaw_std_rad) == (0.001, 0.001)


def test_the_position_is_as_uncertain_as_along_its_worst_axis() -> None:
    made = message()
    made.pose.covariance = [4e-4, 3e-4, *[0.0] * 4, 3e-4, 4e-4, *[0.0] * 27, 1e-4]
    fix = read(made)
    assert isinstance(fix, Fix)
    assert fix.position_std_m == pytest.approx(math.sqrt(7e-4))


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (message(frame="odom"), "in the frame 'odom' instead of 'map'"),
        (message(math.nan), "not finite"),
        (message(y_m=math.inf), "not finite"),
        (message(sd_m=0.0), "without a covariance"),
        (message(sd_rad=0.0), "without a covariance"),
        (message(sd_m=math.nan), "without a covariance"),
        (message(sd_m=11.0), "less certain"),
        (message(sd_rad=4.0), "less certain"),
        (message(time_ns=NOW_NS - nanoseconds(2.5)), "set the clocks"),
        (message(time_ns=NOW_NS + nanoseconds(0.2)), "set the clocks"),
        (message(time_ns=NOW_NS - nanoseconds(3600.0)), "set the clocks"),
    ],
)
def test_what_is_not_used_says_why(made: PoseWithCovarianceStamped, words: str) -> None:
    found = read(made)
    assert isinstance(found, str)
    assert words in found


def test_an_orientation_that_is_none_is_not_used() -> None:
    made = message()
    made.pose.pose.orientation = Quaternion(w=0.0)
    assert isinstance(read(made), str)


@pytest.mark.slow
def test_fixes_of_a_peer_correct_the_pose_and_the_run_replays(peer: "Node", tmp_path: Path) -> None:
    velocity = peer.writer("cmd_vel", Twist)
    fixes = peer.writer("pose_fix", PoseWithCovarianceStamped)
    transforms = peer.reader("tf", TFMessage, depth=1000)
    frames: set[str] = set()
    errors_m: list[float] = []

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        cycle = 0
        floor = (3.0, -1.0, 0.7)  # where the pose at the start is on the map
        first = None
        while len(errors_m) < 150:
            cycle += 1
            truth = run.truth
            if truth is not None:
                first = first or truth
                x_m, y_m = truth.x_m - first.x_m, truth.y_m - first.y_m
                cosine, sine = math.cos(first.yaw_rad), math.sin(first.yaw_rad)
                x_m, y_m = cosine * x_m + sine * y_m, -sine * x_m + cosine * y_m
                yaw_rad = truth.yaw_rad - first.yaw_rad
                cosine, sine = math.cos(floor[2]), math.sin(floor[2])
                if cycle % 10 == 0:
                    place = floor[0] + cosine * x_m - sine * y_m, floor[1] + sine * x_m + cosine * y_m
                    fixes(message(*place, floor[2] + yaw_rad, time_ns=wall_time_ns()))
                if run.is_driven:
                    errors_m.append(math.hypot(run.pose[0] - x_m, run.pose[1] - y_m))
            velocity(Twist(Vector3(0.15)))
            for found, _, _ in transforms():
                frames.update(each.header.frame_id for each in found.transforms)
            yield

    path = tmp_path / "run.mcap"
    run, _ = drive(hand_config(pose_fixes=True), path, script)
    assert run.is_over
    assert frames == {"odom", "map"}
    assert max(errors_m) < 0.05, max(errors_m)
    cycles = estimates_of(path)
    names = {each["name"] for cycle in cycles for each in cycle["innovations"] if each["accepted"]}
    assert {f"{POSE_FIX} x", f"{POSE_FIX} y", f"{POSE_FIX} yaw"} <= names
    last = cycles[-1]
    # The wheels are wrong by far more.
    assert abs(last["odometry"]["x_m"] - last["estimate"]["x_m"]) > 2 * max(errors_m)
    assert last.get("dead_reckoned") is not None
    assert replays_exactly(path)


def drive_with_a_jump(peer: "Node", path: Path, jump_m: float) -> list[TFMessage]:
    """Drive with fixes of a peer that jump after a while; return all transforms that were sent."""
    velocity = peer.writer("cmd_vel", Twist)
    fixes = peer.writer("pose_fix", PoseWithCovarianceStamped)
    transforms = peer.reader("tf", TFMessage, depth=10_000)
    sent: list[TFMessage] = []

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        cycle, driven, first = 0, 0, None
        while driven < 300:
            cycle, driven = cycle + 1, driven + run.is_driven
            truth = run.truth
            if truth is not None and cycle % 10 == 0:
                first = first or truth
                aside_m = jump_m if driven > 150 else 0.0
                place = truth.x_m - first.x_m, truth.y_m - first.y_m + aside_m
                fixes(message(*place, truth.yaw_rad - first.yaw_rad, time_ns=wall_time_ns()))
            velocity(Twist(Vector3(0.15)))
            sent.extend(found for found, _, _ in transforms())
            yield

    run, _ = drive(hand_config(pose_fixes=True), path, script)
    assert run.is_over
    return sent


def greatest_step_m(sent: list[TFMessage], frame: str) -> float:
    """Return by how much the origin of a transform from a frame moves at most between two messages."""
    places = [
        complex(each.transform.translation.x, each.transform.translation.y)
        for found in sent
        for each in found.transforms
        if each.header.frame_id == frame
    ]
    assert len(places) > 200
    return max(abs(here - before) for before, here in pairwise(places))


@pytest.mark.slow
def test_a_jump_of_the_position_is_in_the_transform_from_map_to_odom_only(
    peer: "Node", tmp_path: Path
) -> None:
    sent = drive_with_a_jump(peer, tmp_path / "run.mcap", 0.5)
    assert greatest_step_m(sent, "odom") < 0.02
    assert greatest_step_m(sent, "map") > 0.3
