"""With the interface `lo` nothing from another computer reaches the sockets of ROS 2."""

import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.errors import ConfigError

pytest.importorskip("cyclonedds", reason="needs the extra `ros2`")
from rover_hil.connect.ros2.node import Node, bind_to_loopback, datagram_sockets

pytestmark = pytest.mark.slow

TWO_COMPUTERS = ("unshare", "--user", "--map-root-user", "--net")
CABLE = """
import socket, subprocess, sys
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2.messages import Twist
from rover_hil.connect.ros2.node import Node

SENDER = '''
import socket, sys
for port in map(int, sys.argv[1:]):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.settimeout(1.0)
        sender.connect(("10.99.0.1", port))
        sender.send(b"RTPS")
        try:
            sender.recv(1)
        except ConnectionRefusedError:
            print(port, "refused")
        except TimeoutError:
            print(port, "taken")
'''

def run(*words):
    return subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout

another = ["unshare", "--net", "sh", "-c", "echo there; exec sleep 600"]
with subprocess.Popen(another, stdout=subprocess.PIPE) as other:
    other.stdout.readline()
    enter = ("nsenter", "--target", str(other.pid), "--net")
    run("ip", "link", "set", "lo", "up")
    run("ip", "link", "add", "cable", "type", "veth", "peer", "name", "cable", "netns", str(other.pid))
    run("ip", "addr", "add", "10.99.0.1/24", "dev", "cable")
    run("ip", "link", "set", "cable", "up")
    run(*enter, "ip", "addr", "add", "10.99.0.2/24", "dev", "cable")
    run(*enter, "ip", "link", "set", "cable", "up")
    node = Node(Ros2Settings(domain=0))
    take = node.reader("cmd_vel", Twist)
    plain = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    plain.bind(("", 9000))
    print(run(*enter, sys.executable, "-c", SENDER, "7400", "7401", "7410", "7411", "9000"), end="")
    other.kill()
"""


def can_lay_a_cable() -> bool:
    if not all(map(shutil.which, ("unshare", "nsenter", "ip"))):
        return False
    line = [*TWO_COMPUTERS, "ip", "link", "add", "cable", "type", "veth", "peer", "name", "other"]
    return subprocess.run(line, check=False, capture_output=True).returncode == 0


def test_the_sockets_are_bound_to_the_loopback(peer: Node) -> None:
    bound = []
    for number in datagram_sockets().values():
        with socket.socket(fileno=os.dup(number)) as each:
            bound.append(each.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, 16).rstrip(b"\0"))
    assert bound.count(b"lo") >= 5


def test_a_packet_of_another_computer_reaches_no_socket() -> None:
    if not can_lay_a_cable():
        pytest.skip("needs network namespaces")
    line = [*TWO_COMPUTERS, sys.executable, "-c", CABLE]
    done = subprocess.run(line, check=True, stdout=subprocess.PIPE, text=True)
    refused = [f"{port} refused" for port in (7400, 7401, 7410, 7411)]
    assert done.stdout.splitlines() == [*refused, "9000 taken"]


def test_a_kernel_that_does_not_bind_to_the_loopback_is_reported(tmp_path: Path) -> None:
    with (tmp_path / "file").open("w") as no_socket, pytest.raises(ConfigError, match="CAP_NET_RAW"):
        bind_to_loopback([no_socket.fileno()])
