"""What others' drives do: it is found, reported in one table, and repaired only where it is certain."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rover_hil.drives.drive import read_drive
from tests.rover_hil.command import Command, assert_one_sentence

PERIOD_S, ROWS, TICKS = 0.05, 400, 1000
ROVER = """[rover]
kinematics = "wheels"
wheels = [
  { x_m = 0.0, y_m = 0.2, radius_m = 0.1 },
  { x_m = 0.0, y_m = -0.2, radius_m = 0.1 },
]
[limits]
wheel_speed_rad_s = 30
wheel_acceleration_rad_s2 = 100
"""
COLUMNS = """rate_hz = 10
time = { column = "t" }
[[wheel]]
position = { column = "l", unit = "ticks", ticks_per_turn = 1000 }
speed = { column = "ls", unit = "rad/s" }
[[wheel]]
position = { column = "r", unit = "ticks", ticks_per_turn = 1000 }
speed = { column = "rs", unit = "rad/s" }
"""
Table = dict[str, np.ndarray]


def drive() -> Table:
    """Return a drive whose speed swings, with whole ticks."""
    t_s = PERIOD_S * np.arange(ROWS)
    speeds = [8.0 + 3.0 * np.sin(0.7 * t_s + phase) for phase in (0.0, 0.4)]
    angles = [8.0 * t_s - 3.0 / 0.7 * (np.cos(0.7 * t_s + phase) - np.cos(phase)) for phase in (0.0, 0.4)]
    ticks = [np.round(angle * TICKS / (2.0 * np.pi)) for angle in angles]
    return {"t": t_s, "l": ticks[0], "r": ticks[1], "ls": speeds[0], "rs": speeds[1]}


def lines_of(table: Table) -> list[str]:
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    return [",".join(table), *(",".join(map(repr, row)) for row in rows)]


def import_it(command: Command, lines: list[str], *, end: str = "\n", columns: str = COLUMNS) -> int:
    Path("drive.csv").write_text("\n".join(lines) + end, "utf-8")
    Path("columns.toml").write_text(columns + ROVER, "utf-8")
    return command(
        "import",
        "table",
        "drive.csv",
        "--columns",
        "columns.toml",
        "--out",
        "drive.mcap",
        "--json",
        "--force",
    )


def oddities(command: Command) -> dict[str, dict[str, object]]:
    (found,) = json.loads(command.out)
    return {odd["what"]: odd for odd in found["oddities"] if odd["done"] != "cannot be seen in these data"}


def turned_rad() -> list[float]:
    rows = read_drive(Path("drive.mcap")).channels
    return [
        rows[f"position{wheel}_rad"].value[-1] - rows[f"position{wheel}_rad"].value[0] for wheel in (1, 2)
    ]


def test_a_sound_drive_has_no_oddity_and_no_finding(command: Command) -> None:
    assert import_it(command, lines_of(drive())) == 0, command.error
    assert oddities(command) == {}
    assert json.loads(command.out)[0]["findings"] == []


@pytest.mark.usefixtures("unrendered")
def test_rows_and_cells_are_counted_and_the_report_has_the_table(command: Command) -> None:
    lines = lines_of(drive())
    repeated, cell = lines[50], lines[100].split(",")
    cell[1] = ""
    lines[100] = ",".join(cell)
    lines[51:51] = [repeated] * 3
    del lines[200:204]
    lines[-1] = lines[-1][: len(lines[-1]) // 4]
    assert import_it(command, lines, end="") == 0, command.error
    found = oddities(command)
    assert {what: odd["count"] for what, odd in found.items()} == {
        "rows that repeat the one before": 3,
        "rows missing between others": 4,
        "empty cells": 1,
        "a last row that is cut": 1,
    }
    assert found["a last row that is cut"]["done"] == "left out"
    assert command("replay", "drive.mcap", "--out", "report") == 0
    kept = json.loads(Path("report/summary.json").read_text("utf-8"))["oddities"]
    assert {odd["what"] for odd in kept} >= set(found)
    assert "rows missing between others" in Path("report/report.html").read_text("utf-8")


@pytest.mark.parametrize("wrap", [8192, 2**16])
def test_a_counter_that_starts_again_is_repaired_where_that_is_certain(command: Command, wrap: int) -> None:
    table = drive()
    for name in ("l", "r"):
        table[name] = (table[name] + wrap - 100) % wrap if wrap > 10_000 else table[name] % wrap
    if wrap > 10_000:  # once only
        assert import_it(command, lines_of(table)) == 0
        assert any("jumps by more than the wheel can turn" in what for what in oddities(command))
        return
    assert import_it(command, lines_of(table)) == 0, command.error
    odd = oddities(command)["the counter starts again after 8192"]
    assert odd["done"] == "repaired"
    whole = drive()
    expected = [float(whole[name][-1] - whole[name][0]) * 2.0 * np.pi / TICKS for name in ("l", "r")]
    assert turned_rad() == pytest.approx(expected)


def test_a_counter_of_32_bits_is_repaired_with_its_wrap_given(command: Command) -> None:
    table = drive()
    table["l"] = (table["l"] + 2**32 - 5000) % 2**32
    columns = COLUMNS.replace('"l", unit = "ticks",', f'"l", unit = "ticks", wrap = {2**32},')
    assert import_it(command, lines_of(table), columns=columns) == 0, command.error
    whole = drive()
    assert turned_rad()[0] == pytest.approx(float(whole["l"][-1]) * 2.0 * np.pi / TICKS)


def slow_clock(factor: float) -> Callable[[Table], None]:
    def change(table: Table) -> None:
        table["t"] = factor * table["t"]

    return change


@pytest.mark.parametrize("factor", [1.01, 0.99, 10.0])
def test_a_clock_that_is_wrong_by_a_constant_factor_is_named(command: Command, factor: float) -> None:
    table = drive()
    slow_clock(factor)(table)
    assert import_it(command, lines_of(table)) == 0, command.error
    (found,) = json.loads(command.out)
    texts = " ".join(finding["text"] for finding in found["findings"])
    assert "clock" in texts
    assert f"{factor:.4g}"[:4] in texts


def test_what_these_data_cannot_show_is_called_so(command: Command) -> None:
    assert import_it(command, lines_of(drive())) == 0
    (found,) = json.loads(command.out)
    unseen = [odd["what"] for odd in found["oddities"] if odd["done"] == "cannot be seen in these data"]
    assert any("all wheels reversed" in what for what in unseen)
    assert any("left and right exchanged" in what for what in unseen)
    assert not any("clock" in what for what in unseen)


def test_a_wrap_that_is_not_certain_is_refused_with_the_fix_or_told(command: Command) -> None:
    table = drive()
    table["l"] = table["l"] % 3000
    assert import_it(command, lines_of(table)) == 2
    assert_one_sentence(command.error, "drive.csv line", "'l'", "give the wrap")
    # A wheel may turn by 700 ticks between two rows; its speed bridges the jumps, with a wider estimate.
    table["l"] = drive()["l"] % 700
    assert import_it(command, lines_of(table)) == 0
    assert "odometry began anew" in command.out


def test_a_speed_of_another_wheel_contradicts_the_angle(command: Command) -> None:
    table = drive()
    table["ls"] = 6.0 * np.sin(1.1 * table["t"])
    assert import_it(command, lines_of(table)) == 0
    assert "wheel 0: its speed and the change of its angle contradict each other" in command.out
    assert "wheel 1: its speed" not in command.out


@pytest.mark.parametrize("kind", ["speed", "distance"])
def test_a_unit_that_makes_a_wheel_too_fast_is_refused(command: Command, kind: str) -> None:
    table = drive()
    columns = COLUMNS
    if kind == "speed":
        table["rs"] = 9.5493 * table["rs"]
    else:
        table |= {"d": 100.0 * 0.04 * np.ones(ROWS), "a": np.zeros(ROWS)}
        columns = (
            'time = { column = "t" }\n[increments]\ndistance = { column = "d" }\nturn = { column = "a" }\n'
        )
    assert import_it(command, lines_of(table), columns=columns) == 2
    assert_one_sentence(command.error, "drive.csv line", "limits.wheel_speed_rad_s = 30", "correct the unit")


def test_a_row_with_more_cells_than_names_is_refused(command: Command) -> None:
    lines = lines_of(drive())
    lines[100] = lines[100].replace(".", ",", 1)
    assert import_it(command, lines) == 2
    assert_one_sentence(command.error, "drive.csv line 101", "6 cells, more than the 5 names", "delimiter")
