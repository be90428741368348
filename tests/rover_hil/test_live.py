"""Viewers get the records of the log as they are made, and never delay it."""

import json
import socket
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import ConfigError
from rover_hil.config import Config, load_config
from rover_hil.live.server import LiveServer
from rover_hil.recording.reader import LogReader
from rover_hil.recording.writer import LogWriter
from rover_hil.run.driving import run_virtual
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.viewer import Viewer

START_NS = 1_000_000_000
CONFIG = b'{"a": 1}'


def test_a_viewer_gets_the_channels_and_records_of_the_log(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LiveServer(port=0) as server:
        viewer = Viewer(server.port)
        with LogWriter(path, START_NS, CONFIG, {}, "virtual", mirror=server.publish) as log:
            log.write_json("/cycle", START_NS, {"late_ns": 1, "work_ns": 2})
            told = viewer.read()
            while not (isinstance(told, dict) and told["op"] == "advertise"):
                told = viewer.read()
            (channel,) = told["channels"]
            assert (channel["topic"], channel["encoding"], channel["schemaName"]) == (
                "/cycle", "json", "rover_hil.Cycle"
            )  # fmt: skip
            assert set(json.loads(channel["schema"])["properties"]) == {"late_ns", "work_ns"}
            viewer.subscribe({channel["id"]: 7})
            message = None
            clock = SystemClock()
            for index in range(2000):
                log.write_json("/cycle", START_NS + index, {"late_ns": 3, "work_ns": index})
                if index == 100:
                    message = viewer.read()
                    # The first record of the log may come late: after the viewer asked for the channel.
                    while not isinstance(message, tuple) or json.loads(message[2])["late_ns"] == 1:
                        message = viewer.read()
                    break
                clock.sleep_until(clock.now_ns() + 10_000_000)
        viewer.close()
    assert isinstance(message, tuple)
    subscription, time_ns, data = message
    assert subscription == 7
    assert json.loads(data)["late_ns"] == 3
    assert time_ns > LogReader(path).wall_offset_ns


def test_a_viewer_that_never_reads_stops_nothing(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    count = 3000
    with LiveServer(port=0) as server:
        viewer = Viewer(server.port)
        with LogWriter(path, START_NS, CONFIG, {}, "virtual", mirror=server.publish) as log:
            log.write_json("/noise", START_NS, {})
            told = viewer.read()
            while not (isinstance(told, dict) and told["op"] == "advertise"):
                told = viewer.read()
            viewer.subscribe({told["channels"][0]["id"]: 1})
            noise = np.random.default_rng(1).bytes(5000).hex()
            for index in range(count):
                log.write_json("/noise", START_NS + index, {"text": noise[index:] + noise[:index]})
        viewer.close()
    log_read = LogReader(path)
    assert sum(1 for _ in log_read.messages()) == count + 1
    assert log_read.is_complete


def test_a_replay_streams_its_log(command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    table = load_config("robotino").model_dump(by_alias=True)
    table["safety"]["settle_s"] = 0.1
    run_virtual(Config.model_validate(table), tmp_path / "run.mcap", 0.6, None)
    published: list[str] = []
    monkeypatch.setattr(LiveServer, "publish", lambda self, topic, time_ns, data: published.append(topic))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    assert command("replay", str(tmp_path / "run.mcap"), "--live", "--live-port", str(port)) == 0
    assert f"live: open ws://127.0.0.1:{port}" in command.error
    assert published.count("/estimate") == 30


def test_a_port_that_is_taken_is_said_so(command: Command) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"cannot open port {port} for viewers"):
            LiveServer(port)
        arguments = ("run", "robotino", "--virtual", "--live", "--live-port", str(port), "--duration", "1")
        assert command(*arguments, "--out", "never") == 2
        assert_one_sentence(command.error, "--live-port")
    assert not Path("never").exists()
