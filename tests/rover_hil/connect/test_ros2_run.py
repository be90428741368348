"""Runs over ROS 2 in real time, with a peer that is another participant of DDS."""

import operator
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from controllers.operator import OperatorInput
from drivers.clock import SystemClock, nanoseconds, seconds
from rover_hil.connect.ros2.connection import ENDED, Ros2Connection
from rover_hil.connect.ros2.messages import (
    Bool,
    DiagnosticArray,
    Imu,
    JointState,
    Odometry,
    TFMessage,
    Twist,
    TwistStamped,
    Vector3,
)
from rover_hil.run.executive import End
from tests.rover_hil.command import started
from tests.rover_hil.connect.by_hand import (
    Scripted,
    Steps,
    drive,
    estimates_of,
    hand_config,
    own_domain,
    replays_exactly,
)
from tests.rover_hil.connect.test_ros2_checks import written

pytest.importorskip("cyclonedds", reason="needs the extra `ros2`")
from rover_hil.connect.ros2.node import Node

pytestmark = pytest.mark.slow

AHEAD = Twist(Vector3(0.2), Vector3(z=0.1))
REST = Twist()


def test_a_planner_drives_gets_every_estimate_and_the_run_replays(peer: Node, tmp_path: Path) -> None:
    velocity = peer.writer("cmd_vel", Twist)
    readers = {
        "odom": peer.reader("odom", Odometry, depth=1000),
        "tf": peer.reader("tf", TFMessage, depth=1000),
        "joints": peer.reader("joint_states", JointState, depth=1000),
        "imu": peer.reader("imu/data", Imu, depth=1000),
        "diagnostics": peer.reader("diagnostics", DiagnosticArray, depth=100),
    }
    got: dict[str, list[object]] = {name: [] for name in readers}

    def take() -> None:
        for name, read in readers.items():
            got[name] += [message for message, _, _ in read()]

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        yield from run.wait(lambda: run.is_driven, lambda: velocity(AHEAD))
        for _ in range(100):
            velocity(AHEAD)
            take()
            yield
        yield from run.stay(60, take)
        assert not run.is_driven
        yield from run.stay(5, take)

    run, result = drive(hand_config(), tmp_path / "run.mcap", script)
    take()
    assert run.is_over
    assert result.end is End.STOPPED_BY_USER
    logged = {
        (round(each["estimate"]["x_m"], 7), round(each["estimate"]["y_m"], 7))
        for each in estimates_of(tmp_path / "run.mcap")
    }
    poses = [each for each in got["odom"] if isinstance(each, Odometry)]
    assert len(poses) > 100
    places = [(each.pose.pose.position.x, each.pose.pose.position.y) for each in poses]
    assert {(round(x, 7), round(y, 7)) for x, y in places} <= logged
    assert places[-1][0] > 0.1
    stamps = [each.header.stamp.time_ns for each in poses]
    assert stamps == sorted(set(stamps))
    transforms = [each.transforms[0] for each in got["tf"] if isinstance(each, TFMessage)]
    by_stamp = {each.header.stamp.time_ns: each for each in transforms}
    assert all(
        by_stamp[each.header.stamp.time_ns].transform.translation.x == each.pose.pose.position.x
        for each in poses
        if each.header.stamp.time_ns in by_stamp
    )
    joints = got["joints"][-1]
    assert isinstance(joints, JointState)
    assert list(joints.name) == ["wheel_0_joint", "wheel_1_joint", "wheel_2_joint"]
    assert got["imu"]
    states = [each for each in got["diagnostics"] if isinstance(each, DiagnosticArray)]
    assert {each.name for each in states[-1].status} == {
        f"rover_hil: {part}" for part in ("run", "board", "imu")
    }
    assert replays_exactly(tmp_path / "run.mcap")


def test_a_stamped_command_drives_as_well(peer: Node, tmp_path: Path) -> None:
    velocity = peer.writer("cmd_vel", TwistStamped)

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        yield from run.wait(lambda: run.is_driven, lambda: velocity(TwistStamped(twist=AHEAD)))

    run, _ = drive(hand_config(), tmp_path / "run.mcap", script)
    assert run.is_over


def test_nobody_drives_where_commands_are_off(peer: Node, tmp_path: Path) -> None:
    velocity = peer.writer("cmd_vel", Twist)

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        yield from run.wait(lambda: run.mode == "running", lambda: velocity(AHEAD))
        for _ in range(50):
            velocity(AHEAD)
            assert not run.is_driven
            yield

    run, _ = drive(hand_config(commands=False), tmp_path / "run.mcap", script)
    assert run.is_over


def test_a_sender_who_follows_each_command_with_his_own_does_not_take_the_rover_over(
    peer: Node, tmp_path: Path
) -> None:
    velocity, rival = peer.writer("cmd_vel", Twist), peer.writer("cmd_vel", Twist)
    back = Twist(Vector3(-0.2))

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        yield from run.wait(lambda: run.is_driven, lambda: velocity(AHEAD))
        ahead = run.set_rad_s
        for cycle in range(300):
            if cycle % 5 == 0:
                velocity(AHEAD)
                rival(back)
            yield
            assert sum(map(operator.mul, run.set_rad_s, ahead)) >= 0.0

    run, _ = drive(hand_config(), tmp_path / "run.mcap", script)
    assert run.is_over


def test_the_rover_rests_after_the_timeout_of_a_silent_commander(peer: Node, tmp_path: Path) -> None:
    velocity = peer.writer("cmd_vel", Twist)
    rested_s: list[float] = []

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        yield from run.wait(lambda: run.is_driven, lambda: velocity(AHEAD))
        velocity(AHEAD)
        sent_ns = SystemClock().now_ns()
        yield from run.wait(lambda: not run.is_driven)
        rested_s.append(seconds(run.now_ns - sent_ns))

    run, _ = drive(hand_config(command_timeout_s=0.3), tmp_path / "run.mcap", script)
    assert run.is_over
    assert 0.25 < rested_s[0] < 60.0  # the upper bar needs a machine of its own: benchmarks/ros2


@pytest.mark.parametrize(("number", "is_final"), [(signal.SIGSTOP, False), (signal.SIGKILL, True)])
def test_a_process_that_hangs_or_dies_stops_the_run(
    peer: Node, tmp_path: Path, number: signal.Signals, *, is_final: bool
) -> None:
    velocity = peer.writer("cmd_vel", Twist)
    stopped_s: list[float] = []

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        yield from run.wait(lambda: run.is_driven, lambda: velocity(AHEAD))
        assert connection.pid is not None
        os.kill(connection.pid, number)
        struck_ns = SystemClock().now_ns()
        yield from run.wait(lambda: not run.is_driven, lambda: velocity(AHEAD))
        stopped_s.append(seconds(run.now_ns - struck_ns))
        if not is_final:
            assert "no heartbeat" in run.reason
            yield from run.stay(30, lambda: velocity(AHEAD))
            os.kill(connection.pid, signal.SIGCONT)
            yield from run.wait(lambda: run.mode == "running" and run.is_driven, lambda: velocity(AHEAD))
        yield from run.stay(1000)

    def stop_after_motion(run: Scripted, connection: Ros2Connection) -> Steps:
        steps = script(run, connection)
        while not (stopped_s and not is_final and run.mode == "running" and run.is_driven):
            if next(steps, run) is run:
                return
            yield

    _, result = drive(hand_config(), tmp_path / "run.mcap", stop_after_motion)
    if is_final:
        assert (result.end, result.reason) == (End.TERMINATED, ENDED)
    assert not stopped_s or stopped_s[0] < 60.0
    assert replays_exactly(tmp_path / "run.mcap")


@pytest.mark.parametrize("is_late_joiner", [False, True])
def test_an_emergency_stop_latches_also_before_the_run(
    peer: Node, tmp_path: Path, *, is_late_joiner: bool
) -> None:
    velocity = peer.writer("cmd_vel", Twist)
    # A writer as of a program that sends once, and is there before the run; or an ordinary one.
    press = peer.writer("emergency_stop", Bool, latched=is_late_joiner)
    if is_late_joiner:
        press(Bool(True))

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        if not is_late_joiner:
            yield from run.wait(lambda: run.is_driven, lambda: velocity(AHEAD))
            press(Bool(True))
        yield from run.wait(lambda: "emergency_stop" in run.reason, lambda: velocity(AHEAD))
        for _ in range(60):
            velocity(AHEAD)
            yield
            assert not run.is_driven
        press(Bool(False))
        yield from run.wait(lambda: run.mode == "running", lambda: velocity(AHEAD))
        for _ in range(20):
            velocity(AHEAD)
            yield
            assert not run.is_driven
        yield from run.stay(5, lambda: velocity(REST))
        yield from run.wait(lambda: run.is_driven, lambda: velocity(AHEAD))

    run, _ = drive(hand_config(), tmp_path / "run.mcap", script)
    assert run.is_over
    assert replays_exactly(tmp_path / "run.mcap")


PRESSER = """
import sys, time
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2.messages import Bool
from rover_hil.connect.ros2.node import Node

node = Node(Ros2Settings(domain=int(sys.argv[1])))
press = node.writer("emergency_stop", Bool)
while True:
    press(Bool(True))
    time.sleep(0.02)
"""


def test_a_writer_of_a_stop_that_disappears_releases_nothing_and_the_page_does(
    peer: Node, tmp_path: Path
) -> None:
    velocity = peer.writer("cmd_vel", Twist)
    release = peer.writer("emergency_stop", Bool)

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        yield from run.wait(lambda: run.is_driven, lambda: velocity(AHEAD))
        with subprocess.Popen([sys.executable, "-c", PRESSER, str(own_domain())]) as presser:
            yield from run.wait(lambda: "emergency_stop" in run.reason, lambda: velocity(AHEAD))
            presser.kill()
        for _ in range(100):
            velocity(REST)
            velocity(AHEAD)
            release(Bool(False))
            yield
            assert "emergency_stop" in run.reason
        run.wants = OperatorInput(is_paused=True)
        yield from run.stay(5, lambda: velocity(AHEAD))
        assert "emergency_stop" in run.reason
        run.wants = OperatorInput(is_paused=False)
        yield from run.wait(lambda: run.mode == "running", lambda: velocity(AHEAD))
        for _ in range(20):
            velocity(AHEAD)
            yield
            assert not run.is_driven
        yield from run.stay(5, lambda: velocity(REST))
        yield from run.wait(lambda: run.is_driven, lambda: velocity(AHEAD))

    run, _ = drive(hand_config(), tmp_path / "run.mcap", script)
    assert run.is_over
    assert replays_exactly(tmp_path / "run.mcap")


def test_a_run_on_the_ports_of_a_served_rover_is_driven_as_well(peer: Node, tmp_path: Path) -> None:
    written(tmp_path, f"domain = {own_domain()}\ncommands = true", by_hand=True)
    velocity, odometry = peer.writer("cmd_vel", Twist), peer.reader("odom", Odometry)
    clock, x_m = SystemClock(), 0.0
    with started(tmp_path, "simulate", "mine.toml") as rover:
        assert rover.stdout is not None
        assert any("run speaks ROS 2" in each for each in iter(rover.stdout.readline, ""))
        with started(tmp_path, "run", "mine.toml", "--out", "run") as run:
            deadline_ns = clock.now_ns() + nanoseconds(90.0)
            while x_m < 0.05 and clock.now_ns() < deadline_ns and run.poll() is None:
                velocity(AHEAD)
                clock.sleep_until(clock.now_ns() + nanoseconds(0.05))
                x_m = max([x_m, *(message.pose.pose.position.x for message, _, _ in odometry())])
            run.send_signal(signal.SIGINT)
            output, _ = run.communicate()
    assert run.returncode == 0, output
    assert x_m >= 0.05
    assert replays_exactly(tmp_path / "run" / "run.mcap")
