"""The served ports, each seen with what a host opens it with: pyserial, python-can, our own links."""

import os
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera.settings import CameraSettings
from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.clock import SystemClock
from drivers.errors import NotConnectedError
from drivers.link import CameraImage
from drivers.samples import FrameSample, LinkSample
from sim_backends.serving.can_bus_port import CanBusPort
from sim_backends.serving.frame_port import FramePort
from sim_backends.serving.port import Port
from sim_backends.serving.pty_port import PtyPort
from sim_backends.serving.slcan_port import SlcanPort

# Pseudo-terminals


@pytest.fixture
def pty(tmp_path: Path) -> Iterator[PtyPort]:
    port = PtyPort(str(tmp_path / "ports" / "compass"))
    port.open()
    yield port
    port.close()


def test_pyserial_and_the_port_hear_each_other(pty: PtyPort) -> None:
    every_byte = bytes(range(256))
    assert not pty.has_listener()
    with serial.Serial(pty.where, 4800, timeout=5.0, exclusive=True) as host:
        assert pty.has_listener()
        assert pty.write(every_byte)
        assert host.read(256) == every_byte
        host.write(every_byte)
        assert pty.read() == [every_byte]
        assert pty.read() == []
    assert not pty.has_listener()
    assert pty.read() == []


def test_bytes_pass_unchanged_even_to_a_host_that_sets_nothing(pty: PtyPort) -> None:
    host = os.open(pty.where, os.O_RDWR | os.O_NOCTTY)
    pty.write(b"\x03\r\n\x04\x11")
    assert os.read(host, 100) == b"\x03\r\n\x04\x11"
    assert pty.read() == []  # no echo
    os.close(host)


def test_what_the_host_does_not_read_in_time_is_lost(pty: PtyPort) -> None:
    with serial.Serial(pty.where, timeout=1.0) as host:
        taken = [pty.write(bytes(1000)) for _ in range(100)]
        assert taken[0]
        assert not taken[-1]
        complete = taken.count(True) * 1000
        assert len(host.read(complete)) == complete  # a payload cut short counts as lost
        host.reset_input_buffer()
        assert pty.write(b"again")
        assert host.read(5) == b"again"


def test_a_pulled_plug_breaks_the_handle_and_the_path_comes_back(pty: PtyPort) -> None:
    with serial.Serial(pty.where, timeout=5.0) as host:
        pty.close()
        with pytest.raises(serial.SerialException):
            host.read(1)
        assert not Path(pty.where).is_symlink()
        assert (pty.read(), pty.has_listener(), pty.write(b"x")) == ([], False, False)
        pty.open()
        with serial.Serial(pty.where, timeout=5.0) as host_again:
            pty.write(b"x")
            assert host_again.read(1) == b"x"


def test_only_a_dangling_link_of_a_dead_simulator_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "port"
    path.symlink_to("/dev/pts/999999")
    port = PtyPort(str(path))
    port.open()
    assert os.path.exists(path)  # noqa: PTH110 - follows the link
    port.close()
    assert not path.is_symlink()


@pytest.mark.parametrize("target", ["/dev/null", "nowhere", "served"])
def test_nothing_else_is_replaced(tmp_path: Path, target: str, pty: PtyPort) -> None:
    path = tmp_path / "port"
    path.symlink_to(pty.where if target == "served" else target)
    before = path.readlink()
    with pytest.raises(NotConnectedError, match="the path is taken"):
        PtyPort(str(path)).open()
    assert path.readlink() == before


def test_a_file_is_not_replaced_nor_is_the_link_of_a_running_simulator(tmp_path: Path, pty: PtyPort) -> None:
    path = tmp_path / "port"
    path.write_text("precious")
    for taken in (path, Path(pty.where)):
        with pytest.raises(NotConnectedError, match="the path is taken"):
            PtyPort(str(taken)).open()
    assert path.read_text() == "precious"
    assert pty.write(b"") or not pty.has_listener()


def test_what_has_taken_the_place_of_the_link_stays(pty: PtyPort) -> None:
    path = Path(pty.where)
    path.unlink()
    path.write_text("precious")
    pty.close()
    assert path.read_text() == "precious"


def test_a_path_that_cannot_be_made_leaves_no_handle(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    with pytest.raises(NotConnectedError, match="cannot serve a serial port"):
        PtyPort(str(tmp_path / "file" / "port")).open()
    assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208


# CAN

FRAMES = [
    CanFrame(0x123, b"\x01\xfe"),
    CanFrame(0x1ABCDE0F, bytes(range(8)), is_extended=True),
    CanFrame(0x7FF, b""),
    CanFrame(0x055, bytes(4), is_remote=True),
    CanFrame(0x1FFFFFFF, bytes(8), is_extended=True, is_remote=True),
]


def as_message(frame: CanFrame) -> can.Message:
    return can.Message(
        arbitration_id=frame.can_id,
        data=None if frame.is_remote else frame.data,
        dlc=len(frame.data),
        is_extended_id=frame.is_extended,
        is_remote_frame=frame.is_remote,
    )


def check_both_directions(port: Port[bytes], bus: can.BusABC) -> None:
    for frame in FRAMES:
        message = as_message(frame)
        bus.send(message)
        assert [unpack_can_frame(payload) for payload in port.read()] == [frame]
        assert port.write(pack_can_frame(frame))
        received = bus.recv(5.0)
        assert received is not None
        assert received.equals(message, timestamp_delta=None, check_channel=False, check_direction=False)


def slcan_bus(port: SlcanPort, path: Path) -> can.BusABC:
    bus = can.Bus(str(path), interface="slcan", bitrate=500_000, sleep_after_open=0, ignore_config=True)
    for _ in range(10_000):  # the kernel hands a line over when it finds the time
        assert port.read() == []  # only commands so far
        if port.has_listener():
            break
    return bus


def test_python_can_talks_slcan_in_both_directions(tmp_path: Path) -> None:
    port = SlcanPort(str(tmp_path / "can"))
    port.open()
    assert not port.has_listener()
    bus = slcan_bus(port, tmp_path / "can")
    assert port.has_listener()
    check_both_directions(port, bus)
    bus.shutdown()
    port.read()
    assert not port.has_listener()
    port.close()


def test_an_slcan_adapter_forgets_a_host_that_has_gone(tmp_path: Path) -> None:
    port = SlcanPort(str(tmp_path / "can"))
    port.open()
    with serial.Serial(str(tmp_path / "can"), timeout=5.0) as host:
        host.write(b"S6\rO\rt123")
        port.read()
        assert host.read(2) == b"\r\r"
    port.read()
    with serial.Serial(str(tmp_path / "can"), timeout=5.0) as host:
        assert not port.has_listener()
        host.write(b"O\r")
        port.read()
        assert host.read(1) == b"\r"
        assert port.has_listener()
    port.close()


@pytest.mark.parametrize(
    "line",
    [
        b"t1234567",
        b"t1239" + b"00" * 9,
        b"t12g100",
        b"t800100",
        b"T200000000",
        b"TFFFFFFFF0",
        b"t-010",
        b"t+120",
        b"t1_20",
        b"t1232AA BB",
        b"r12",
        b"t1232AA",
        b"r1231AA",
        b"x",
        b"\xff\xfe",
        b"t",
    ],
)
def test_an_slcan_adapter_answers_nonsense_with_an_error(tmp_path: Path, line: bytes) -> None:
    port = SlcanPort(str(tmp_path / "can"))
    port.open()
    with serial.Serial(str(tmp_path / "can"), timeout=5.0) as host:
        host.write(b"O\r" + line + b"\r")
        assert port.read() == []
        assert host.read(2) == b"\r\a"
    port.close()


def test_a_closed_slcan_channel_sends_nothing(tmp_path: Path) -> None:
    port = SlcanPort(str(tmp_path / "can"))
    port.open()
    with serial.Serial(str(tmp_path / "can"), timeout=5.0) as host:
        host.write(b"t1230\r")
        assert port.read() == []
        assert host.read(1) == b"\a"
    port.close()


def test_slcan_cannot_carry_error_frames_or_rubbish(tmp_path: Path) -> None:
    port = SlcanPort(str(tmp_path / "can"))
    port.open()
    assert not port.write(pack_can_frame(CanFrame(0x40, bytes(8), is_error=True)))
    assert not port.write(b"rubbish")
    port.close()


@given(
    st.booleans(),
    st.booleans(),
    st.integers(0, 0x1FFFFFFF),
    st.binary(max_size=8),
    st.lists(st.integers(1, 12)),
)
def test_slcan_frames_survive_any_cut_into_chunks(
    is_extended: bool, is_remote: bool, can_id: int, data: bytes, cuts: list[int]
) -> None:
    frame = CanFrame(
        can_id if is_extended else can_id & 0x7FF,
        bytes(len(data)) if is_remote else data,
        is_extended,
        is_remote,
    )
    port = SlcanPort("unused")
    sent: list[bytes] = []
    pty = FakePty(sent)
    port._pty = pty
    pty.chunks = [b"O\r"]
    port.read()
    sent.clear()
    assert port.write(pack_can_frame(frame))
    line = sent[0]
    start = 0
    for cut in [*cuts, len(line)]:
        pty.chunks.append(line[start : start + cut])
        start += cut
    received = []
    while pty.chunks:
        received += port.read()
    assert received == [pack_can_frame(frame)]


class FakePty(PtyPort):
    """Hands over one chunk at a time."""

    def __init__(self, sent: list[bytes]) -> None:
        super().__init__("unused")
        self.chunks: list[bytes] = []
        self._sent = sent

    def read(self) -> list[bytes]:
        return [self.chunks.pop(0)]

    def has_listener(self) -> bool:
        return True

    def write(self, payload: bytes) -> bool:
        self._sent.append(payload)
        return True


def test_a_node_on_a_bus_of_python_can() -> None:
    port = CanBusPort("virtual", "test_serving")
    port.open()
    with can.Bus("test_serving", interface="virtual", ignore_config=True) as bus:
        check_both_directions(port, bus)
        bus.send(can.Message(arbitration_id=1, is_extended_id=False, is_fd=True, data=bytes(12)))
        assert port.read() == []
        port.close()
        bus.send(as_message(FRAMES[0]))
        assert (port.read(), port.has_listener(), port.write(pack_can_frame(FRAMES[0]))) == ([], False, False)
        port.open()
        assert port.read() == []
        port.close()


def test_a_missing_can_interface_is_named() -> None:
    with pytest.raises(NotConnectedError, match="nosuchcan"):
        CanBusPort("socketcan", "nosuchcan").open()


def test_an_interface_that_is_made_again_is_joined_again(monkeypatch: pytest.MonkeyPatch) -> None:
    index = 3
    joined: list[can.BusABC] = []
    make_bus = can.Bus

    def find(name: str) -> int:
        if not index:
            raise OSError("no interface with this name")
        return index

    def join(channel: str, interface: str, ignore_config: bool) -> can.BusABC:
        find(channel)
        joined.append(make_bus(f"{channel} {index}", interface="virtual", ignore_config=True))
        return joined[-1]

    monkeypatch.setattr("sim_backends.serving.can_bus_port.socket.if_nametoindex", find)
    monkeypatch.setattr("sim_backends.serving.can_bus_port.can.Bus", join)
    port = CanBusPort("socketcan", "vcan0")
    port.open()
    index = 0
    assert port.read() == []
    port.open()
    assert (port.has_listener(), port.write(pack_can_frame(FRAMES[0]))) == (False, False)
    index = 4
    assert port.read() == []
    assert port.has_listener()
    with make_bus("vcan0 4", interface="virtual", ignore_config=True) as bus:
        check_both_directions(port, bus)
    port.close()
    assert len(joined) == 2


# Cameras


def test_frames_reach_the_link_of_a_live_folder(tmp_path: Path) -> None:
    folder = tmp_path / "ports" / "camera"
    settings = CameraSettings(
        type="camera", source="live_folder", path=str(folder), width=32, height=24, frame_rate_hz=5
    )
    port = FramePort(str(folder))
    port.open()
    clock = SystemClock()
    image = np.full((24, 32, 3), 100, np.uint8)
    with settings.make_driver("camera", settings.make_link(clock), clock) as camera:
        t_ns = clock.now_ns()
        assert port.write(CameraImage(image, t_ns))
        frames = [sample for sample in camera.poll() if isinstance(sample, FrameSample)]
        assert [frame.t_capture_ns for frame in frames] == [t_ns]
        port.close()
        assert [sample.up for sample in camera.poll() if isinstance(sample, LinkSample)] == [False]
        assert not folder.exists()
        assert not port.write(CameraImage(image, t_ns))
        port.open()
        assert [sample.up for sample in camera.poll() if isinstance(sample, LinkSample)] == [True]
    port.close()


def test_a_folder_with_other_files_keeps_them(tmp_path: Path) -> None:
    (tmp_path / "1234567890123.jpg").write_bytes(b"mine")
    port = FramePort(str(tmp_path))
    port.open()
    port.write(CameraImage(np.zeros((24, 32, 3), np.uint8), 5_000_000_000))
    port.close()
    assert [path.name for path in tmp_path.iterdir()] == ["1234567890123.jpg"]
