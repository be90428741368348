"""What is wrong with [ros2] is said before anything moves: one sentence with the fix."""

import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from rover_hil.config import load_config, ros2_joints
from rover_hil.config.ros2_settings import DOMAIN_VARIABLE, Ros2Settings
from rover_hil.doctor.finding import Finding, Level
from rover_hil.doctor.host.ros2 import check_ros2
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.connect.by_hand import own_domain

SHIPPED = Path(load_config.__code__.co_filename).parent / "shipped" / "configs"


def other_domain() -> int:
    """Return a domain in which no peer of the tests is."""
    return 1 + (own_domain() + 49) % 100


def written(folder: Path, lines: str, name: str = "robotino", *, by_hand: bool = False) -> str:
    """Write a shipped configuration with a section [ros2]; return its path."""
    text = (SHIPPED / f"{name}.toml").read_text()
    if by_hand:
        start, end = text.index("[mission]"), text.index("# Wheel slip is read")
        text = f'{text[:start]}[mission]\ntype = "by_hand"\n\n{text[end:]}'
    path = folder / "mine.toml"
    path.write_text(f"{text}\n[ros2]\n{lines}\n")
    return str(path)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("domain = 102", "ros2.domain"),
        ("commands = true", "mission.type = 'by_hand'"),
        ('joint_names = ["a", "b"]', "give 3 different names, of 3 wheels"),
        ('joint_names = ["a", "b", "b"]', "give 3 different names"),
        ('odom_frame = "/odom"', "without one in front"),
        ('namespace = "a b"', "is not a name of ROS"),
        ("command_timeout_s = 3", "command_timeout_s"),
        ('interface = "lo\'/><x"', "is not a network interface"),
        ('peers = ["<a>"]', "is not a network interface, a host or an address"),
    ],
)
def test_check_says_what_is_wrong(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: str, words: str
) -> None:
    monkeypatch.setattr(ros2_joints, "find_spec", lambda name: name)  # installed or not
    assert command("check", written(tmp_path, lines)) == 1
    assert words in command.out
    assert "1 mistake" in command.out


def test_a_steered_rover_has_joints_of_its_steering(tmp_path: Path) -> None:
    rover = load_config("el-dorado-crab").rover
    names = ros2_joints.joint_names(rover, Ros2Settings())
    assert names[0] == "wheel_0_joint"
    assert "steering_3_joint" in names


def test_check_says_how_to_install_the_library(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros2_joints, "find_spec", lambda name: None)
    for name, code in (("check", 1), ("doctor", 2)):
        assert command(name, written(tmp_path, "")) == code
        assert "pip install rover-hil[ros2]" in command.out + command.error
        assert "ARM" in command.out + command.error


def test_a_mission_by_hand_needs_someone_who_drives(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros2_joints, "find_spec", lambda name: name)
    assert command("run", written(tmp_path, "commands = false", by_hand=True), "--virtual") == 2
    assert_one_sentence(command.error, "ros2.commands = true")


def test_commands_need_real_time(command: Command, tmp_path: Path) -> None:
    pytest.importorskip("cyclonedds", reason="needs the extra `ros2`")
    assert command("run", written(tmp_path, "commands = true", by_hand=True), "--virtual") == 2
    assert_one_sentence(command.error, "--realtime")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lines", "variable", "words"),
    [
        ('interface = "none0"', "", ("no network interface 'none0'", "lo")),
        ("", "often", (DOMAIN_VARIABLE, "0 to 101")),
    ],
)
def test_run_and_doctor_name_a_wrong_interface_or_domain(
    command: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    lines: str,
    variable: str,
    words: tuple[str, ...],
) -> None:
    pytest.importorskip("cyclonedds", reason="needs the extra `ros2`")
    monkeypatch.setenv(DOMAIN_VARIABLE, variable)
    path = written(tmp_path, lines)
    assert command("run", path, "--virtual", "--realtime", "--out", str(tmp_path / "run")) == 2
    assert_one_sentence(command.error, *words)
    assert not (tmp_path / "run").exists()
    (finding,) = check_ros2(load_config(path).ros2)
    assert finding.level is Level.PROBLEM
    assert all(word in f"{finding.what} {finding.fix}" for word in words)


SENDERS = """
import sys, time
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2 import messages
from rover_hil.connect.ros2.node import Node

domain = int(sys.argv[1])
node = Node(Ros2Settings(domain=domain))
writers = [node.writer(topic, getattr(messages, kind)) for topic, kind in zip(sys.argv[2::2], sys.argv[3::2])]
print("there", flush=True)
time.sleep(600)
"""


def seen_beside(*arguments: str, **keys: object) -> list[Finding]:
    """Return what the doctor finds beside a program with some writers."""
    pytest.importorskip("cyclonedds", reason="needs the extra `ros2`")
    domain = other_domain()
    line = [sys.executable, "-c", SENDERS, str(domain), *arguments]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "there\n"
        try:
            return check_ros2(Ros2Settings.model_validate({"domain": domain, **keys}))
        finally:
            other.kill()


@pytest.mark.slow
def test_the_doctor_sees_a_foreign_type_another_rover_and_two_commanders() -> None:
    findings = seen_beside("cmd_vel", "Bool", "odom", "Odometry", "cmd_vel", "Twist", commands=True)
    assert [(each.level, each.subject) for each in findings] == [
        (Level.PROBLEM, "/cmd_vel"),
        (Level.PROBLEM, "/odom"),
        (Level.WARNING, "/cmd_vel"),
    ]
    assert "std_msgs/msg/Bool" in findings[0].what
    assert "geometry_msgs/msg/TwistStamped" in findings[0].cause


@pytest.mark.slow
def test_the_doctor_finds_nothing_wrong_beside_a_commander() -> None:
    (finding,) = seen_beside("cmd_vel", "TwistStamped", "emergency_stop", "Bool", commands=True)
    assert finding.level is Level.OK


@pytest.mark.slow
def test_a_full_domain_is_named() -> None:
    pytest.importorskip("cyclonedds", reason="needs the extra `ros2`")
    domain = other_domain()
    with ExitStack() as resources:
        # The ports of all participants that a domain has room for on one computer.
        for number in range(33):
            port = resources.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            port.bind(("", 7400 + 250 * domain + 10 + 2 * number))
        (finding,) = check_ros2(Ros2Settings(domain=domain))
    assert finding.level is Level.PROBLEM
    assert f"no place in domain {domain}" in finding.what
    assert "choose another domain" in finding.fix
