"""The log: what goes in comes out, in order, also when the file was cut off; damage is noticed."""

import errno
import json
import os
import threading
import tracemalloc
from itertools import count
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader

from drivers.camera.images import decode_jpeg
from drivers.clock import SystemClock
from drivers.errors import LogError
from drivers.link import CameraImage, LinkChange, Received
from drivers.samples import FrameSample, PowerSample
from rover_hil.recording import writer
from rover_hil.recording.chunked_file import CHUNK_NS, ChunkedFile
from rover_hil.recording.images import decode_image, picture_payload, picture_record
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.writer import AWAKE_AFTER_WAITS, LONGEST_PAUSE_NS, LogWriter

START_NS = 1_000_000_000
CONFIG = b'{"a": 1}'
PATIENCE_S = 60.0


def write_log(path: Path, messages: int = 6) -> Path:
    with LogWriter(path, START_NS, CONFIG, {"data/board/mapping/x.dbc": b"VERSION"}, "virtual") as log:
        for index in range(messages):
            t_ns = START_NS + index
            log.received("board", Received(t_ns, bytes([index])))
            log.sent("board", t_ns, b"out", delivered=index % 2 == 0)
            log.write_json("/cycle", t_ns, {"index": index, "value": 0.1 + index})
    return path


def read_all(path: Path) -> tuple[LogReader, list[LogMessage]]:
    log = LogReader(path)
    return log, list(log.messages())


def test_messages_come_back_in_the_order_of_writing(tmp_path: Path) -> None:
    log, messages = read_all(write_log(tmp_path / "run.mcap", messages=2))
    assert [(message.topic, message.t_ns - START_NS) for message in messages] == [
        ("/raw/board", 0), ("/sent/board", 0), ("/cycle", 0),
        ("/raw/board", 1), ("/unsent/board", 1), ("/cycle", 1),
    ]  # fmt: skip
    assert messages[3].data == b"\x01"
    assert messages[5].json() == {"index": 1, "value": 1.1}
    assert log.is_complete
    assert log.origin == "virtual"
    assert log.start_ns == START_NS
    assert log.config_json == CONFIG
    assert log.attachments["data/board/mapping/x.dbc"] == b"VERSION"


def test_floats_come_back_bit_for_bit(tmp_path: Path) -> None:
    values = [0.1 + 0.2, 1e-300, -0.0, 2.0**60 + 1, np.pi]
    with LogWriter(tmp_path / "run.mcap", START_NS, CONFIG, {}, "virtual") as log:
        log.write_json("/estimate", START_NS, values)
    _, (message,) = read_all(tmp_path / "run.mcap")
    assert repr(message.json()) == repr(values)


def test_link_changes_and_images_come_back(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    with LogWriter(tmp_path / "run.mcap", START_NS, CONFIG, {}, "virtual") as log:
        log.received("camera", Received(START_NS, CameraImage(pixels, 77)))
        log.received("camera", Received(START_NS, CameraImage(pixels, None)))
        log.received("camera", LinkChange(START_NS, up=False, reason="unplugged"))
    _, messages = read_all(tmp_path / "run.mcap")
    first, second = (decode_image(message.data) for message in messages[:2])
    assert np.array_equal(first.image, pixels)
    assert (first.t_capture_ns, second.t_capture_ns) == (77, None)
    assert messages[2].json() == {"t_ns": START_NS, "up": False, "reason": "unplugged", "gave_up": False}


def test_an_image_without_pixels_and_a_grey_one_survive() -> None:
    for shape in ((0, 0), (4, 5), (4, 5, 3)):
        pixels = np.arange(np.prod(shape), dtype=np.uint8).reshape(shape)
        record = picture_record("camera", START_NS, CameraImage(pixels, 5))
        image = decode_image(picture_payload(record))
        assert np.array_equal(image.image, pixels)
        assert image.t_capture_ns == 5


@pytest.mark.parametrize("data", [b"", b"short", bytes(8) + b"no bitmap"])
def test_damaged_images_are_a_log_error(data: bytes) -> None:
    with pytest.raises(LogError, match="damaged"):
        decode_image(data)


def test_samples_are_grouped_by_kind_and_pixels_left_out(tmp_path: Path) -> None:
    image = np.zeros((4, 5), np.uint8)
    with LogWriter(tmp_path / "run.mcap", START_NS, CONFIG, {}, "virtual") as log:
        log.samples(START_NS, [])
        log.samples(
            START_NS,
            [
                PowerSample(device="board", t_ns=START_NS, voltage_v=24.0),
                FrameSample(device="camera", t_ns=START_NS, image=image, t_capture_ns=None, index=3),
            ],
        )
    _, (message,) = read_all(tmp_path / "run.mcap")
    record = message.json()
    assert isinstance(record, dict)
    assert record["PowerSample"][0]["voltage_v"] == 24.0
    assert record["FrameSample"][0]["shape"] == [4, 5]


def test_a_log_is_never_overwritten(tmp_path: Path) -> None:
    path = write_log(tmp_path / "run.mcap")
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        LogWriter(path, START_NS, CONFIG, {}, "virtual")
    assert path.read_bytes() == before


NO_SPACE = r"cannot write log .*run\.mcap: No space left on device; make room, or choose another --out"


def test_a_disk_that_is_full_at_the_start_is_said_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full_disk = Path("/dev/full").open("wb")  # noqa: SIM115 - the writer closes it
    monkeypatch.setattr(Path, "open", lambda *_: full_disk)
    with pytest.raises(LogError, match=NO_SPACE):
        LogWriter(tmp_path / "run.mcap", START_NS, CONFIG, {}, "virtual")
    assert full_disk.closed


class DiskOf:
    """A file on a disk with room for so many bytes."""

    def __init__(self, path: Path, room_bytes: int) -> None:
        self._file = path.open("wb")
        self._room_bytes = room_bytes

    def write(self, data: bytes) -> int:
        self._room_bytes -= len(data)
        if self._room_bytes < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self._file.write(data)

    def __getattr__(self, name: str) -> object:
        return getattr(self._file, name)


def test_a_disk_that_fills_up_is_said_so_at_every_write_from_then_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.mcap"
    disk = DiskOf(path, 3000)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", lambda *_: disk)
        log = LogWriter(path, START_NS, CONFIG, {}, "virtual")
    noise = np.random.default_rng(1)

    def fill() -> None:
        for written in count():
            log.write_json("/noise", START_NS + written * 10**9, {"hex": noise.bytes(1000).hex()})

    with pytest.raises(LogError, match=NO_SPACE):
        fill()
    with pytest.raises(LogError, match=NO_SPACE):
        log.write_json("/cycle", START_NS, {})
    log.close()
    kept, messages = read_all(path)
    assert messages
    assert not kept.is_complete


def test_a_disk_that_is_full_at_the_end_is_said_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.mcap"
    disk = DiskOf(path, 2000)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", lambda *_: disk)
        log = LogWriter(path, START_NS, CONFIG, {}, "virtual")
    log.write_json("/cycle", START_NS, {"noise": np.random.default_rng(1).bytes(2000).hex()})
    with pytest.raises(LogError, match=NO_SPACE):
        log.close()
    log.close()


def test_cut_off_anywhere_it_opens_and_holds_every_chunk_before_the_cut(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, START_NS, CONFIG, {}, "virtual") as log:
        for index in range(6):
            log.write_json("/cycle", START_NS + index * CHUNK_NS, {"index": index})
    whole = path.read_bytes()
    _, all_messages = read_all(path)
    cut_path = tmp_path / "cut.mcap"
    counts = []
    for length in range(whole.index(b"zstd"), len(whole), 7):
        cut_path.write_bytes(whole[:length])
        log_cut, messages = read_all(cut_path)
        assert messages == all_messages[: len(messages)]
        assert len(messages) == len(all_messages) or not log_cut.is_complete
        counts.append(len(messages))
    assert counts == sorted(counts)
    assert set(counts) == set(range(7))


def test_what_a_caller_that_hangs_has_noted_is_in_the_file_within_a_second(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    log = LogWriter(path, START_NS, CONFIG, {}, "virtual")
    log.write_json("/cycle", START_NS, {"index": 1})
    clock = SystemClock()
    limit_ns = clock.now_ns() + 60 * 10**9
    while not list(LogReader(path).messages()) and clock.now_ns() < limit_ns:
        clock.sleep_until(clock.now_ns() + 10**7)
    _, messages = read_all(path)
    assert [message.topic for message in messages] == ["/cycle"]
    log.close()


def test_a_log_that_hangs_for_seconds_makes_the_loop_wait_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_hanging, may_go_on = threading.Event(), threading.Event()
    add_message = ChunkedFile.add_message
    now_ns = looks = 0

    def look() -> int:
        nonlocal looks
        looks += 1
        return now_ns

    def hang(file: ChunkedFile, channel: int, time_ns: int, data: bytes, pixels: int) -> None:
        is_hanging.set()
        assert may_go_on.wait(PATIENCE_S)
        add_message(file, channel, time_ns, data, pixels)

    monkeypatch.setattr(ChunkedFile, "add_message", hang)
    monkeypatch.setattr(writer, "stopwatch_ns", look)
    log = LogWriter(tmp_path / "run.mcap", START_NS, CONFIG, {}, "virtual")
    loop = threading.Thread(target=log.wait_while_disk_hangs, args=(lambda: False,))
    try:
        log.write_json("/cycle", START_NS, {"index": 1})
        assert is_hanging.wait(PATIENCE_S)
        now_ns = LONGEST_PAUSE_NS
        log.wait_while_disk_hangs(lambda: False)
        now_ns += 10**8
        log.write_json("/cycle", START_NS, {"index": 2})  # as the watchdog does
        looks = 0
        loop.start()
        while looks < 2 * AWAKE_AFTER_WAITS and loop.is_alive():
            loop.join(0.01)
        assert loop.is_alive()
    finally:
        may_go_on.set()
    loop.join(PATIENCE_S)
    assert not loop.is_alive()
    log.close()
    assert log.longest_pause_s == pytest.approx(2.1)
    _, messages = read_all(tmp_path / "run.mcap")
    assert [message.json() for message in messages] == [{"index": 1}, {"index": 2}]
    assert b"nothing could be written for 2.1 s" in b"".join(
        message.data for message in LogReader(tmp_path / "run.mcap").stored_messages()
    )


def test_a_run_that_someone_ends_does_not_wait_for_a_log_that_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_hanging, may_go_on = threading.Event(), threading.Event()
    now_ns = 0

    def hang(*_: object) -> None:
        is_hanging.set()
        assert may_go_on.wait(PATIENCE_S)

    monkeypatch.setattr(ChunkedFile, "add_message", hang)
    monkeypatch.setattr(writer, "stopwatch_ns", lambda: now_ns)
    log = LogWriter(tmp_path / "run.mcap", START_NS, CONFIG, {}, "virtual")
    try:
        log.write_json("/cycle", START_NS, {"index": 1})
        assert is_hanging.wait(PATIENCE_S)
        now_ns = LONGEST_PAUSE_NS + 10**8
        answers = [False, False, True]
        log.wait_while_disk_hangs(lambda: answers.pop(0))
        assert not answers
        assert log.longest_pause_s == pytest.approx(2.1)
    finally:
        may_go_on.set()
        log.close()


def test_a_program_that_was_stopped_itself_does_not_blame_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns = 0
    monkeypatch.setattr(writer, "stopwatch_ns", lambda: now_ns)
    with LogWriter(tmp_path / "run.mcap", START_NS, CONFIG, {}, "virtual") as log:
        now_ns = 3 * LONGEST_PAUSE_NS
        log.wait_while_disk_hangs(lambda: False)
        assert log.longest_pause_s == 0.0


def test_the_index_of_a_long_log_takes_little_memory() -> None:
    with Path(os.devnull).open("wb") as nowhere:
        file = ChunkedFile(nowhere, "test")
        channels = [file.add_channel(f"/{number}", "Cycle", b"{}") for number in range(12)]

        def memory_after(first: int, last: int) -> int:
            for chunk in range(first, last):
                for channel in channels:
                    file.add_message(channel, chunk * CHUNK_NS, b"{}")
            return tracemalloc.get_traced_memory()[0]

        tracemalloc.start()
        try:
            before = memory_after(0, 100)
            grown = memory_after(100, 600) - before
        finally:
            tracemalloc.stop()
    assert grown / 500 < 600


def test_every_flipped_byte_of_a_message_is_noticed(tmp_path: Path) -> None:
    whole = bytearray(write_log(tmp_path / "run.mcap", messages=3).read_bytes())
    whole[whole.index(b"zstd") + 40] ^= 0x20
    path = tmp_path / "flipped.mcap"
    path.write_bytes(whole)
    with pytest.raises(LogError, match=r"checksum|cannot be unpacked"):
        read_all(path)


def test_other_programs_find_named_fields_and_the_index(tmp_path: Path) -> None:
    path = write_log(tmp_path / "run.mcap")
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) == 1
        assert {schema.encoding for schema in summary.schemas.values()} == {"jsonschema"}
        rows = [
            (channel.topic, schema.name, json.loads(message.data))
            for schema, channel, message in reader.iter_messages(["/bytes", "/cycle"])
            if schema is not None
        ]
        assert summary.statistics.message_count == len(rows)
        assert next(attachment.name for attachment in reader.iter_attachments()) == "config.json"
    assert rows[0][:2] == ("/bytes", "rover_hil.Bytes")
    assert rows[0][2]["payloads"][0] == {"device": "board", "kind": "received", "t_ns": START_NS, "hex": "00"}
    assert rows[1] == ("/cycle", "rover_hil.Cycle", {"index": 0, "value": 0.1})


def test_a_camera_that_sends_jpeg_is_kept_as_it_sent(tmp_path: Path) -> None:
    generator = np.random.default_rng(3)
    pixels = cv2.GaussianBlur(generator.integers(0, 255, (48, 64, 3), dtype=np.uint8), (5, 5), 2.0)
    sent = cv2.imencode(".jpg", pixels)[1].tobytes()
    damaged = sent[: len(sent) // 2]
    with LogWriter(tmp_path / "run.mcap", START_NS, CONFIG, {}, "virtual") as log:
        log.received("camera", Received(START_NS, CameraImage(decode_jpeg(sent), 7, sent)))
        log.received("camera", Received(START_NS, CameraImage(decode_jpeg(damaged), 8, damaged)))
    _, messages = read_all(tmp_path / "run.mcap")
    whole, cut = (decode_image(message.data) for message in messages)
    assert whole.jpeg == sent
    assert np.array_equal(whole.image, decode_jpeg(sent))
    assert cut.jpeg == damaged
    assert cut.image.size == 0


def test_random_damage_never_escapes_as_another_exception(tmp_path: Path) -> None:
    whole = write_log(tmp_path / "run.mcap", messages=5).read_bytes()
    generator = np.random.default_rng(2)
    path = tmp_path / "damaged.mcap"
    noticed = 0
    for _ in range(300):
        damaged = bytearray(whole)
        for place in generator.integers(0, len(whole), 3):
            damaged[place] ^= int(generator.integers(1, 256))
        path.write_bytes(damaged)
        try:
            read_all(path)
        except LogError:
            noticed += 1
    assert noticed > 150  # the rest looks like a cut: a damaged length swallows what follows


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"not an mcap file at all", "not an MCAP file"),
        (b"\x89MCAP0\r\n", "not a log of this software"),
    ],
)
def test_what_is_no_log_is_said_so(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(LogError, match=words):
        LogReader(path)


def test_missing_file_and_folder_are_said_so(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="No such file"):
        LogReader(tmp_path / "missing.mcap")
    with pytest.raises(LogError, match="directory"):
        LogReader(tmp_path)
