"""`rover-hil import rosbag` on what a killed recorder leaves, and on what is no bag."""

import struct
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.field_bags import Bag, write_bag
from tests.rover_hil.test_field_bags import ROOT, end_of

TOPICS = f"""rover = "{ROOT}/docs/examples/differential.toml"
[wheels]
topic = "/joint_states"
joints = ["left_wheel", "right_wheel"]
[imu]
topic = "/imu"
[truth]
topic = "/pose"
"""
STORE = get_typestore(Stores.ROS2_HUMBLE)
CUT = "read as far as it is intact"


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """Return the only file of a sound bag of 13.1 s."""
    write_bag(tmp_path / "whole", Bag())
    return next((tmp_path / "whole").glob("*.mcap"))


def import_it(command: Command, bag: Path) -> int:
    Path("topics.toml").write_text(TOPICS, "utf-8")
    arguments = (str(bag), "--topics", "topics.toml", "--out", "drive.mcap", "--force")
    return command("import", "rosbag", *arguments)


def duration_s(command: Command) -> float:
    return float(command.out.split()[-3])


def copy_of(
    whole: Path, folder: Path, parts: int, mode: CompressionMode = CompressionMode.NONE
) -> list[Path]:
    """Write the messages of a bag into several, one after the other; return their files."""
    with Reader(whole) as reader:
        messages = list(reader.messages())
        size = len(messages) // parts + 1
        files = []
        for part in range(parts):
            writer = Writer(folder / f"copy_{part}", version=9, storage_plugin=StoragePlugin.MCAP)
            writer.set_compression(mode, CompressionFormat.ZSTD)
            with writer:
                own: dict[int, Any] = {}
                for connection, t_ns, data in messages[part * size : (part + 1) * size]:
                    if connection.id not in own:
                        own[connection.id] = writer.add_connection(
                            connection.topic, connection.msgtype, typestore=STORE
                        )
                    writer.write(own[connection.id], t_ns, data)
            files.append(next((folder / f"copy_{part}").glob("*.mcap")))
    return files


@pytest.mark.parametrize(
    ("share", "is_packed", "end_s"),
    [(1.0, False, 13.1), (0.8, False, 11.6), (0.3, False, 4.2), (1.0, True, 13.1), (0.8, True, 13.1)],
)
def test_an_mcap_file_without_its_end_is_read_as_far_as_it_is_intact(
    command: Command, whole: Path, tmp_path: Path, share: float, is_packed: bool, end_s: float
) -> None:
    mode = CompressionMode.STORAGE if is_packed else CompressionMode.NONE
    raw = copy_of(whole, tmp_path, 1, mode)[0].read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(raw[: min(int(share * len(raw)), len(raw) - 20)])
    assert import_it(command, cut) == 0, command.error
    assert CUT in command.out
    assert duration_s(command) == pytest.approx(end_s, abs=0.2)


def test_records_that_are_in_no_chunk_are_read_too(command: Command, whole: Path, tmp_path: Path) -> None:
    raw, loose = whole.read_bytes(), whole.read_bytes()[:8]
    place = 8
    while place < len(raw) - 8:
        kind, length = struct.unpack_from("<BQ", raw, place)
        content = raw[place + 9 : place + 9 + length]
        if kind == 6:
            name = struct.unpack_from("<I", content, 28)[0]
            assert name == 0  # the chunk is not packed
            loose += content[40:]
        elif kind == 1:
            loose += raw[place : place + 9 + length]
        place += 9 + length
    (tmp_path / "loose.mcap").write_bytes(loose)
    assert import_it(command, tmp_path / "loose.mcap") == 0, command.error
    assert "wheels: 132 messages" in command.out
    assert CUT in command.out


def test_the_files_of_a_killed_recorder_are_read_one_after_the_other(
    command: Command, whole: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    for part, file in enumerate(copy_of(whole, tmp_path, 11)):
        raw = file.read_bytes()
        (folder / f"bag_{part}.mcap").write_bytes(raw if part < 10 else raw[:-30])
    assert import_it(command, folder) == 0, command.error
    assert "metadata.yaml missing, as a killed recorder leaves it" in command.out
    assert "bag_10.mcap" in command.out
    assert "wheels: 132 messages" in command.out
    assert end_of(Path("drive.mcap")).is_right((1.0, 1.0, 1.5708))


def text(name: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_text("nothing here", "utf-8")
        return folder / name

    return write


def of(name: str, begin: bytes) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_bytes(begin + bytes(8192))
        return folder / name

    return write


def folder_of(*names: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        bag = folder / "bag"
        bag.mkdir()
        for name in names:
            (bag / name).write_bytes(b"SQLite format 3\0" + bytes(99) if name.endswith(".db3") else b"x")
        return bag

    return write


NO_BAGS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "text as mcap": (text("drive.mcap"), "does not begin like a .mcap file"),
    "text as db3": (text("drive.db3"), "does not begin like a .db3 file"),
    "text as bag": (text("drive.bag"), "does not begin like a .bag file"),
    "text": (text("drive.txt"), "give a .bag, .mcap or .db3 file"),
    "active": (of("drive.bag.active", b"#ROSBAG V2.0\n"), "`rosbag reindex "),
    "no index": (of("drive.bag", b"#ROSBAG V2.0\n"), "`rosbag reindex "),
    "damaged mcap": (
        of("drive.mcap", b"\x89MCAP0\r\n\x01" + bytes(8)),
        "nothing ahead of where it was cut is whole",
    ),
    "damaged db3": (of("drive.db3", b"SQLite format 3\0"), "`sqlite3 "),
    "packed": (of("drive.db3.zstd", b"\x28\xb5\x2f\xfd"), "unpack it"),
    "folder of packed files": (folder_of("bag_0.db3.zstd", "metadata.yaml"), "unpack bag_0.db3.zstd"),
    "folder of others": (folder_of("a.txt"), "it holds no .mcap or .db3 file"),
    "damaged metadata": (folder_of("bag_0.db3", "metadata.yaml"), "`ros2 bag reindex "),
}
OF_LIBRARIES = ("ReaderError", "magic", "parsed", "Unrecognized", "database:", "Error", "YAML")


@pytest.mark.parametrize("name", NO_BAGS)
def test_what_is_no_bag_is_refused_with_what_helps(command: Command, tmp_path: Path, name: str) -> None:
    make, words = NO_BAGS[name]
    bag = make(tmp_path)
    assert import_it(command, bag) == 2
    assert_one_sentence(command.error, bag.name, words)
    assert not any(word in command.error for word in OF_LIBRARIES)


def test_messages_of_a_cut_file_out_of_order_are_put_in_order(
    command: Command, whole: Path, tmp_path: Path
) -> None:
    with Reader(whole) as reader:
        messages = list(reader.messages())
        with Writer(tmp_path / "copy", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            own = {
                each.id: writer.add_connection(each.topic, each.msgtype, typestore=STORE)
                for each in reader.connections
            }
            for _, pair in groupby(range(len(messages)), key=lambda place: place // 7):
                for place in reversed(list(pair)):
                    connection, t_ns, data = messages[place]
                    writer.write(own[connection.id], t_ns, data)
    file = next((tmp_path / "copy").glob("*.mcap"))
    (tmp_path / "cut.mcap").write_bytes(file.read_bytes()[:-20])
    assert import_it(command, tmp_path / "cut.mcap") == 0, command.error
    assert "wheels: 132 messages" in command.out
    assert end_of(Path("drive.mcap")).is_right((1.0, 1.0, 1.5708))
