"""The doctor listens to talking devices and finds what is wrong; it sends nothing that could turn a wheel."""

import json
import os
import tty
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path
from typing import Literal

import can
import pytest

from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.can_wheels.mapping_file import load_mapping
from drivers.can_wheels.messages import MessageWriter
from drivers.clock import SystemClock
from drivers.errors import ConfigError
from drivers.nmea import encode_sentence
from drivers.robotino_board.codec import REQUEST_SIZE, BoardReply, build_reply, parse_request
from drivers.witmotion.codec import encode_rate
from rover_hil import terminal as printing
from rover_hil.config import Config
from rover_hil.doctor.examination import examine_computer, examine_rover
from rover_hil.doctor.finding import Finding, Level, SystemPaths, problem
from rover_hil.ready.doctor import examine, is_ready, print_findings

LISTEN_S = 0.4
HDM = encode_sentence("HCHDM,12.0,M")
OMNI_ROVER: dict[str, object] = {"kinematics": "omni3", "wheel_radius_m": 0.04, "base_radius_m": 0.125}
SKID_ROVER: dict[str, object] = {"kinematics": "skid_steer_4", "wheel_radius_m": 0.1, "track_m": 0.6}
SILENT_BOARD: dict[str, object] = {"type": "robotino_board", "port": "nowhere/board"}

Devices = dict[str, dict[str, object]]
Talk = Callable[[bytes], bytes]
TerminalMaker = Callable[[float, Talk], "Terminal"]


def make_config(devices: Devices, rover: dict[str, object] | None = None, **roles: object) -> Config:
    return Config.model_validate(
        {
            "schema": "rover-hil-config/1",
            "rover": rover or OMNI_ROVER,
            "limits": {"wheel_speed_rad_s": 4, "wheel_acceleration_rad_s2": 4},
            "loop": {"rate_hz": 50},
            "roles": roles,
            "devices": devices,
        }
    )


class Terminal:
    """The device's end of a pseudo-terminal: says something every period, or answers."""

    def __init__(self, period_s: float, talk: Talk) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self.master, False)
        self.received = b""
        self._period_s = period_s
        self._next_s = 0.0
        self._talk = talk

    def unplug(self) -> None:
        if self.master >= 0:
            os.close(self.master)
        self.master = -1

    def live(self, now_s: float) -> None:
        if self.master < 0:
            return
        try:
            request = os.read(self.master, 4096)
        except BlockingIOError:
            request = b""
        self.received += request
        if now_s >= self._next_s:
            self._next_s = now_s + self._period_s
            os.write(self.master, self._talk(request))


@pytest.fixture
def terminal() -> Iterator[TerminalMaker]:
    terminals: list[Terminal] = []

    def make(period_s: float, talk: Talk) -> Terminal:
        terminals.append(Terminal(period_s, talk))
        return terminals[-1]

    yield make
    for made in terminals:
        made.unplug()


def listen_to(
    config: Config, *talkers: Callable[[float], None], paths: SystemPaths | None = None
) -> list[Finding]:
    def live(now_s: float) -> None:
        for talker in talkers:
            talker(now_s)

    return examine_rover(config, paths or SystemPaths(), SystemClock(), listen_s=LISTEN_S, on_progress=live)


def only(findings: list[Finding], subject: str, check: str) -> Finding:
    (found,) = (finding for finding in findings if (finding.subject, finding.check) == (subject, check))
    return found


class Board:
    """Answers every request, its clock in step with the host's."""

    def __init__(self, board: Literal["EA05", "EA09"] = "EA05") -> None:
        self._board = board

    def __call__(self, request: bytes) -> bytes:
        time_ms = SystemClock().now_ns() // 1_000_000
        zeros = (0, 0, 0)
        reply = build_reply(BoardReply(zeros, zeros, zeros, 800, 50, False, time_ms, self._board))
        return reply * (len(request) // REQUEST_SIZE)


def turn(_: bytes) -> bytes:
    return encode_rate(0.0, 0.0, 0.1)


def test_a_healthy_rover_is_ready_and_its_brakes_are_never_released(terminal: TerminalMaker) -> None:
    board, imu = terminal(0.0, Board()), terminal(0.02, turn)
    devices: Devices = {
        "board": {"type": "robotino_board", "port": board.path, "max_age_s": 2.0},
        "imu": {"type": "witmotion", "port": imu.path, "max_age_s": 2.0},
    }
    findings = listen_to(make_config(devices, wheels="board", gyro="imu"), board.live, imu.live)
    assert {finding.level for finding in findings} == {Level.OK}, findings
    assert 5 < float(only(findings, "imu", "data").what.split(" Hz")[0]) < 51
    assert only(findings, "board", "supply").what == "22.2 V"
    requests = [board.received[i : i + REQUEST_SIZE] for i in range(0, len(board.received), REQUEST_SIZE)]
    assert len(requests) > 3
    for request in map(parse_request, requests):
        assert request.speed_steps == (0, 0, 0)
        assert request.brakes_off == (False, False, False)


@pytest.mark.parametrize(
    ("talk", "change", "words"),
    [
        (lambda _: b"\xf8\x06" * 50, {}, ("undecodable bytes", "baud rate is wrong", "baud_rate")),
        (lambda _: b"\x80\xf8\r\n\x06\xe0", {}, ("framing", "baud rate is wrong", "now 4800")),
        (lambda _: encode_sentence("GPGGA,1"), {}, ("it sends GPGGA", "none with heading", "HDG")),
        (lambda _: b"$HCHDM,12.0,M\r\n", {}, ("checksum", "no checksum", "require_checksum = false")),
        (lambda _: b"", {}, ("nothing arrives", "the device is off", "xxd ")),
        (lambda _: HDM, {"max_age_s": 0.01}, ("required are 100.0 Hz", "too old", "set max_age_s")),
        (lambda _: encode_sentence("HCROT,1.0,A"), {}, ("no heading", "[roles]", "manufacturer's program")),
    ],
)  # fmt: skip
def test_a_bad_compass_is_explained(
    terminal: TerminalMaker, talk: Talk, change: dict[str, object], words: tuple[str, str, str]
) -> None:
    compass = terminal(0.03, talk)
    devices: Devices = {
        "compass": {"type": "nmea_compass", "port": compass.path, **change},
        "board": SILENT_BOARD,
    }
    findings = listen_to(make_config(devices, wheels="board", headings=("compass",)), compass.live)
    finding = only(findings, "compass", "data")
    assert finding.level is Level.PROBLEM
    for word, text in zip(words, (finding.what, finding.cause, finding.fix), strict=True):
        assert word in text


def test_the_other_board_is_named(terminal: TerminalMaker) -> None:
    board = terminal(0.0, Board("EA09"))
    config = make_config({"board": {"type": "robotino_board", "port": board.path}}, wheels="board")
    finding = only(listen_to(config, board.live), "board", "data")
    assert "board_is_EA09" in finding.what
    assert "set board" in finding.fix


def test_a_plug_pulled_while_listening_is_a_problem(terminal: TerminalMaker) -> None:
    imu = terminal(0.02, turn)

    def pull(now_s: float) -> None:
        if now_s > LISTEN_S / 2:
            imu.unplug()

    devices: Devices = {"imu": {"type": "witmotion", "port": imu.path}, "board": SILENT_BOARD}
    findings = listen_to(make_config(devices, wheels="board"), imu.live, pull)
    assert any(finding.what.startswith("the link broke while listening: ") for finding in findings)


def test_a_device_without_a_role_may_be_slow(terminal: TerminalMaker) -> None:
    imu = terminal(0.03, turn)
    devices: Devices = {
        "imu": {"type": "witmotion", "port": imu.path, "max_age_s": 0.01},
        "board": SILENT_BOARD,
    }
    finding = only(listen_to(make_config(devices, wheels="board"), imu.live), "imu", "data")
    assert finding.level is Level.WARNING


@pytest.mark.parametrize(
    ("stream", "device", "rate", "words"),
    [
        ("dual_antenna_default.txt", "nmea_compass", 4800, ("AGRICA, GNGGA, GNRMC", "THS", "GPTHS 0.1")),
        ("vectornav_ins.txt", "vectornav", 115_200, ("VNINS", "has not settled", "$VNWRG,06,14*59")),
    ],
)
def test_reported_stream_without_a_heading_is_refused_with_its_cause(
    terminal: TerminalMaker, shared_data: Path, stream: str, device: str, rate: int, words: tuple[str, ...]
) -> None:
    lines = (shared_data / "field_reports" / "serial" / stream).read_bytes().splitlines(keepends=True)
    waiting = cycle(lines)
    port = terminal(0.005, lambda _: next(waiting))
    devices: Devices = {
        "device": {"type": device, "port": port.path, "baud_rate": rate},
        "board": SILENT_BOARD,
    }
    finding = only(listen_to(make_config(devices, wheels="board"), port.live), "device", "data")
    assert finding.level is Level.PROBLEM
    assert all(word in f"{finding.what} {finding.cause} {finding.fix}" for word in words)


@pytest.mark.parametrize(
    ("stream", "device", "size"),
    [("witmotion_bluetooth.bin", "witmotion", 20), ("speed_log_with_heading.nmea", "nmea_compass", 29)],
)
def test_reported_stream_with_a_heading_is_read(
    terminal: TerminalMaker, shared_data: Path, stream: str, device: str, size: int
) -> None:
    data = (shared_data / "field_reports" / "serial" / stream).read_bytes()
    pieces = cycle(data[place : place + size] for place in range(0, len(data), size))
    port = terminal(0.005, lambda _: next(pieces))
    # The longest age is for the pauses of a loaded machine.
    stream_device: dict[str, object] = {"type": device, "port": port.path, "max_age_s": 10.0}
    devices: Devices = {"device": stream_device, "board": SILENT_BOARD}
    findings = listen_to(make_config(devices, wheels="board"), port.live)
    assert not [each for each in findings if each.subject == "device" and each.level is Level.PROBLEM]
    assert "rejected: none" in only(findings, "device", "data").what


def test_a_wheel_missing_on_the_can_bus_is_named_and_nothing_is_sent() -> None:
    channel = "doctor-test"
    bus_description = load_mapping("generic_wheel")
    names = ("Wheel0_State", "Wheel1_State", "Wheel2_State", "Drive_Status")
    writers = [MessageWriter(bus_description.message(n), bus_description.protection(n)) for n in names]
    stranger = pack_can_frame(CanFrame(0x7A1, b"\x01"))
    devices: Devices = {
        "wheels": {
            "type": "can_wheels",
            "interface": "virtual",
            "channel": channel,
            "mapping": "generic_wheel",
        }
    }
    with can.Bus(channel, interface="virtual") as bus:

        def drive(_: float) -> None:
            for payload in (*(writer.write({}) for writer in writers), stranger):
                frame = unpack_can_frame(payload)
                assert frame is not None
                bus.send(can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False))

        findings = listen_to(make_config(devices, SKID_ROVER, wheels="wheels"), drive)
        assert bus.recv(0) is None
    missing = next(finding for finding in findings if finding.what.startswith("never came"))
    assert "Wheel3_State" in missing.what
    assert "Wheel2_State" not in missing.what
    assert missing.what.endswith("; on the bus but not in the mapping: 0x7A1")
    lacking = next(finding for finding in findings if finding.what.startswith("samples arrive, but"))
    assert lacking.what == "samples arrive, but no position of wheel 3"
    assert any("Wheel0_State" in finding.what and finding.level is Level.OK for finding in findings)


def test_missing_frames_folder_is_explained(tmp_path: Path) -> None:
    camera: dict[str, object] = {"type": "camera", "source": "live_folder", "path": str(tmp_path / "frames")}
    camera |= {"width": 64, "height": 48, "frame_rate_hz": 5}
    config = make_config({"camera": camera, "board": SILENT_BOARD}, wheels="board")
    finding = only(listen_to(config), "camera", "port")
    assert finding.level is Level.PROBLEM
    assert "rover-hil simulate" in finding.fix


def test_this_computer_is_well_installed() -> None:
    findings = examine_computer(SystemPaths())
    assert [finding.level for finding in findings if finding.check == "installation"] == [Level.OK]


def test_json_names_every_finding_and_a_missing_port_is_exit_code_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert examine("robotino", as_json=True) == 1
    result = json.loads(capsys.readouterr().out)
    assert result["verdict"] == "needs a fix"
    bad = [finding for finding in result["findings"] if finding["level"] == "problem"]
    assert {finding["subject"] for finding in bad} == {"board", "imu"}
    assert all(finding["cause"] and "rover-hil simulate" in finding["fix"] for finding in bad)


def test_a_wrong_configuration_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no configuration"):
        examine(str(tmp_path / "missing.toml"), as_json=False)


def test_advice_is_printed_whole_brackets_included(capsys: pytest.CaptureFixture[str]) -> None:
    fix = "in [devices.imu] set port = " + "/dev/serial/by-id/" + "x" * 100
    findings = [problem("serial port", "imu", "what", "why", fix)]
    console = printing.Terminal()
    console.width = 60
    print_findings(findings, console)
    output = capsys.readouterr().out
    assert f"fix:   {fix}\n" in output
    assert "1 to be fixed" in output
    assert not is_ready(findings)
