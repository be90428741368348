"""Inputs that users of other programs had trouble with (`field_reports4`): each has one right outcome."""

import math
from pathlib import Path

import pytest

from rover_hil.datasets.can_frames import read_can_log
from tests.rover_hil.command import Command
from tests.rover_hil.test_field_bags import ROOT, end_of

TRUE = (1.0, 1.0, math.pi / 2.0)
CAN = ("times_relative.asc.gz", "times_negative.csv.gz", "wheels_in_fd.asc.gz", "screen_output.log.gz")
TABLES = {
    "decimal_comma": "",
    "two_rows_of_one_time": "2 of each: the clock is coarser than the rows",
    "clock_wraps": "begin anew after 2^32 us",
}
BAGS = {
    "clock_set_back": "clock of the recorder set back by 2.0 s at 7.0 s",
    "power_off": "metadata.yaml missing, as a killed recorder leaves it",
}


@pytest.fixture
def reports(shared_data: Path) -> Path:
    return shared_data / "field_reports4"


@pytest.mark.parametrize("name", CAN)
def test_can_logs_give_the_drive(command: Command, reports: Path, name: str) -> None:
    folder = reports / "can"
    code = command(
        *("import", "can", str(folder / name), "--config", str(folder / "rover.toml")),
        *("--map", str(folder / "wheels.toml"), "--out", "drive.mcap"),
    )
    assert code == 0, command.error
    assert end_of(Path("drive.mcap")).is_right(TRUE)


@pytest.mark.parametrize(("name", "words"), TABLES.items())
def test_tables_give_the_drive(command: Command, reports: Path, name: str, words: str) -> None:
    table = reports / "tables" / f"{name}.csv.gz"
    columns = table.with_name(f"{name}.toml")
    code = command("import", "table", str(table), "--columns", str(columns), "--out", "drive.mcap")
    assert code == 0, command.error
    assert words in command.out
    assert end_of(Path("drive.mcap")).is_right(TRUE)


def test_speeds_without_a_sign_are_said(command: Command, reports: Path) -> None:
    table = reports / "tables" / "speeds_without_sign.csv.gz"
    columns = table.with_name("speeds_without_sign.toml")
    assert command("import", "table", str(table), "--columns", str(columns), "--out", "drive.mcap") == 0
    assert "wheels and truth go opposite ways in 4 of 8 s of motion" in command.out
    assert "the speeds have no sign" in command.out


@pytest.mark.parametrize(("name", "words"), BAGS.items())
def test_bags_give_the_drive(command: Command, reports: Path, name: str, words: str) -> None:
    bag, topics = reports / "bags" / name, Path("topics.toml")
    # The file names its rover from the root of a clone.
    text = (reports / "bags" / "topics.toml").read_text("utf-8")
    topics.write_text(text.replace('"docs/', f'"{ROOT}/docs/'), "utf-8")
    code = command("import", "rosbag", str(bag), "--topics", str(topics), "--out", "drive.mcap")
    assert code == 0, command.error
    assert words in " ".join(command.out.split())
    assert end_of(Path("drive.mcap")).is_right(TRUE)


def test_several_files_without_metadata_are_refused_with_what_helps(command: Command, tmp_path: Path) -> None:
    folder, topics = tmp_path / "bag", tmp_path / "topics.toml"
    folder.mkdir()
    for part in range(2):
        (folder / f"bag_{part}.mcap").write_text("nothing", "utf-8")
    topics.write_text('rover = "robotino"\n[odometry]\ntopic = "/odom"\n', "utf-8")
    assert command("import", "rosbag", str(folder), "--topics", str(topics), "--out", "drive.mcap") == 2
    assert f"`ros2 bag reindex {folder}` makes it again" in command.error


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def test_frames_printed_by_candump_keep_their_kind(tmp_path: Path) -> None:
    log = write(
        tmp_path / "printed.log",
        " (100.000000)  can0  123   [2]  01 02",
        " (100.500000)  can0  12345678   [8]  01 02 03 04 05 06 07 08",
        " (101.000000)  can0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME",
    )
    frames = read_can_log(log)
    assert frames.t_s.tolist() == [100.0, 100.5, 101.0]
    assert frames.lengths.tolist() == [2, 8, 8]
    assert bytes(frames.data[0]) == bytes((1, 2, 0, 0, 0, 0, 0, 0))
    assert [hex(each) for each in frames.identifiers.tolist()] == ["0x123", "0x92345678", "0xa0000004"]


def test_a_counter_that_wraps_on_a_bus_is_continued(tmp_path: Path) -> None:
    times_s = [(4294.9 + 0.01 * step) % 4294.967296 for step in range(40)]
    log = write(tmp_path / "wraps.log", *(f"({t_s:.6f}) can0 123#0102" for t_s in times_s))
    frames = read_can_log(log)
    assert (frames.t_s - frames.t_s[0]).tolist() == pytest.approx(
        [0.01 * step for step in range(40)], abs=2e-6
    )
    assert frames.findings == (("times that begin anew after 2^32 us: the counter wraps", 1),)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (("  can0  123   [2]  01 02",) * 2, "without times: record with `candump -L`"),
        (
            tuple(f" (000.{10000 + 7 * step % 5}00)  can0  123   [2]  01 02" for step in range(20)),
            "its times are differences",
        ),
    ],
)
def test_what_candump_has_printed_without_whole_times_is_refused(
    command: Command, tmp_path: Path, lines: tuple[str, ...], words: str
) -> None:
    log = write(tmp_path / "printed.log", *lines)
    assert command("import", "can", str(log), "--list") == 2
    assert words in command.error
