"""Inputs that users of other programs had trouble with (`field_reports4`): each has one right outcome."""

import math
from pathlib import Path

import pytest

from rover_hil.drives.files.can_frames import read_can_log
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
    assert "wheels and ground truth go opposite ways in 4 of 8 s of motion" in command.out
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
        ((" (000.020000)  can0  123   [2]  01 02",) * 20, "its times are differences"),
    ],
)
def test_what_candump_has_printed_without_whole_times_is_refused(
    command: Command, tmp_path: Path, lines: tuple[str, ...], words: str
) -> None:
    log = write(tmp_path / "printed.log", *lines)
    assert command("import", "can", str(log), "--list") == 2
    assert words in command.error


def test_relative_times_of_a_vector_file_in_any_case_of_letters(tmp_path: Path) -> None:
    log = write(
        tmp_path / "relative.asc",
        "date Thu May 16 06:16:50.884 pm 2024",
        "Base hex  Timestamps relative",
        "internal events logged",
        "Begin Triggerblock Thu May 16 06:16:50.884 pm 2024",
        *("   0.010000 1  123             Rx   d 2 01 02" for _ in range(10)),
    )
    assert read_can_log(log).t_s.tolist() == pytest.approx([0.01 * step for step in range(1, 11)])


COLUMNS = """time = { column = "t", unit = "ms" }
[[wheel]]
position = { column = "left", unit = "rad" }
[[wheel]]
position = { column = "right", unit = "rad" }
%s
[rover]
kinematics = "wheels"
wheels = [
 { x_m = 0.0, y_m = 0.15, radius_m = 0.06 },
 { x_m = 0.0, y_m = -0.15, radius_m = 0.06 },
]
[limits]
wheel_speed_rad_s = 12
wheel_acceleration_rad_s2 = 500
"""


def import_table(command: Command, rows: list[str], more: str = "") -> int:
    write(Path("table.csv"), *rows)
    write(Path("columns.toml"), COLUMNS % more)
    return command("import", "table", "table.csv", "--columns", "columns.toml", "--out", "drive.mcap")


def test_a_comma_that_may_divide_thousands_is_refused(command: Command) -> None:
    rows = ["t;left;right", *(f"{step};1,{step:03d};1,{step:03d}" for step in range(0, 400, 20))]
    assert import_table(command, rows) == 2
    assert "a comma may divide thousands or decimals: write decimals with a point" in command.error
    assert not Path("drive.mcap").exists()


def test_decimal_commas_that_begin_late_in_a_column_are_read(command: Command) -> None:
    rows = ["note;t;left;right", *(f"1.2;{20 * step};0;0" for step in range(100))]
    rows += [f"1.2;{2000 + 20 * step};0,{step:02d};0,{step:02d}" for step in range(50)]
    assert import_table(command, rows) == 0, command.error
    assert end_of(Path("drive.mcap")).x_m == pytest.approx(0.06 * 0.49, abs=2e-3)


def test_a_reversed_wheel_in_curves_both_ways_is_named(command: Command) -> None:
    """Its left wheel counts backwards: the speed by the wheels changes its sign in each curve."""
    rows, left, right, yaw, x, y = ["t,left,right,x,y,yaw"], 0.0, 0.0, 0.0, 0.0, 0.0
    for step in range(2000):
        rate = 0.6 * math.sin(0.3 * 0.02 * step)
        rows.append(f"{20 * step},{-left:.6f},{right:.6f},{x:.5f},{y:.5f},{yaw:.6f}")
        left += (0.25 - 0.15 * rate) * 0.02 / 0.06
        right += (0.25 + 0.15 * rate) * 0.02 / 0.06
        yaw += 0.02 * rate
        x, y = x + 0.005 * math.cos(yaw), y + 0.005 * math.sin(yaw)
    truth = "\n".join(f'{axis} = {{ column = "{axis}", unit = "{unit}" }}' for axis, unit in AXES.items())
    assert import_table(command, rows, f"[truth]\n{truth}") == 0, command.error
    assert "wheel 0 reversed" in command.out
    assert "opposite ways" not in command.out


AXES = {"x": "m", "y": "m", "yaw": "rad"}
