"""Wheels and places of a drive: a clock that is wrong by a factor, and a path that is turned, are named."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.rover_hil.command import Command
from tests.rover_hil.test_import_oddities import ROVER

PERIOD_S, DURATION_S = 0.05, 60.0
WHEELS = """rate_hz = 10
time = { column = "t" }
[[wheel]]
position = { column = "l", unit = "rad" }
[[wheel]]
position = { column = "r", unit = "rad" }
"""
PLACE = """file = "places.csv"
time = { column = "t" }
x = { column = "x" }
y = { column = "y" }
"""
SECTIONS = {
    "truth": f'[truth]\n{PLACE}yaw = {{ column = "yaw" }}\n',
    "fixes": f"[fixes]\n{PLACE}sigma_m = 0.02\n",
}


def write_drive(
    kind: str,
    factor: float,
    *,
    is_even: bool = False,
    marker_rad: float = 0.0,
    late_s: float = 0.0,
    slow: float = 0.0,
) -> None:
    """Write a drive whose speed and turn swing, and its places by another clock."""
    t_s = np.arange(0.0, DURATION_S, PERIOD_S)
    swing = 0.0 if is_even else 1.0
    speed, turn = 0.8 + swing * 0.3 * np.sin(0.7 * t_s), 0.2 + swing * 0.4 * np.sin(0.31 * t_s)
    speed += slow * np.sin(0.13 * t_s)
    yaw = np.concatenate(([0.0], np.cumsum(turn[:-1] * PERIOD_S)))
    middle = yaw + 0.5 * PERIOD_S * turn
    path = np.concatenate(([0.0], np.cumsum((speed * np.exp(1j * middle))[:-1] * PERIOD_S)))
    wheels = [
        np.concatenate(([0.0], np.cumsum((speed + side * turn)[:-1] * PERIOD_S))) / 0.1
        for side in (-0.2, 0.2)
    ]
    noise = np.random.default_rng(1).normal(0.0, 0.005, (2, len(t_s)))
    places = (factor * t_s + late_s, path.real + noise[0], path.imag + noise[1], yaw + marker_rad)
    write_table("drive.csv", "t,l,r", (t_s, *wheels))
    write_table("places.csv", "t,x,y,yaw", tuple(column[::4] for column in places))
    Path("columns.toml").write_text(WHEELS + SECTIONS[kind] + ROVER, "utf-8")


def write_table(name: str, header: str, columns: tuple[np.ndarray, ...]) -> None:
    rows = np.column_stack(columns).tolist()
    Path(name).write_text("\n".join([header, *(",".join(map(repr, row)) for row in rows)]) + "\n", "utf-8")


def findings(command: Command, name: str) -> list[str]:
    options = ("--columns", "columns.toml", "--out", "drive.mcap", "--json")
    assert command("import", "table", "drive.csv", *options) == 0, command.error
    (found,) = json.loads(command.out)
    return [finding["text"] for finding in found["findings"] if finding["name"] == name]


SOURCES = {"truth": "ground truth", "fixes": "positions"}


@pytest.mark.parametrize("kind", SECTIONS)
@pytest.mark.parametrize("factor", [0.1, 0.99, 1.01, 10.0])
def test_a_clock_that_is_wrong_by_a_factor_is_named(command: Command, kind: str, factor: float) -> None:
    write_drive(kind, factor)
    (text,) = findings(command, "clock")
    assert text.startswith(
        f"the clock of the {SOURCES[kind]} runs {factor:g} times as long as that of the wheels"
    )


@pytest.mark.parametrize("kind", SECTIONS)
def test_clocks_that_agree_have_no_finding(command: Command, kind: str) -> None:
    write_drive(kind, 1.0)
    assert findings(command, "clock") == []


@pytest.mark.parametrize(
    ("kind", "late_s"), [("truth", 0.5), ("fixes", 0.5), ("truth", -0.7), ("fixes", -0.7), ("truth", 13.0)]
)
def test_places_that_are_late_or_early_are_named(command: Command, kind: str, late_s: float) -> None:
    write_drive(kind, 1.0, late_s=late_s, slow=0.3)
    (text,) = findings(command, "clock")
    side = "late" if late_s > 0.0 else "early"
    expected = f"the times of the {SOURCES[kind]} are {abs(late_s):.1f} s {side} against the wheels"
    assert text.startswith(expected)


def test_a_speed_that_repeats_itself_shows_no_offset(command: Command) -> None:
    """Places without a yaw fit at offsets that are 9 s apart."""
    write_drive("fixes", 1.0, late_s=13.0)
    assert findings(command, "clock") == []


@pytest.mark.parametrize("factor", [1.0, 1.01])
def test_an_even_circle_does_not_show_a_clock(command: Command, factor: float) -> None:
    write_drive("truth", factor, is_even=True)
    assert findings(command, "clock") == []


@pytest.mark.parametrize("aside_deg", [0, 10, 60, -120, 180])
def test_a_truth_that_goes_aside_of_the_wheels_is_named(command: Command, aside_deg: int) -> None:
    """So look a marker that is set up otherwise, exchanged wheels, and a reversed distance."""
    write_drive("truth", 1.0, marker_rad=-np.radians(aside_deg))
    found = findings(command, "truth")
    assert len(found) == (abs(aside_deg) > 30)
    for text in found:
        assert abs(float(text.split()[4]) % 360.0 - aside_deg % 360.0) <= 3.0
        assert "wheels are exchanged, or the distance is reversed" in text
    marked = (
        Path("columns.toml")
        .read_text("utf-8")
        .replace("[truth]", f"[truth]\nmarker = {{ yaw_deg = {-aside_deg} }}")
    )
    Path("columns.toml").write_text(marked, "utf-8")
    Path("drive.mcap").unlink()
    assert findings(command, "truth") == []
