"""The record of each cycle as a line of JSON over UDP."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from drivers.clock import PacedClock, wall_time_ns
from drivers.errors import ConfigError
from rover_hil.config import load_config
from rover_hil.connect.json_lines import JsonLines
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import ESTIMATE, ESTIMATE_SHAPE
from rover_hil.run.driving import run_virtual
from tests.rover_hil.command import Command, assert_one_sentence

READER = Path(__file__).parents[3] / "docs" / "examples" / "read_odometry.py"


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        line.settimeout(60.0)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        yield line


def test_each_cycle_sends_a_line_with_the_estimate_of_the_log(
    receiver: socket.socket, tmp_path: Path
) -> None:
    config = load_config("robotino")
    clock = PacedClock()
    lines = JsonLines(f"localhost:{receiver.getsockname()[1]}", config, lambda: clock.offset_ns)
    before_ns = wall_time_ns()
    result = run_virtual(config, tmp_path / "run.mcap", 0.6, None, clock=clock, operator=lines)
    lines.close()
    received = [receiver.recv(65_536) for _ in range(result.cycles)]
    assert all(line.endswith(b"}\n") and line.count(b"\n") == 1 for line in received)
    log = LogReader(tmp_path / "run.mcap")
    estimates = [
        log.parse(each, ESTIMATE_SHAPE)["estimate"] for each in log.messages() if each.topic == ESTIMATE
    ]
    newer = 0
    for line, estimate in zip(received, estimates, strict=True):
        record = json.loads(line)
        assert before_ns <= record["time_ns"] <= wall_time_ns()
        pose = record["odometry"]
        if pose is not None:
            newer += 1
            assert pose["x_m"] == pytest.approx(estimate["x_m"], abs=1e-6)
            assert pose["velocity_variance"][0] > 0.0
    assert newer > 0.8 * result.cycles
    states = [record["status"] for record in map(json.loads, received) if record["status"]]
    assert states[0][0]["values"]["mode"] == "settling"
    assert {each["name"] for each in states[0]} == {"run", "board", "imu"}


def test_nobody_who_listens_hinders_no_run(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with closing(JsonLines(str(port), load_config("robotino"))) as lines:
        result = run_virtual(load_config("robotino"), tmp_path / "run.mcap", 0.5, None, operator=lines)
    assert result.cycles == 25


@pytest.mark.parametrize(
    "target", ["", "localhost", "localhost:", "localhost:0", "localhost:70000", "a:b", "-1"]
)
def test_a_target_that_is_none_is_said_so(target: str) -> None:
    with pytest.raises(ConfigError, match="HOST:PORT"):
        JsonLines(target, load_config("robotino"))


def test_simulated_time_must_pass_like_real_time(command: Command, tmp_path: Path) -> None:
    assert command("run", "robotino", "--virtual", "--odometry-to", "5005", "--out", str(tmp_path / "a")) == 2
    assert_one_sentence(command.error, "--realtime")
    assert not (tmp_path / "a").exists()


@pytest.mark.slow
def test_the_example_prints_where_the_rover_is(command: Command, tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-u", READER], stdout=subprocess.PIPE, text=True) as reader:
        target = ["--virtual", "--realtime", "--odometry-to", "localhost:5005", "--duration", "1.5"]
        assert command("run", "robotino", *target, "--out", str(tmp_path / "run")) == 1
        assert reader.stdout is not None
        assert reader.stdout.readline().startswith("x 0.000 m, y ")
        reader.kill()
