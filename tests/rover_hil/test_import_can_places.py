"""`rover-hil import can --places`: ground truth and positions of signals and of tables."""

import math
import struct
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from pymap3d import enu2geodetic

from rover_hil.drives.drive import read_drive
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.test_import_can_forms import DBC, MAPPING, ROVER, write_log

BEGIN_S = 1_700_000_000.0
SPEED_M_S, RATE_RAD_S = 0.4, 0.3
TRACK_M, RADIUS_M = 0.3, 0.06
ORIGIN_DEG = (48.1, 11.6)
PLACES_DBC = """VERSION ""
BU_: Rover Host
BO_ 768 Pose: 6 Rover
 SG_ X : 0|16@1- (0.001,0) [0|0] "m" Host
 SG_ Y : 16|16@1- (0.001,0) [0|0] "m" Host
 SG_ Yaw : 32|16@1- (0.0001,0) [0|0] "rad" Host
BO_ 769 Gnss: 8 Rover
 SG_ Lat : 0|32@1- (1E-007,0) [0|0] "deg" Host
 SG_ Lon : 32|32@1- (1E-007,0) [0|0] "deg" Host
"""
TRUTH = """[truth]
x = { column = "Pose.X" }
y = { column = "Pose.Y" }
yaw = { column = "Pose.Yaw" }
"""
FIXES = """[fixes]
latitude = { column = "Gnss.Lat" }
longitude = { column = "Gnss.Lon" }
sigma_m = 0.05
"""


def pose(t_s: float) -> tuple[float, float, float]:
    yaw_rad, radius_m = RATE_RAD_S * t_s, SPEED_M_S / RATE_RAD_S
    return radius_m * math.sin(yaw_rad), radius_m * (1.0 - math.cos(yaw_rad)), yaw_rad


def frames() -> Iterator[can.Message]:
    """Yield 10 s of a turn to the left: wheels at 50 Hz, pose at 10 Hz, positions at 5 Hz."""
    rims = (SPEED_M_S - 0.5 * TRACK_M * RATE_RAD_S, SPEED_M_S + 0.5 * TRACK_M * RATE_RAD_S)
    for number in range(500):
        t_s = 0.02 * number
        angles = [round(1000.0 * rim * t_s / RADIUS_M) for rim in rims]
        yield frame(t_s, 256, struct.pack("<ii", *angles))
        x_m, y_m, yaw_rad = pose(t_s)
        if number % 5 == 0:
            numbers = (round(1000.0 * x_m), round(1000.0 * y_m), round(1e4 * yaw_rad))
            yield frame(t_s + 0.001, 768, struct.pack("<hhh", *numbers))
        if number % 10 == 0:
            place = enu2geodetic(x_m, y_m, 0.0, *ORIGIN_DEG, 0.0)
            yield frame(t_s + 0.002, 769, struct.pack("<ii", *(round(1e7 * each) for each in place[:2])))


def frame(t_s: float, identifier: int, data: bytes) -> can.Message:
    return can.Message(BEGIN_S + t_s, identifier, is_extended_id=False, data=data, channel="can0")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, text in (("rover.toml", ROVER), ("own.toml", MAPPING), ("own.dbc", DBC)):
        Path(name).write_text(text, "utf-8")
    Path("places.dbc").write_text(PLACES_DBC, "utf-8")
    write_log("drive.log", frames())
    return tmp_path


def import_it(command: Command, places: str) -> int:
    Path("places.toml").write_text(places, "utf-8")
    return command(
        *("import", "can", "drive.log", "--config", "rover.toml", "--map", "own.toml"),
        *("--places", "places.toml", "--dbc", "places.dbc", "--out", "drive.mcap"),
    )


def test_signals_are_ground_truth_and_positions(command: Command, folder: Path) -> None:
    assert import_it(command, TRUTH + FIXES) == 0, command.error
    assert "truth: 100 frames" in command.out
    assert "fixes: 50 frames" in command.out
    drive = read_drive(Path("drive.mcap"))
    true = drive.true_poses()
    expected = np.array([pose(0.1 * number) for number in range(100)])
    assert true.x_m == pytest.approx(expected[:, 0], abs=6e-4)
    assert true.yaw_rad == pytest.approx(expected[:, 2], abs=6e-5)
    fixes = drive.fixes()
    assert fixes is not None
    assert fixes.x_m == pytest.approx(expected[::2, 0], abs=0.02)
    assert command("replay", "drive.mcap") == 0
    assert "every output identical" in command.out


def test_a_table_with_the_clock_of_the_log_is_ground_truth(command: Command, folder: Path) -> None:
    rows = [
        "t,x,y,yaw",
        *(f"{BEGIN_S + t_s:.3f},{','.join(map(repr, pose(t_s)))}" for t_s in (0.0, 2.5, 7.0)),
    ]
    Path("rtk.csv").write_text("\n".join(rows) + "\n", "utf-8")
    text = '[truth]\nfile = "rtk.csv"\ntime = { column = "t" }\n'
    text += "".join(f'{name} = {{ column = "{name}" }}\n' for name in ("x", "y", "yaw"))
    assert import_it(command, text) == 0, command.error
    true = read_drive(Path("drive.mcap")).true_poses()
    assert true.x_m == pytest.approx([pose(t_s)[0] for t_s in (0.0, 2.5, 7.0)], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (TRUTH.replace("Pose.X", "Pose.Z"), ("no column 'Pose.Z'", "Pose.X, Pose.Y, Pose.Yaw")),
        (TRUTH.replace("Pose.", "Place."), ("no column 'Place.X'",)),
        (FIXES.replace("Gnss.Lat", "Wheels.Left"), ("no row holds a latitude and a longitude",)),
        ("", ("give [truth] or [fixes]",)),
        ('[truth]\nfile = "a.csv"\n' + TRUTH[8:], ("give the time of the table a.csv",)),
    ],
)
def test_wrong_places_are_one_sentence(
    command: Command, folder: Path, text: str, words: tuple[str, ...]
) -> None:
    assert import_it(command, text) == 2
    assert_one_sentence(command.error, *words)
    assert not Path("drive.mcap").exists()
