"""Malformed files: bounded memory and time, and one sentence that states what is wrong."""

import base64
import gzip
import json
import os
import re
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import zstandard
from mcap.writer import Writer

from drivers.can_wheels.mapping_file import SHIPPED_FOLDER, load_mapping
from drivers.device_settings import DeviceSettings
from drivers.errors import ConfigError, LogError
from drivers.heading_calibration import MagnetometerCalibration, load_calibration
from drivers.settings import read_toml
from rover_hil.config import Config, load_config
from rover_hil.config.loader import read_config_text, read_rig
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.images import decode_image
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.report.read_run import read_run
from rover_hil.run.driving import run_virtual
from rover_hil.run.replay import ReplayResult, replay
from rover_hil.terrain.fit_tables import read_plate_table

Message = tuple[str, int, bytes]
CONFIG = "config.json"
DEEP = b"[" * 100_000 + b"]" * 100_000


class RealLog:
    """A short real log as its parts."""

    def __init__(self, path: Path) -> None:
        log = LogReader(path)
        self.metadata = {
            "schema": "rover-hil-log/2",
            "start_ns": str(log.start_ns),
            "origin": log.origin,
            "wall_offset_ns": "0",
        }
        self.attachments = dict(log.attachments)
        self.messages = [(message.topic, message.t_ns, message.data) for message in log.messages()]

    def write(
        self,
        path: Path,
        messages: list[Message] | None = None,
        attachments: dict[str, bytes] | None = None,
        metadata: dict[str, str] | None = None,
    ) -> Path:
        """Write the log anew, with some of its parts replaced."""
        with path.open("wb") as stream:
            writer = Writer(stream, use_chunking=False, enable_data_crcs=True)
            writer.start()
            writer.add_metadata("rover_hil", self.metadata if metadata is None else metadata)
            for name, data in (self.attachments if attachments is None else attachments).items():
                writer.add_attachment(0, 0, name, "", data)
            channels: dict[str, int] = {}
            for topic, t_ns, data in map(as_stored, self.messages if messages is None else messages):
                if topic not in channels:
                    channels[topic] = writer.register_channel(topic, "json", 0)
                writer.add_message(channels[topic], t_ns, data, t_ns)
            writer.finish()  # type: ignore[no-untyped-call]
        return path

    def with_message(self, topic: str, data: bytes) -> list[Message]:
        """Return the messages with one more in the middle."""
        half = len(self.messages) // 2
        return [*self.messages[:half], (topic, self.messages[half][1], data), *self.messages[half:]]


def as_stored(message: Message) -> Message:
    """Return a message as a log of version 2 holds it."""
    topic, t_ns, data = message
    kind, _, device = topic[1:].partition("/")
    if kind in ("raw", "sent", "unsent"):
        named = "received" if kind == "raw" else kind
        payload = {"device": device, "kind": named, "t_ns": t_ns, "hex": data.hex()}
        return "/bytes", t_ns, json.dumps({"payloads": [payload]}).encode()
    if topic == "/health":
        return topic, t_ns, b'{"devices":' + data + b"}"
    return message


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> RealLog:
    table = load_config("robotino").model_dump(by_alias=True)
    table["safety"]["settle_s"] = 0.4
    path = tmp_path_factory.mktemp("malformed") / "run.mcap"
    run_virtual(Config.model_validate(table), path, 1.0, None)
    return RealLog(path)


def replay_file(path: Path) -> ReplayResult:
    log = LogReader(path)
    with restore_config(log) as config:
        return replay(log, config, lambda: None)


def test_a_log_written_anew_replays_exactly(real: RealLog, tmp_path: Path) -> None:
    result = replay_file(real.write(tmp_path / "same.mcap"))
    assert result.cycles > 20
    assert not result.differences


@pytest.mark.parametrize("data", [b"{}", b"[]", b"1", b"", b"\xff", DEEP, b'{"up":"x"}'])
def test_a_wrong_link_record_is_a_damaged_log(real: RealLog, tmp_path: Path, data: bytes) -> None:
    path = real.write(tmp_path / "link.mcap", real.with_message("/link/board", data))
    with pytest.raises(LogError, match="damaged"):
        replay_file(path)


@pytest.mark.parametrize("topic", ["/estimate", "/samples", "/truth", "/end", "/health"])
def test_deep_json_is_a_damaged_log(real: RealLog, tmp_path: Path, topic: str) -> None:
    path = real.write(tmp_path / "deep.mcap", real.with_message(topic, DEEP))
    with pytest.raises(LogError, match="damaged"):
        read_run(path)
    with pytest.raises(LogError, match="not valid JSON"):
        LogMessage(topic, 0, DEEP).json()


def last_stop(messages: list[Message]) -> Iterator[int]:
    """Yield the places of what was sent after the last cycle."""
    last = max(place for place, message in enumerate(messages) if message[0] == "/cycle")
    for place in range(last, len(messages)):
        if messages[place][0].startswith("/sent/"):
            yield place


@pytest.mark.parametrize("change", ["all removed", "one removed", "altered", "one more"])
def test_replay_compares_the_final_stop(real: RealLog, tmp_path: Path, change: str) -> None:
    messages = list(real.messages)
    places = list(last_stop(messages))
    assert len(places) >= 3
    topic, t_ns, data = messages[places[0]]
    if change == "all removed":
        messages = [message for place, message in enumerate(messages) if place not in places]
    elif change == "one removed":
        del messages[places[1]]
    elif change == "altered":
        messages[places[0]] = (topic, t_ns, data[:-2] + bytes([data[-2] ^ 1, data[-1]]))
    else:
        messages.insert(places[0], (topic, t_ns, data))
    result = replay_file(real.write(tmp_path / "stop.mcap", messages))
    assert [difference.field for difference in result.differences] == ["bytes of the final stop"]


def test_an_attachment_overrides_no_setting(real: RealLog, tmp_path: Path) -> None:
    extra = {f"data/board/{key}/x.toml": b"1" for key in ("max_age_s", "port", "type", "gear_ratio")}
    log = LogReader(real.write(tmp_path / "override.mcap", attachments={**real.attachments, **extra}))
    with restore_config(log) as config:
        assert config.devices["board"] == Config.model_validate_json(log.config_json).devices["board"]


def log_with_calibration(real: RealLog, path: Path, calibration: str, **attachments: bytes) -> LogReader:
    table = json.loads(real.attachments[CONFIG])
    imu = {"type": "witmotion", "port": "/dev/ttyUSB9", "baud_rate": 115200, "calibration": calibration}
    table["devices"]["imu"] = imu
    return LogReader(real.write(path, attachments={CONFIG: json.dumps(table).encode(), **attachments}))


def test_a_path_in_the_configuration_of_a_log_is_never_opened(real: RealLog, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    log = log_with_calibration(real, tmp_path / "pipe.mcap", str(pipe))
    with (
        pytest.raises(LogError, match="does not hold its data file data/imu/calibration"),
        restore_config(log),
    ):
        pass


@pytest.mark.parametrize("name", ["..", "a/../../b", "", "a\nb", "n" * 300])
def test_a_data_file_has_a_bare_name(real: RealLog, tmp_path: Path, name: str) -> None:
    attachments = {f"data/imu/calibration/{name}": b"x"}
    log = log_with_calibration(real, tmp_path / "name.mcap", "iron.toml", **attachments)
    with pytest.raises(LogError, match="names a data file"), restore_config(log):
        pass


def test_a_compressed_chunk_does_not_unpack_to_gigabytes(real: RealLog, tmp_path: Path) -> None:
    packer = zstandard.ZstdCompressor().compressobj()
    packed = b"".join([*(packer.compress(bytes(2**24)) for _ in range(40)), packer.flush()])
    content = struct.pack("<QQQI", 0, 0, 40 << 24, 0) + struct.pack("<I", 4) + b"zstd"
    content += struct.pack("<Q", len(packed)) + packed
    whole = real.write(tmp_path / "whole.mcap").read_bytes()
    path = tmp_path / "bomb.mcap"
    # After the magic and the header, in front of everything else.
    first = 8 + 9 + struct.unpack_from("<Q", whole, 9)[0]
    path.write_bytes(whole[:first] + struct.pack("<BQ", 6, len(content)) + content + whole[first:])
    with pytest.raises(LogError, match="more than 32 MB"):
        LogReader(path)


def payload(**changes: object) -> bytes:
    item = {"device": "board", "kind": "received", "t_ns": 10**9, "hex": "00", **changes}
    return json.dumps({"payloads": [item]}).encode()


@pytest.mark.parametrize(
    "data",
    [
        b"{}",
        b"[]",
        b"",
        DEEP,
        b'{"payloads":[1,2]}',
        payload(hex="0g"),
        payload(hex="000"),
        payload(kind="eaten"),
        payload(t_ns=-1),
        payload(t_ns=2**63),
        payload(device=5),
    ],
)
def test_wrong_payloads_are_a_damaged_log(real: RealLog, tmp_path: Path, data: bytes) -> None:
    path = real.write(tmp_path / "bytes.mcap", real.with_message("/bytes", data))
    with pytest.raises(LogError, match="damaged"):
        list(LogReader(path).messages())


def picture(content: bytes, **changes: object) -> bytes:
    record = {
        "timestamp": {"sec": 1, "nsec": 0},
        "frame_id": "camera",
        "data": base64.b64encode(content).decode(),
        "format": "png",
        "t_capture_ns": None,
        **changes,
    }
    return json.dumps(record).encode()


def png_head(side: int) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", side, side) + bytes(100)


@pytest.mark.parametrize(
    "data",
    [
        b"{}",
        b"[]",
        picture(b"", data="not base64!"),
        picture(b"", data=7),
        picture(b"", t_capture_ns=2**63),
        picture(png_head(30_000)),
    ],
)
def test_a_wrong_picture_is_a_damaged_log(real: RealLog, tmp_path: Path, data: bytes) -> None:
    path = real.write(tmp_path / "picture.mcap", real.with_message("/camera/board", data))
    with pytest.raises(LogError, match="damaged"):
        list(LogReader(path).messages())


def test_pictures_do_not_unpack_to_gigabytes(real: RealLog, tmp_path: Path) -> None:
    large = ("/camera/board", real.messages[-1][1], picture(png_head(8000)))
    path = real.write(tmp_path / "pictures.mcap", [*real.messages, *[large] * 400])
    with pytest.raises(LogError, match="its pictures hold more than 2000 pixels for each byte"):
        list(LogReader(path).messages())


@pytest.mark.parametrize("offset", ["", "x", "9" * 30])
def test_a_clock_that_is_none_is_a_damaged_log(real: RealLog, tmp_path: Path, offset: str) -> None:
    path = real.write(tmp_path / "offset.mcap", metadata={**real.metadata, "wall_offset_ns": offset})
    with pytest.raises(LogError, match="damaged"):
        list(LogReader(path).messages())


@pytest.mark.parametrize("length", [2**31, 2**63, 2**64 - 1])
def test_a_record_of_any_length_is_a_damaged_log(real: RealLog, tmp_path: Path, length: int) -> None:
    whole = real.write(tmp_path / "whole.mcap").read_bytes()
    for opcode in (3, 5, 6, 9, 12):
        path = tmp_path / f"length_{opcode}.mcap"
        path.write_bytes(whole[:8] + struct.pack("<BQ", opcode, length) + whole[8:])
        with pytest.raises(LogError, match="damaged"):
            LogReader(path)


@pytest.mark.parametrize("start", ["-1", "9" * 30, "9" * 5000])
def test_a_start_that_is_no_time_is_a_damaged_log(real: RealLog, tmp_path: Path, start: str) -> None:
    path = real.write(tmp_path / "start.mcap", metadata={**real.metadata, "start_ns": start})
    with pytest.raises(LogError, match="start time"):
        LogReader(path)


def test_a_picture_in_a_log_is_a_jpeg_or_png_file_with_all_its_pixels() -> None:
    bitmap = cv2.imencode(".bmp", np.zeros((4, 6, 3), np.uint8))[1].tobytes()
    for data in (bitmap, b"\x89PNG\r\n\x1a\n" + bytes(100)):
        with pytest.raises(LogError, match="cannot be decoded"):
            decode_image(bytes(8) + data)


@pytest.mark.parametrize("kind", ["pipe", "zero", "too large"])
def test_a_calibration_is_a_file_of_bounded_size(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "calibration.toml"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "zero":
        path.symlink_to("/dev/zero")
    else:
        path.write_bytes(b"#" * 1_100_000)
    reason = "larger than 1 MB" if kind == "too large" else "a pipe or a device"
    with pytest.raises(ConfigError, match=reason):
        load_calibration(path, MagnetometerCalibration)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 50_000,
        "a = " + "{a = " * 50_000,
        "[a" + ".a" * 200_000 + "]\n" + "b = 1\n" * 1000,
        "a" + ' . "b"' * 100_000 + " = 1",
        "a" + ".'b'" * 100 + " = 1",
        "a = " + "9" * 5000,
        "a = " + "9" * 4000,
    ],
)
def test_toml_without_measure_is_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "settings.toml"
    path.write_text(text)
    begin_s = time.process_time()
    with pytest.raises(ConfigError, match="is not valid TOML"):
        read_toml(path, "file", "correct it")
    with pytest.raises(ConfigError, match="is not valid TOML"):
        load_config(str(path))
    assert time.process_time() - begin_s < 2.0


@pytest.mark.parametrize("text", ["[" * 100_000, '{"b_m":' + "9" * 5000 + "}", '{"b_m":' + "9" * 4000 + "}"])
def test_json_without_measure_is_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rig.json"
    path.write_text(text)
    with pytest.raises(ConfigError, match="is not valid JSON"):
        read_rig(path)


def test_a_packed_table_does_not_unpack_to_gigabytes(tmp_path: Path) -> None:
    path = tmp_path / "bomb.csv.gz"
    path.write_bytes(gzip.compress(bytes(2**20)) * 100)
    with pytest.raises(LogError, match="larger than 64 MB"):
        read_csv(path)


@pytest.mark.parametrize("content", [b"a,b\n" + b"," * 7_000_000, b"a,b\n" + b"1\n" * 1_100_000])
def test_a_table_has_a_bounded_number_of_cells(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "large.csv"
    path.write_bytes(content)
    with pytest.raises(LogError, match=r"more than 1,000,000 lines or 6,000,000 cells|field larger"):
        read_csv(path)


def test_many_groups_take_time_in_proportion(tmp_path: Path) -> None:
    path = tmp_path / "plates.csv"
    rows = "\n".join(f"p{number},0.1,0.001,5" for number in range(20_000))
    path.write_text(f"test,diameter_m,sinkage_m,load_n\n{rows}\n")
    begin_s = time.process_time()
    assert len(read_plate_table(path)) == 20_000
    assert time.process_time() - begin_s < 3.0


def test_a_message_is_short_and_has_no_control_characters() -> None:
    from rover_hil.console.error_message import readable

    text = readable("first\x1b[31m\n" + "x" * 10_000 + "\n" + "line\n" * 1000)
    assert text.count("\n") == 10
    assert max(map(len, text.splitlines())) < 600
    assert "\x1b" not in text
    assert text.splitlines()[0] == "first?[31m"
    assert text.endswith("lines more")


def test_a_name_that_no_file_can_have_is_one_sentence() -> None:
    from rover_hil.console.error_message import check_name_lengths

    check_name_lengths(["scomp", "folder/" * 100 + "a.csv"])
    for argument in ("n" * 256, "folder/" * 600):
        with pytest.raises(ConfigError, match="too long for the name of a file"):
            check_name_lengths([argument])


@pytest.mark.timeout(400)
@pytest.mark.nightly
def test_a_drawn_part_of_the_malformed_files_is_handled() -> None:
    command = [sys.executable, "-m", "benchmarks.malformed_files", "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    assert json.loads(done.stdout)["commands"] >= 20


def device_kinds(kind: type[DeviceSettings] = DeviceSettings) -> Iterator[type[DeviceSettings]]:
    yield kind
    for inner in kind.__subclasses__():
        yield from device_kinds(inner)


def test_every_device_with_data_files_names_their_keys() -> None:
    import drivers.registry  # noqa: F401 - all devices are known now

    with_files = [
        kind for kind in device_kinds() if "data_files" in vars(kind) and kind is not DeviceSettings
    ]
    assert len(with_files) >= 4
    for kind in with_files:
        assert kind.data_file_keys, kind
        assert set(kind.data_file_keys) <= set(kind.model_fields), kind


@pytest.mark.parametrize(("bits", "wrong"), [("|16@", "|999999999@"), ("0|", "999999999 | ")])
def test_a_signal_of_a_dbc_file_fits_into_a_frame(tmp_path: Path, bits: str, wrong: str) -> None:
    for suffix in ("toml", "dbc"):
        text = (SHIPPED_FOLDER / f"generic_wheel.{suffix}").read_text("cp1252")
        (tmp_path / f"generic_wheel.{suffix}").write_text(text.replace(bits, wrong), "cp1252")
    with pytest.raises(ConfigError, match="fits into no CAN frame"):
        load_mapping(str(tmp_path / "generic_wheel.toml"))


@pytest.mark.parametrize("port", ["n" * 256, "/dev/" + "n" * 5000, "/dev/tty\0USB0"])
def test_a_port_has_a_name_that_a_file_can_have(tmp_path: Path, port: str) -> None:
    path = tmp_path / "rover.toml"
    text = read_config_text("robotino")
    path.write_text(re.sub(r"(?m)^port = .*$", lambda _: f"port = {json.dumps(port)}", text, count=1))
    with pytest.raises(ConfigError, match=r"port: (no file can have this name|string should have at most)"):
        load_config(str(path))
