"""`rover-hil import can` on the forms in which people have logs and DBC files, and on what is none."""

import struct
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import can
import pytest

from drivers.can_wheels.mapping_file import load_mapping, read_dbc
from drivers.errors import ConfigError, LogError
from rover_hil.drives.files.can_frames import read_can_log
from tests.rover_hil.command import Command, assert_one_sentence

FRAMES, PERIOD_S, SPEED_RAD_S = 300, 0.02, 5.0
ROVER = """[rover]
kinematics = "wheels"
wheels = [{ x_m = 0.0, y_m = 0.15, radius_m = 0.06 }, { x_m = 0.0, y_m = -0.15, radius_m = 0.06 }]
[limits]
wheel_speed_rad_s = 30
wheel_acceleration_rad_s2 = 500
"""
DBC = """VERSION ""
NS_ :
BS_:
BU_: Rover Host
BO_ 256 Wheels: 8 Rover
 SG_ Left : 0|32@1- (0.001,0) [0|0] "rad" Host
 SG_ Right : 32|32@1- (0.001,0) [0|0] "rad" Host
"""
MAPPING = """dbc = "own.dbc"
[[wheel]]
node = "l"
position = { message = "Wheels", signal = "Left", unit = "rad" }
[[wheel]]
node = "r"
position = { message = "Wheels", signal = "Right", unit = "rad" }
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("rover.toml").write_text(ROVER, "utf-8")
    Path("own.toml").write_text(MAPPING, "utf-8")
    Path("own.dbc").write_text(DBC, "utf-8")
    return tmp_path


def messages(*, is_fd: bool = False, size: int = 8, channel: int | str = "can0") -> Iterator[can.Message]:
    for number in range(FRAMES):
        angle = round(1000.0 * SPEED_RAD_S * PERIOD_S * number)
        yield can.Message(
            timestamp=1_700_000_000.0 + PERIOD_S * number,
            arbitration_id=256,
            is_extended_id=False,
            is_fd=is_fd,
            data=struct.pack("<ii", angle, angle) + bytes(size - 8),
            channel=channel,
        )


def write_log(name: str, frames: Iterator[can.Message]) -> str:
    with can.Logger(name) as logger:
        for message in frames:
            logger.on_message_received(message)
    return name


def import_it(command: Command, log: str) -> int:
    arguments = (log, "--config", "rover.toml", "--map", "own.toml", "--out", "drive.mcap", "--force")
    return command("import", "can", *arguments)


@pytest.mark.parametrize("suffix", ["log", "asc", "blf", "csv", "mf4"])
def test_fd_frames_of_8_bytes_are_read_from_every_format(command: Command, folder: Path, suffix: str) -> None:
    if suffix == "mf4":
        pytest.importorskip("asammdf")
    channel: int | str = 1 if suffix == "blf" else "can0"
    log = write_log(f"drive.{suffix}", messages(is_fd=True, channel=channel))
    assert import_it(command, log) == 0, command.error
    assert f"frames: {FRAMES}" in command.out


@pytest.mark.parametrize("suffix", ["log", "asc", "blf"])
def test_larger_fd_frames_are_named(command: Command, folder: Path, suffix: str) -> None:
    channel: int | str = 1 if suffix == "blf" else "can0"
    log = write_log(f"drive.{suffix}", messages(is_fd=True, size=64, channel=channel))
    assert import_it(command, log) == 2
    assert_one_sentence(command.error, "holds 300 CAN FD frames of more than 8 data bytes", "not supported")
    assert command("import", "can", log, "--list") == 2
    assert_one_sentence(command.error, "holds 300 CAN FD frames of more than 8 data bytes", "not supported")


def test_what_is_left_out_has_its_own_name(command: Command, folder: Path) -> None:
    lines = Path(write_log("drive.log", messages())).read_text("utf-8").splitlines()
    lines[10] = "(1700000000.2) can0 300##1" + "00" * 12
    lines[20] = "(1700000000.4) can0 100#0102030"
    lines[30] = "candump: the interface is down"
    Path("drive.log").write_text("\n".join(lines) + "\n", "utf-8")
    assert import_it(command, "drive.log") == 0, command.error
    for words in (
        "CAN FD frames of more than 8 data bytes",
        "frames of another length than they state",
        "lines without a frame",
    ):
        assert words in command.out


def printed(line: Callable[[can.Message, str], str]) -> str:
    return "".join(f"{line(each, each.data.hex(' ').upper())}\n" for each in messages())


def dated(message: can.Message) -> str:
    return datetime.fromtimestamp(message.timestamp, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")


PRINTED: dict[str, Callable[[can.Message, str], str]] = {
    "-t A": lambda each, data: f" ({dated(each)})  can0  100   [8]  {data}",
    "-x": lambda each, data: f" ({each.timestamp:.6f})  can0  RX - -  100   [8]  {data}",
    "-a": lambda each, data: f" ({each.timestamp:.6f})  can0  100   [8]  {data}   '....A1..'",
    "of CAN FD": lambda each, data: f" ({each.timestamp:.6f})  can0  100  [08]  {data}",
}


@pytest.mark.parametrize("name", PRINTED)
@pytest.mark.parametrize("suffix", ["log", "txt"])
def test_what_candump_prints_is_read(command: Command, folder: Path, name: str, suffix: str) -> None:
    Path(f"drive.{suffix}").write_text(printed(PRINTED[name]), "utf-8")
    assert import_it(command, f"drive.{suffix}") == 0, command.error
    assert f"frames: {FRAMES}" in command.out
    assert "6.0 s: drive.mcap" in command.out


NO_LOGS = {
    "words.log": "`candump -L` or `candump -l` writes",
    "words.asc": "export it as ASC again",
    "words.blf": "export it as BLF again",
    "words.trc": "save the trace again in PCAN-View",
    "words.csv": "save it again as CSV of python-can or SavvyCAN",
    "words.mf4": "finalise it with the converter of its maker",
}
OF_LIBRARIES = ("unpack", "codec", "Unexpected", "float", "MDF file", "BytesIO", "expected")


@pytest.mark.parametrize("name", NO_LOGS)
@pytest.mark.parametrize("content", [b"this is no log\nof any bus\n" * 20, bytes(range(256)) * 9])
def test_what_is_no_log_is_refused_with_what_helps(
    command: Command, folder: Path, name: str, content: bytes
) -> None:
    if name.endswith("mf4"):
        pytest.importorskip("asammdf")
    Path(name).write_bytes(content)
    assert import_it(command, name) == 2
    assert_one_sentence(command.error, name)
    if content.startswith(b"this"):
        assert NO_LOGS[name] in command.error
    assert not any(word in command.error for word in OF_LIBRARIES)


UNUSED = {
    "long message": 'BO_ 512 Unused: 3000 Rover\n SG_ One : 0|16@1+ (1,0) [0|0] "" Host\n',
    "long signal": 'BO_ 512 Unused: 64 Rover\n SG_ One : 0|136@1+ (1,0) [0|0] "" Host\n',
    "empty signal": 'BO_ 512 Unused: 8 Rover\n SG_ One : 0|0@1+ (1,0) [0|0] "" Host\n',
    "factor": 'BO_ 512 Unused: 8 Rover\n SG_ One : 0|16@1+ (x,0) [0|0] "" Host\n',
    "name": 'BO_ 512 Un-used: 8 Rover\n SG_ One-a : 0|16@1+ (1,0) [0|0] "" Host\n',
    "sender": 'BO_ 512 Unused: 8 Rover Extra\n SG_ One : 0|16@1+ (1,0) [0|0] "" Host\n',
    "identifier": 'BO_ 5000 Unused: 8 Rover\n SG_ One : 0|16@1+ (1,0) [0|0] "" Host\n',
    "ranges": (
        'BO_ 512 Unused: 8 Rover\n SG_ M M : 0|16@1+ (1,0) [0|0] "" Host\n'
        ' SG_ One m0 : 16|16@1+ (1,0) [0|0] "" Host\nSG_MUL_VAL_ 512 One M 0-60000;\n'
    ),
    "attribute": ('BO_ 512 Unused: 8 Rover\n SG_ One : 0|16@1+ (1,0) [0|0] "" Host\nBA_ "Foo" BO_ 512 5;\n'),
}


@pytest.mark.parametrize("name", UNUSED)
@pytest.mark.parametrize("is_first", [False, True])
def test_a_message_that_is_not_used_is_no_reason_to_refuse(
    command: Command, folder: Path, name: str, is_first: bool
) -> None:
    begin, wheels = DBC.split("BO_ 256", 1)
    parts = (UNUSED[name], f"BO_ 256{wheels}") if is_first else (f"BO_ 256{wheels}", UNUSED[name])
    Path("own.dbc").write_text(begin + "".join(parts), "utf-8")
    log = write_log("drive.log", messages())
    assert import_it(command, log) == 0, command.error
    assert command("import", "can", log, "--list", "--dbc", "own.dbc") == 0, command.error
    assert "Left: 0 to 29.9 rad" in command.out


def test_a_wrong_message_that_is_used_is_named_with_its_line(folder: Path) -> None:
    Path("own.dbc").write_text(DBC.replace("(0.001,0) [0|0]", "(0,001;0) [0|0]"), "utf-8")
    with pytest.raises(ConfigError, match="message 'Wheels' in line 5 is not written as the format demands"):
        load_mapping("own.toml")
    Path("own.dbc").write_text(DBC.replace("0|32@", "0|320@"), "utf-8")
    with pytest.raises(ConfigError, match="message 'Wheels' in line 5 has a signal of 320 bits"):
        load_mapping("own.toml")


def test_what_a_dbc_file_says_of_a_sound_message_is_kept_beside_a_wrong_one(folder: Path) -> None:
    more = 'SIG_VALTYPE_ 256 Left : 1;\nVAL_ 256 Right 1 "one; or two" 2 "two" ;\n'
    Path("own.dbc").write_text(DBC + UNUSED["name"] + more, "utf-8")
    message = read_dbc(Path("own.dbc")).get_message_by_name("Wheels")
    assert message.get_signal_by_name("Left").is_float
    choices = message.get_signal_by_name("Right").choices
    assert choices is not None
    assert str(choices[1]) == "one; or two"


def test_a_cut_packed_log_is_refused_with_what_helps(folder: Path) -> None:
    Path("drive.log.gz").write_bytes(b"\x1f\x8b\x08" + bytes(30))
    with pytest.raises(LogError, match=r"gz file, `gzip -dc drive\.log\.gz > drive\.log`"):
        read_can_log(Path("drive.log.gz"))
